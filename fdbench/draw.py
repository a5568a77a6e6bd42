"""Drawn machines: which values a data sheet leaves open, and by how much; every seed is another machine within that.

A draw names values of a scenario by their path, such as ``plant.motor.mass_kg`` or
``reality.effects.shaker_force.phase_rad``; an entry of a list is named by its ``kind``, or by its number from 0.
"""

import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar, cast, final

import numpy as np

from fdbench.errors import SpecError, did_you_mean
from fdbench.simulate.random import stream
from fdbench.specification import bounded, check_bounds, snake_case

# Where a normal distribution is cut, in standard deviations: what a maker's inspection would let pass.
LARGEST_DEVIATION = 2.0
_PLACE = re.compile("[0-9]{1,4}")  # in a list
_REMAINING_VARIANCE = 0.7737413  # of a standard normal that is cut there


@final
@dataclass(frozen=True, kw_only=True)
class Normal:
    r"""One factor :math:`1 + s\,z` for all values, z standard normal and redrawn beyond two standard deviations.

    Parameters
    ----------
    values : tuple of str
        Paths.
    relative_deviation : float
        s, standard deviation before the cut.
    """

    values: tuple[str, ...]
    relative_deviation: float = bounded(5e-324, 0.45)

    def __post_init__(self) -> None:
        check_bounds(self)

    def drawn(self, nominal: float, generator: np.random.Generator) -> float:
        """Return one value."""
        z = math.inf
        while abs(z) > LARGEST_DEVIATION:
            z = generator.standard_normal()
        return nominal * (1.0 + self.relative_deviation * z)

    def extreme(self, nominal: float, upper: bool) -> float:
        """Return the largest or smallest value."""
        return nominal * (1.0 + (LARGEST_DEVIATION if upper else -LARGEST_DEVIATION) * self.relative_deviation)

    def deviation(self, nominal: float) -> float:
        """Return the standard deviation of a value."""
        return abs(nominal) * self.relative_deviation * math.sqrt(_REMAINING_VARIANCE)


@final
@dataclass(frozen=True, kw_only=True)
class LogUniform:
    r"""One factor :math:`f^u` for all values, u uniform in [-1, 1].

    Parameters
    ----------
    values : tuple of str
        Paths.
    factor : float
        f, the largest factor; 1 / f is the smallest.
    """

    values: tuple[str, ...]
    factor: float = bounded(1.0, 1000.0)

    def __post_init__(self) -> None:
        check_bounds(self)

    def drawn(self, nominal: float, generator: np.random.Generator) -> float:
        """Return one value."""
        return float(nominal * self.factor ** generator.uniform(-1.0, 1.0))

    def extreme(self, nominal: float, upper: bool) -> float:
        """Return the largest or smallest value."""
        return nominal * (self.factor if upper else 1.0 / self.factor)

    def deviation(self, nominal: float) -> float:
        r"""Return the standard deviation, to first order :math:`\ln f / \sqrt 3`."""
        return abs(nominal) * math.log(self.factor) / math.sqrt(3.0)


@final
@dataclass(frozen=True, kw_only=True)
class Uniform:
    """One number for all values, uniform between two bounds, whatever the nominal ones are.

    Parameters
    ----------
    values : tuple of str
        Paths.
    low, high : float
        In the unit of the value.
    """

    values: tuple[str, ...]
    low: float = bounded(-1e300, 1e300)
    high: float = bounded(-1e300, 1e300)

    def __post_init__(self) -> None:
        check_bounds(self)
        if not self.low < self.high:
            raise SpecError(f"high: {self.high:g} is not above low, {self.low:g}.")

    def drawn(self, nominal: float, generator: np.random.Generator) -> float:
        """Return one value."""
        return float(generator.uniform(self.low, self.high))

    def extreme(self, nominal: float, upper: bool) -> float:
        """Return the largest or smallest value."""
        return self.high if upper else self.low

    def deviation(self, nominal: float) -> float:
        """Return the standard deviation of a value."""
        return (self.high - self.low) / math.sqrt(12.0)


Draw = Normal | LogUniform | Uniform

Specification = TypeVar("Specification")


def drawn(specification: Specification, draws: Sequence[Draw], seed: int) -> Specification:
    """Return a specification, such as a scenario, with the values of one machine.

    Each draw has a random stream of its own, named by its paths, so that a further draw moves none of the others.
    """
    for draw in draws:
        for path in draw.values:
            generator = stream(seed, f"draw {' '.join(draw.values)}")  # anew, so that all paths share the factor
            specification = changed(specification, path, partial(draw.drawn, generator=generator))
    return specification


def moved(specification: Specification, draw: Draw, deviations: float) -> Specification:
    """Return a specification with the values of one draw moved by a number of standard deviations."""
    for path in draw.values:
        specification = changed(specification, path, lambda nominal: nominal + deviations * draw.deviation(nominal))
    return specification


def changed(specification: Specification, path: str, change: Callable[[float], float]) -> Specification:
    """Return a specification in which ``change`` was applied to one number; bounds are checked.

    Raises
    ------
    SpecError
        If the path names no number; the message gives the nearest name.
    """
    return cast(Specification, _changed(specification, path.split("."), change, path))


def _changed(holder: Any, keys: Sequence[str], change: Callable[[float], float], path: str) -> Any:
    if not keys:
        if isinstance(holder, bool) or not isinstance(holder, int | float):
            raise SpecError(f"{path}: not a number but {type(holder).__name__}; name one of its values.")
        return change(float(holder))
    key, rest = keys[0], keys[1:]
    if isinstance(holder, tuple):
        kinds = [getattr(item, "name", None) or snake_case(type(item).__name__) for item in holder]
        index = int(key) if _PLACE.fullmatch(key) else kinds.index(key) if key in kinds else len(holder)
        if index >= len(holder):
            there = f"there are {', '.join(kinds)}" if kinds else "the list is empty"
            raise SpecError(f"{path}: there is no '{key}'; {there}.{did_you_mean(key, kinds)}")
        return (*holder[:index], _changed(holder[index], rest, change, path), *holder[index + 1 :])
    names = [field.name for field in dataclasses.fields(holder)] if dataclasses.is_dataclass(holder) else []
    if key not in names:
        raise SpecError(f"{path}: there is no '{key}'.{did_you_mean(key, names)}")
    return dataclasses.replace(holder, **{key: _changed(getattr(holder, key), rest, change, path)})


def check_draws(specification: Any, draws: Sequence[Draw]) -> None:
    """Raise a SpecError if a path names no number, if two draws name the same, or if bounds are left."""
    seen: set[str] = set()
    for number, draw in enumerate(draws):
        for path in draw.values:
            if path in seen:
                raise SpecError(f"draw[{number}].values: {path} is drawn twice.")
            seen.add(path)
            for upper in (False, True):
                try:
                    changed(specification, path, partial(draw.extreme, upper=upper))
                except SpecError as error:
                    raise SpecError(f"draw[{number}].values: {error}") from error
