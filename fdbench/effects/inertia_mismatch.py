"""Inertia mismatch: the table is heavier or lighter than nominal, as with a workpiece."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, LinearPart, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class InertiaMismatch(Effect):
    r"""Extra mass of the table.

    .. math:: F = \Delta m\, a

    a: acceleration of the table. A negative mass is a lighter table.

    Validity: lighter by less than the table's mass.

    Source: Newton's second law.

    Examples
    --------
    >>> effect = InertiaMismatch(extra_mass_kg=6.0)
    >>> InertiaMismatch.kernel(0.0, 1e-4, 0.0, 0.0, 2.5, *effect.values())
    (15.0, 6.0)
    """

    port = Port.TABLE_INERTIA
    amplitude = "extra_mass_kg"
    calibrates = "mass"
    confusable_with = ("motor_constant", "structural_mode")

    extra_mass_kg: float = parameter("dm", low=-20.0, high=500.0, typical=12.0)

    @kernel
    def kernel(t, h, x, v, u, dm):
        return dm * u, dm

    def linear_part(self) -> LinearPart:
        return LinearPart(numerator=(self.extra_mass_kg,))
