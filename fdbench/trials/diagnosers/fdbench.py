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
        found = diagnose(nominal, records, holdouts)
        chances: dict[str, float] = {}
        for cause in found.answer.causes:
            for name, chance in cause.alternatives.items():
                chances[name] = max(chances.get(name, 0.0), chance)
        chances |= {suspect.effect: suspect.probability for suspect in found.answer.suspects}
        chances |= {cause.effect: cause.probability for cause in found.answer.causes}
        return CaseAnswer(
            effects=chances,
            unknown=found.answer.unknown_probability,
            none=found.answer.no_gap_probability,
            closure=found.answer.shrinkage.explained_fraction,
        )
