"""Drawn machines: which values a data sheet leaves open, and by how much; every seed is another machine within that.

A draw names values of a scenario by their path, such as ``plant.motor.mass_kg`` or
``reality.effects.shaker_force.phase_rad``; an entry of a list is named by its ``kind``, or by its number from 0.
"""

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from fdbench.errors import SpecError, did_you_mean
from fdbench.simulate.random import stream
from fdbench.specification import bounded, check_bounds

# Where a normal distribution is cut, in standard deviations: what a maker's inspection would let pass.
LARGEST_DEVIATION = 2.0
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

    def deviation(self, nominal: float) -> float:
        r"""Return the standard deviation, to first order :math:`\ln f / \sqrt 3`."""
        return abs(nominal) * math.log(self.factor) / math.sqrt(3.0)


@final
@dataclass(frozen=True, kw_only=True)
class Uniform:
    """One number for all values, uniform between two bounds, whatever is on paper.

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

    def deviation(self, nominal: float) -> float:
        """Return the standard deviation of a value."""
        return (self.high - self.low) / math.sqrt(12.0)


Draw = Normal | LogUniform | Uniform


def drawn_table(table: Mapping[str, Any], draws: Sequence[Draw], seed: int) -> dict[str, Any]:
    """Return a scenario's table with the values of one machine.

    Each draw has a random stream of its own, named by its paths, so that a further draw moves none of the others.
    """
    result = copy.deepcopy(dict(table))
    for draw in draws:
        generator = stream(seed, f"draw {' '.join(draw.values)}")
        state = generator.bit_generator.state
        for path in draw.values:
            generator.bit_generator.state = state
            holder, key = _place(result, path)
            holder[key] = draw.drawn(_number(holder, key), generator)
    return result


def moved_table(table: Mapping[str, Any], draw: Draw, deviations: float) -> dict[str, Any]:
    """Return a scenario's table with the values of one draw moved by a number of standard deviations."""
    result = copy.deepcopy(dict(table))
    for path in draw.values:
        holder, key = _place(result, path)
        nominal = _number(holder, key)
        holder[key] = nominal + deviations * draw.deviation(nominal)
    return result


def check_draws(table: Mapping[str, Any], draws: Iterable[Draw]) -> None:
    """Raise a SpecError if a path names no number of the scenario, or if two draws name the same.

    A value that the file leaves at its default, such as a phase, may be drawn uniformly, which asks for no nominal one.
    """
    seen: set[str] = set()
    for number, draw in enumerate(draws):
        for path in draw.values:
            try:
                holder, key = _place(table, path)
            except SpecError as error:
                raise SpecError(f"draw[{number}].values: {error}") from error
            is_left_out = isinstance(holder, Mapping) and key not in holder
            if is_left_out and not isinstance(draw, Uniform):
                raise SpecError(f"draw[{number}].values: {path} is not in the file.{did_you_mean(key, holder)}")
            value = 0.0 if is_left_out else holder[key]
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise SpecError(f"draw[{number}].values: {path} is {value!r}; a number is expected.")
            if path in seen:
                raise SpecError(f"draw[{number}].values: {path} is drawn twice.")
            seen.add(path)


def _number(holder: Any, key: Any) -> float:
    return float(holder.get(key, 0.0) if isinstance(holder, Mapping) else holder[key])


def _place(table: Any, path: str) -> tuple[Any, Any]:
    """Return the table or list that holds a value, and its key there; only the last key need not exist."""
    *parents, last = path.split(".")
    for depth, key in enumerate(parents):
        entry = _entry(table, key)
        if entry is None:
            allowed = list(table) if isinstance(table, Mapping) else [_kind(item) for item in table]
            where = ".".join(parents[:depth]) or "the scenario"
            raise SpecError(f"{path}: {where} has no '{key}'.{did_you_mean(key, allowed)}")
        table = table[entry]
        if not isinstance(table, Mapping | list):
            raise SpecError(f"{path}: {'.'.join(parents[: depth + 1])} is a value, not a table.")
    place = last if isinstance(table, Mapping) else _entry(table, last)
    if place is None:
        raise SpecError(f"{path}: {'.'.join(parents)} has {len(table)} entries.")
    return table, place


def _entry(table: Mapping[str, Any] | Sequence[Any], key: str) -> Any:
    if isinstance(table, Mapping):
        return key if key in table else None
    if key.isdecimal():
        return int(key) if int(key) < len(table) else None
    return next((index for index, item in enumerate(table) if _kind(item) == key), None)


def _kind(item: Any) -> str:
    return str(item.get("kind", "")) if isinstance(item, Mapping) else ""
