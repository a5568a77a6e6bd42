"""The same search, each sample counted as independent evidence: what overconfidence looks like."""

import math
from collections.abc import Sequence
from typing import final

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.record import Record
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser
from fdbench.trials.diagnosers._search import accepted, weights


@final
class UntemperedEvidence(Diagnoser):
    r"""Probabilities :math:`p \propto \mu^{-n/2}` of rivals with misfit :math:`\mu` on n held-out samples.

    It knows no unknown cause, and takes what the search names for the truth.
    """

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        found = diagnose(nominal, records, holdouts)
        chances: dict[str, float] = {}
        for stage in accepted(found):
            misfits = [*(rival.misfit for rival in stage.rivals), stage.misfit]
            evidence = weights([-0.5 * stage.test_count * math.log(max(misfit, 1e-9)) for misfit in misfits])
            for rival, chance in zip(stage.rivals, evidence, strict=False):
                chances[rival.kind.name] = max(chances.get(rival.kind.name, 0.0), chance)
        none = 0.0 if chances else 1.0
        return CaseAnswer(
            effects=chances,
            none=none,
            closure=found.answer.shrinkage.explained_fraction,
        )
