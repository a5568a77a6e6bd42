"""Axial compliance: the screw is softer than nominal."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, LinearPart, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class AxialCompliance(Effect):
    r"""Loss of stiffness of screw, nut and bearings; a negative value means that they are stiffer.

    .. math:: k' = (1 - s/100)\, k, \quad c' = (1 - s/100)\, c \qquad \Leftrightarrow \qquad
              g = s\, u / 100, \quad u = x_m - x_t

    with s in per cent. The screw's nominal stiffness k and damping c act on the motor side's position x_m minus the
    table's x_t; g is the part of that stretch which they do not see. On a rigid axis there is no stiffness to lose.

    Source: Kamalzadeh, Erkorkmaz (2007), CIRP Annals 56(1), on the axial mode of a ball screw drive.

    Examples
    --------
    >>> (free,) = AxialCompliance.kernel(0.0, 1e-4, 0.0, 0.0, 8e-6, *AxialCompliance.typical().values())
    >>> round(free * 1e6, 9)  # 20 % of 8 um
    1.6
    """

    port = Port.TRANSMISSION
    rank = 2
    needs_screw = True
    amplitude = "stiffness_loss_percent"
    confusable_with = ("backlash", "current_loop_lag", "structural_mode")

    stiffness_loss_percent: float = parameter("s", low=-50.0, high=80.0, typical=20.0)

    @kernel
    def kernel(t, h, x, v, u, s):
        return (0.01 * s * u,)

    def linear_part(self) -> LinearPart:
        return LinearPart(numerator=(0.01 * self.stiffness_loss_percent,))
