"""What is measured on a spindle testbed, and whose force is withheld from estimators."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.simulate.testbed import Plan
from fdbench.specification import bounded, check_bounds

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Withheld(ABC):
    """Which segments have their force withheld, as a test set."""

    def __post_init__(self) -> None:
        check_bounds(self)

    @abstractmethod
    def mask(self, plan: Plan, generator: np.random.Generator) -> BoolArray:
        """Return an array of the plan's shape, True where the force is withheld."""


@final
@dataclass(frozen=True, kw_only=True)
class RandomSegments(Withheld):
    """Segments drawn at random, or whole conditions: two segments of one condition are near copies of each other."""

    number: int = bounded(1, 10**9)
    whole_conditions: bool = False

    def mask(self, plan: Plan, generator: np.random.Generator) -> BoolArray:
        """Return the drawn segments; see `Withheld.mask`."""
        together = plan.segments_per_condition if self.whole_conditions else 1
        total = int(np.prod(plan.shape))
        if self.number % together or self.number >= total:
            raise SpecError(
                f"withheld.number: {self.number} of {total} segments; a multiple of {together} below {total} is needed."
            )
        drawn = np.zeros(total // together, dtype=np.bool_)
        drawn[generator.permutation(len(drawn))[: self.number // together]] = True
        return np.repeat(drawn, together).reshape(plan.shape)


@final
@dataclass(frozen=True, kw_only=True)
class ForceLevels(Withheld):
    """All segments at some force levels."""

    levels_N: tuple[float, ...]

    def mask(self, plan: Plan, generator: np.random.Generator) -> BoolArray:
        """Return the segments at the levels; nothing is drawn."""
        mask = np.zeros(plan.shape, dtype=np.bool_)
        mask[:, nearest(self.levels_N, plan.levels_N, "withheld.levels_N")] = True
        return mask


@final
@dataclass(frozen=True, kw_only=True)
class SpindleSpeeds(Withheld):
    """All segments at some speeds."""

    speeds_rad_per_s: tuple[float, ...]

    def mask(self, plan: Plan, generator: np.random.Generator) -> BoolArray:
        """Return the segments at the speeds; nothing is drawn."""
        mask = np.zeros(plan.shape, dtype=np.bool_)
        mask[nearest(self.speeds_rad_per_s, plan.speeds_rad_per_s, "withheld.speeds_rad_per_s")] = True
        return mask


def nearest(wanted: tuple[float, ...], allowed: FloatArray, where: str) -> NDArray[np.intp]:
    """Return the index of the value of an evenly spaced plan that each wanted one rounds to.

    Raises
    ------
    SpecError
        If a value is a twentieth of a step or more off, is named twice, or if nothing would be left.
    """
    step = (allowed[-1] - allowed[0]) / (len(allowed) - 1)
    index = np.array([int(np.argmin(np.abs(allowed - value))) for value in wanted], dtype=np.intp)
    for value, found in zip(wanted, allowed[index].tolist(), strict=True):
        if not abs(value - found) < 0.05 * step:
            raise SpecError(f"{where}: {value:g} is not in the plan. Did you mean {found:.6g}?")
    if not 0 < len(set(index.tolist())) == len(wanted) < len(allowed):
        raise SpecError(f"{where}: {len(wanted)} values; at least one, each once, and not all {len(allowed)}.")
    return index
