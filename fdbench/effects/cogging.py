"""Cogging: magnets and teeth of the motor attract each other, with or without current."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import sin

TURN = 2.0 * math.pi


@final
@dataclass(frozen=True, kw_only=True)
class Cogging(Effect):
    r"""Force that repeats with the pitch of the motor.

    .. math:: F(x_m) = A \sin(2 \pi x_m / \lambda + \varphi)

    x_m: position of the motor side; lambda: pitch. For a rotary motor the pitch is the way in one turn (the lead of a
    screw, the circumference of a pulley, the whole arc of a direct drive) divided by the order (6, 12, 24, 36).

    Source: Altintas, Verl, Brecher, Uriarte, Pritschow (2011), CIRP Annals 60(2), on linear drives.

    Examples
    --------
    >>> effect = Cogging.typical(cogging_force_N=10.0, pitch_m=0.03, phase_rad=0.0)
    >>> force, slope = Cogging.kernel(0.0, 1e-4, 0.0025, 0.1, 0.0, *effect.values())  # a twelfth: sin 30 degrees
    >>> round(force, 9)
    5.0
    """

    port = Port.MOTOR_FORCE
    amplitude = "cogging_force_N"
    cause_type = "force_over_position"
    everywhere = True
    confusable_with = ("torque_ripple", "lead_error")
    counts_as_disturbance = True

    cogging_force_N: float = parameter("A", low=0.0, high=500.0, typical=10.0)
    pitch_m: float = parameter("lambda_p", low=2e-4, high=1.0, typical=0.01 / 6.0, locate="pitch")
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, phase=True)

    @kernel
    def kernel(t, h, x, v, u, A, lambda_p, phi):
        return A * sin(TURN * (x / lambda_p) + phi), 0.0
