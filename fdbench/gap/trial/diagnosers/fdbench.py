"""The package's own diagnosis: closed-loop search, re-calibration in every hypothesis, tempered probabilities."""

from collections.abc import Sequence
from typing import final

from fdbench.gap.diagnose import diagnose
from fdbench.gap.nominal import Nominal
from fdbench.gap.trial.diagnoser import Answer, Diagnoser
from fdbench.gap.trial.diagnosers._search import accepted, closure_of
from fdbench.record import Record


@final
class Fdbench(Diagnoser):
    """What ``fdbench diagnose`` says; effects that it did not name have the probability of their best stage."""

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> Answer:
        found = diagnose(nominal, records, holdouts)
        chances: dict[str, float] = {}
        for stage in accepted(found):
            for rival, probability in zip(stage.rivals, stage.probabilities(), strict=True):
                chances[rival.kind.name] = max(chances.get(rival.kind.name, 0.0), probability)
        chances |= {cause["effect"]: float(cause["probability"]) for cause in found.answer["causes"]}
        return Answer(
            effects=chances,
            unknown=float(found.answer["unknown_probability"]),
            none=float(found.answer["no_gap_probability"]),
            closure=closure_of(found.answer),
        )
