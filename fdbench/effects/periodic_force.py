"""Periodic force: a sinusoid in time from a spindle, a coupling or the run-out of a tool."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import sin

TURN = 2.0 * math.pi


@final
@dataclass(frozen=True, kw_only=True)
class PeriodicForce(Effect):
    r"""Force of one frequency on the table, whatever the axis does.

    .. math:: F(t) = A \sin(2 \pi f t + \varphi)

    Source: Turkay and Ulsoy (1988), eq. (9), for the run-out of a cutter, with f the number of teeth times the spindle
    frequency.

    Examples
    --------
    >>> effect = PeriodicForce.typical(force_amplitude_N=10.0, frequency_Hz=50.0, phase_rad=0.0)
    >>> force, slope = PeriodicForce.kernel(0.005, 1e-4, 0.0, 0.0, 0.0, *effect.values())
    >>> round(force, 9), slope
    (10.0, 0.0)
    """

    port = Port.TABLE_FORCE
    amplitude = "force_amplitude_N"
    cause_type = "process_force"
    confusable_with = ("shaker_force", "tooth_passing_force")
    disturbance = True

    force_amplitude_N: float = parameter("A", low=0.0, high=5000.0, typical=10.0)
    frequency_Hz: float = parameter("f", low=0.1, high=2000.0, typical=50.0, locate="line")
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, phase=True)

    @kernel
    def kernel(t, h, x, v, u, A, f, phi):
        turns = f * t
        return A * sin(TURN * (turns - math.floor(turns)) + phi), 0.0
