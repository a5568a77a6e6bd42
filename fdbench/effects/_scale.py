"""Scale: an effect on a smaller or larger axis, with the same physics and other bounds, sizes and grids."""

import dataclasses
import functools
import math
import types
from dataclasses import dataclass
from typing import Any

from fdbench.effects._effect import Effect, Parameter
from fdbench.errors import SpecError


@dataclass(frozen=True)
class Scale:
    """How much longer the ways and how much larger the forces of an axis are than those of a usual one.

    Examples
    --------
    >>> scale = Scale(length=10.0, force=0.1)
    >>> scale.of("m/s"), scale.of("N/m"), scale.of("Hz")
    (10.0, 0.01, 1.0)
    """

    length: float = 1.0
    force: float = 1.0

    def of(self, unit: str) -> float:
        """Return the factor of a quantity of this unit; time and angles have none."""
        mass = self.force / self.length
        sizes = {"m": self.length, "N": self.force, "kg": mass, "Pa": self.force / self.length**2}
        above, _, below = unit.partition("/")
        factors = [
            sizes.get(symbol, 1.0) ** (sign * int(power or 1))
            for part, sign in ((above, 1), (below, -1))
            for symbol, _, power in (item.partition("^") for item in part.split())
        ]
        return math.prod(factors)


_ANOTHER = Scale(length=2.0, force=3.0)  # at which every quantity that has a scale is another


def at_scale(kind: type[Effect], scale: Scale) -> type[Effect]:
    """Return the effect of an axis of this scale.

    Its bounds, typical size and grids are for a search. A value that is known need only be of the right sign, where it
    is a force or a length in some power.

    Examples
    --------
    >>> from fdbench.effects import effects
    >>> kind = at_scale(effects.get("cogging"), Scale(length=10.0, force=0.1))
    >>> kind.name, kind.typical().cogging_force_N, kind.typical().pitch_m < 0.02
    ('cogging', 1.0, True)
    """
    return _at_scale(kind.declared, scale)


@functools.cache
def _at_scale(kind: type[Effect], scale: Scale) -> type[Effect]:
    own = Scale() if kind.of_any_axis else scale
    scaled = tuple(_scaled(item, own.of(item.unit)) for item in kind.parameters())

    def parameters(cls: type[Effect]) -> tuple[Parameter, ...]:
        return scaled

    def reduced(effect: Effect) -> tuple[Any, ...]:
        return _restored, (kind, scale, {item.name: getattr(effect, item.name) for item in scaled})

    def equal(effect: Effect, other: object) -> bool:
        return isinstance(other, Effect) and other.declared is kind and effect.values() == other.values()

    members: dict[str, Any] = {
        "declared": kind,
        "parameters": classmethod(parameters),
        "__post_init__": _check_signs,
        "__reduce__": reduced,
        "__eq__": equal,
        "__hash__": kind.__hash__,
        "__module__": kind.__module__,
        "__doc__": kind.__doc__,
    }
    return types.new_class(kind.__name__, (kind,), exec_body=lambda body: body.update(members))


def _restored(kind: type[Effect], scale: Scale, values: dict[str, float]) -> Effect:
    return at_scale(kind, scale)(**values)


def _scaled(item: Parameter, factor: float) -> Parameter:
    if factor == 1.0:
        return item
    low, high, typical = (factor * value for value in (item.low, item.high, item.typical))
    return dataclasses.replace(
        item, low=low, high=high, typical=typical, grid=tuple(factor * value for value in item.grid)
    )


def _check_signs(effect: Effect) -> None:
    """Raise a SpecError for what no axis of any size has."""
    for item, low, high in _signs(effect.declared):
        value = getattr(effect, item.name).real  # complex where it is differentiated
        if not (low <= value <= high and abs(value) < math.inf) or (value == 0.0 < item.low):
            unit = f" {item.unit}" if item.unit else ""
            raise SpecError(f"{item.name}: {value:g} is outside [{low:g}, {high:g}]{unit}.")


@functools.cache
def _signs(kind: type[Effect]) -> tuple[tuple[Parameter, float, float], ...]:
    """Return the parameters with their bounds on an axis of any size."""
    found = []
    for item in kind.parameters():
        low, high = item.low, item.high
        if _ANOTHER.of(item.unit) != 1.0:
            low, high = (0.0 if low >= 0.0 else -math.inf), math.inf
        found.append((item, low, high))
    return tuple(found)
