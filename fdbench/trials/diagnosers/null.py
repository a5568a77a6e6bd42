"""Says of every case that there is no gap: the floor of every score."""

from collections.abc import Sequence
from typing import final

from fdbench.diagnosis.model.nominal import Nominal
from fdbench.record import Record
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser


@final
class NullDiagnoser(Diagnoser):
    """Looks at nothing.

    Examples
    --------
    >>> NullDiagnoser().diagnose(None, [], []).none
    1.0
    """

    constant = True

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        return CaseAnswer(none=1.0)
