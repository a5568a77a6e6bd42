"""Viscous friction: a force proportional to velocity."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class ViscousFriction(Effect):
    r"""Viscous force beyond the nominal one; a negative value means that the nominal model has too much.

    .. math:: F(v) = B v

    Source: Erkorkmaz, Altintas (2001), High speed CNC system design, part II, Int. J. Machine Tools and Manufacture 41.

    Examples
    --------
    >>> effect = ViscousFriction(viscous_friction_N_s_per_m=200.0)
    >>> ViscousFriction.kernel(0.0, 1e-4, 0.0, 0.5, 0.0, *effect.values())
    (100.0, 200.0)
    """

    port = Port.TABLE_FORCE
    amplitude = "viscous_friction_N_s_per_m"
    calibrates = "viscous"

    viscous_friction_N_s_per_m: float = parameter("B", low=-5000.0, high=50000.0, typical=250.0)

    @kernel
    def kernel(t, h, x, v, u, B):
        return B * v, max(B, 0.0)
