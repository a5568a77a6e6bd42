"""Torque ripple: the force of the motor swings with its angle, in proportion to the current."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import sin

TURN = 2.0 * math.pi


@final
@dataclass(frozen=True, kw_only=True)
class TorqueRipple(Effect):
    r"""Force constant that repeats with the pitch of the motor.

    .. math:: F = F_{asked}\, [1 + a \sin(2 \pi x_m / \lambda + \varphi)]

    F: force delivered; F_asked: force asked of the motor; x_m: position of the motor side in the middle of the substep;
    lambda: pitch. For a rotary motor the pitch is the lead divided by the order.

    Source: Holtz, Springob (1996), IEEE Trans. Industrial Electronics 43(2), on torque ripple.

    Examples
    --------
    >>> effect = TorqueRipple.typical(relative_ripple=0.02, pitch_m=0.004, phase_rad=0.0)
    >>> (force,) = TorqueRipple.kernel(0.0, 1e-4, 0.001, 0.0, 500.0, *effect.values())
    >>> round(force, 9)
    510.0
    """

    port = Port.COMMAND
    rank = 3
    amplitude = "relative_ripple"
    confusable_with = ("cogging",)

    relative_ripple: float = parameter("a", low=0.0, high=0.3, typical=0.03)
    pitch_m: float = parameter("lambda_p", low=2e-4, high=1.0, typical=0.01 / 6.0, locate="pitch_of_ratio")
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, phase=True)

    @kernel
    def kernel(t, h, x, v, u, a, lambda_p, phi):
        middle = x + 0.5 * h * v
        return (u * (1.0 + a * sin(TURN * (middle / lambda_p) + phi)),)
