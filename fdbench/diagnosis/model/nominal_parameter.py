"""A nominal parameter: how it changes a drive, what it is called, and how far it may move."""

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

from fdbench.diagnosis.model.nominal import Nominal
from fdbench.effects import Effect
from fdbench.plants.feed_drive import FeedDrive

Changed = tuple[FeedDrive, tuple[Effect, ...]]
"""A drive, and the effects that have to be added to it."""


@dataclass(frozen=True, kw_only=True)
class NominalParameter(ABC):
    """A nominal parameter that every hypothesis may move, with its standard deviation.

    Attributes
    ----------
    name : str
    deviation : float
        Standard deviation, in the unit that the class says.
    kind : str
        What effects are called by that are a large change of it; see `fdbench.effects.Effect.calibrates`.
    unit : str
        Of `size`.
    stated : bool
        Whether a data sheet has it, so that a large change is far-fetched.
    nuisance : bool
        Whether a large change says nothing of the machine.
    limited : bool
        Whether no drive is off by more than it may move, so that at its limit it stands in for what has no name.
    changes_from_run_to_run : bool
        Whether it may differ between repeats, as friction and offsets do.
    """

    name: str
    deviation: float
    kind: ClassVar[str]
    unit: ClassVar[str] = "N"
    stated: ClassVar[bool] = True
    nuisance: ClassVar[bool] = False
    limited: ClassVar[bool] = False
    changes_from_run_to_run: ClassVar[bool] = True

    @classmethod
    @abstractmethod
    def of(cls, nominal: Nominal) -> Sequence[Self]:
        """Return those of a model, as far as it has them and is in doubt of them."""

    @abstractmethod
    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        """Return the drive moved by ``shift`` standard deviations, and an effect that has to be added for it."""

    def gone_with(self, replaced: Collection[int]) -> bool:
        """Whether there is none where known effects of the drive, by their index, are replaced."""
        return False

    def shift_of_replaced(self, effects: Sequence[Effect], drive: FeedDrive, shift: float) -> float:
        """Return its shift where known effects are replaced, which may be what ``effects`` in their place say it is."""
        return shift

    def zeros_apart_m(self, shift: float) -> float:
        """Return by how much the motor's reading is ahead of the table's at the same place, by this parameter."""
        return 0.0

    def force_read_late_s(self, shift: float) -> float:
        """Return by how much the force is read later than the position, by this parameter."""
        return 0.0

    @abstractmethod
    def text(self, drive: FeedDrive, shift: float) -> str:
        """Return its value, moved by so many standard deviations, with its unit."""

    def size(self, drive: FeedDrive) -> float:
        """Return one standard deviation in ``unit``."""
        return self.deviation

    def unit_on(self, drive: FeedDrive) -> str:
        """Return the unit of `size`, which of a known effect is that of its amplitude."""
        return self.unit

    @property
    def relative_deviation(self) -> float | None:
        """Standard deviation relative to the friction that it changes; None where it changes none."""
        return None

    @property
    def room(self) -> tuple[float, float]:
        """How far a fit may move it down and up, in standard deviations."""
        return -math.inf, math.inf

    @property
    def group(self) -> str:
        """What is judged as one: a value on both sides of a screw, all gains of a controller."""
        return self.kind

    def cause(self, nominal: Nominal) -> str:
        """Return the name of the effect that a large change of this value is, or an empty text."""
        return next((kind.name for kind in nominal.library if kind.calibrates == self.kind), "")
