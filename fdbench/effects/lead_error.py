"""Lead error: the screw does not move the table by exactly one lead per turn."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import sin

TURN = 2.0 * math.pi


@final
@dataclass(frozen=True, kw_only=True)
class LeadError(Effect):
    r"""Periodic and cumulative error of the lead, from the origin on.

    .. math:: x_t - x_m = A [\sin(2 \pi x_m / p + \varphi) - \sin\varphi] + \varepsilon x_m

    x_t: position of the table without load; x_m: that of the motor side; epsilon in m/m. The table really moves so, and
    its scale sees it.

    Source: ISO 3408-3 (2006), travel deviation and travel variation of ball screws.

    Examples
    --------
    A quarter turn of a 10 mm lead, 3 um periodic and 20 um/m cumulative error: 3.05 um.

    >>> effect = LeadError.typical(periodic_error_m=3e-6, linear_error=2e-5, phase_rad=0.0)
    >>> (behind,) = LeadError.kernel(0.0, 1e-4, 0.0025, 0.0, 0.0, *effect.values())
    >>> round(-behind * 1e6, 9)
    3.05
    """

    port = Port.TRANSMISSION
    amplitude = "periodic_error_m"
    cause_type = "sensor"
    everywhere = True
    further_amplitudes = ("linear_error",)
    confusable_with = ("thermal_expansion", "cogging")

    periodic_error_m: float = parameter("A", low=0.0, high=1e-4, typical=3e-6)
    linear_error: float = parameter("epsilon", low=-1e-3, high=1e-3, typical=2e-5)
    period_m: float = parameter("p", low=1e-3, high=1.0, typical=0.01, locate="wavelength")
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, phase=True)

    @kernel
    def kernel(t, h, x, v, u, A, epsilon, p, phi):
        return (-(A * (sin(TURN * (x / p) + phi) - sin(phi)) + epsilon * x),)
