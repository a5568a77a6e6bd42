"""The package's own diagnosis: closed-loop search, re-calibration in every hypothesis, tempered probabilities."""

from collections.abc import Sequence
from typing import final

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.record import Record
from fdbench.trials.diagnoser import Answer, Diagnoser
from fdbench.trials.diagnosers._search import closure_of


@final
class Fdbench(Diagnoser):
    """What ``fdbench diagnose`` says: its causes, those it suspects, and what may be there in place of a cause."""

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> Answer:
        found = diagnose(nominal, records, holdouts)
        chances: dict[str, float] = {}
        for cause in (*found.answer["suspects"], *found.answer["causes"]):
            for name, chance in cause.get("alternatives", {}).items():
                chances[name] = max(chances.get(name, 0.0), chance)
        chances |= {cause["effect"]: cause["probability"] for cause in found.answer["suspects"]}
        chances |= {cause["effect"]: cause["probability"] for cause in found.answer["causes"]}
        return Answer(
            effects=chances,
            unknown=float(found.answer["unknown_probability"]),
            none=float(found.answer["no_gap_probability"]),
            closure=closure_of(found.answer),
        )
