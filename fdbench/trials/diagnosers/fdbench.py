"""The package's own diagnosis: closed-loop search, re-calibration in every hypothesis, tempered probabilities."""

from collections.abc import Sequence
from typing import final

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.record import Record
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser


@final
class Fdbench(Diagnoser):
    """What ``fdbench diagnose`` says: its causes, those it suspects, and what may be there in place of a cause."""

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        answer = diagnose(nominal, records, holdouts).answer
        return CaseAnswer(
            effects=answer.chances(),
            unknown=answer.unknown_probability,
            none=answer.no_gap_probability,
            closure=answer.shrinkage.explained_fraction,
        )
