"""Guesses: one effect at random with a random probability, the same for the same records."""

import hashlib
from collections.abc import Sequence
from typing import final

import numpy as np

from fdbench.diagnosis.model.nominal import Nominal
from fdbench.record import Record
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser


@final
class Random(Diagnoser):
    """Draws probabilities of all effects from a flat Dirichlet distribution; the seed is the digest of the records."""

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        digest = hashlib.sha256(b"".join(record["motor_force_N"].tobytes() for record in records)).digest()
        rng = np.random.default_rng(int.from_bytes(digest, "big"))
        names = [kind.name for kind in nominal.library]
        *chances, unknown, none = rng.dirichlet(np.full(len(names) + 2, 0.2)).tolist()
        return CaseAnswer(effects=dict(zip(names, chances, strict=True)), unknown=unknown, none=none)
