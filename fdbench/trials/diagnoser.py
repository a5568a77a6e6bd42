"""What a diagnoser is: records and a nominal model in, probabilities of effects out."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from fdbench.diagnosis.model.nominal import Nominal
from fdbench.errors import SpecError
from fdbench.record import Record
from fdbench.registry import Registry


@dataclass(frozen=True, kw_only=True)
class CaseAnswer:
    """What a diagnoser says of one case.

    Attributes
    ----------
    effects : mapping of str to float
        Probability that each effect is present; those left out have none. Several may be present at once.
    unknown, none : float
        Probability that a cause is present that has no name, and that nothing is.
    closure : float or None
        Share of the held-out gap beyond the noise that the named effects close, where the diagnoser repairs the model.

    Raises
    ------
    SpecError
        If a probability is not between 0 and 1.
    """

    effects: Mapping[str, float] = field(default_factory=dict)
    unknown: float = 0.0
    none: float = 0.0
    closure: float | None = None

    def __post_init__(self) -> None:
        for name, value in {**self.effects, "unknown": self.unknown, "none": self.none}.items():
            if not 0.0 <= value <= 1.0:
                raise SpecError(f"{name}: probability {value:g} is outside [0, 1].")


class Diagnoser(ABC):
    """Base of all diagnosers; every argument of a constructor has a default.

    Class attributes
    ----------------
    constant : bool
        Whether it gives every case the same answer on purpose, as a reference row.
    """

    name: ClassVar[str]
    constant: ClassVar[bool] = False

    @abstractmethod
    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        """Return the answer to one case.

        Parameters
        ----------
        nominal : Nominal
            The nominal model; its ``library`` has the effects that may be named.
        records, holdouts : sequences of Record
            To fit, and to judge on; repeats of a motion are records of their own.
        """


diagnosers: Registry[Diagnoser] = Registry("diagnoser", Diagnoser)  # type: ignore[type-abstract]
