"""Current-loop lag: the motor's force follows the command after a time constant."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, LinearPart, Port, kernel, parameter
from fdbench.effects._functions import exp, sin_cos


@final
@dataclass(frozen=True, kw_only=True)
class CurrentLoopLag(Effect):
    r"""Lag of the force: a loop of first order, or of second order where its inverter is slow too.

    .. math:: \rho \tau^2 \ddot F + \tau \dot F + F = F_{asked}

    F_asked: force asked of the motor; F, and its slope per time constant G: states, the force that it gives. A PI
    controller that cancels the winding closes the loop so, with rho the inverter's time constant relative to tau:
    0: first order; 1/4: two equal poles; 1/2: the magnitude optimum. The command is constant over a substep, so that F
    moves exactly; its mean is delivered.

    Source: Altintas, Manufacturing Automation (2012), on the loops of a feed drive; Umland, Safiuddin (1990),
    Magnitude and symmetric optimum criterion, IEEE Trans. Industry Applications 26(3), on the closed loop.

    Examples
    --------
    One time constant after a step of 100 N: 100 (1 - 1/e).

    >>> effect = CurrentLoopLag(time_constant_s=1e-3)
    >>> mean, F, G = CurrentLoopLag.kernel(0.0005, 1e-3, 0.0, 0.0, 100.0, *effect.values(), 0.0, 0.0)
    >>> round(F, 4), round(mean, 4)  # mean: 100 / e
    (63.2121, 36.7879)
    """

    port = Port.COMMAND
    rank = 1
    states = ("F", "G")
    amplitude = "time_constant_s"
    cause_type = "delay"
    trace_of = "loop_lag"
    confusable_with = ("axial_compliance", "dead_time")

    time_constant_s: float = parameter("tau", low=0.0, high=0.02, typical=5e-4)
    inverter_ratio: float = parameter("rho", low=0.0, high=0.5, typical=0.25, grid=(0.1, 0.4), default=0.0)

    @kernel
    def kernel(t, h, x, v, u, tau, rho, F, G):
        # Both orders are computed: lanes side by side are vectorised without a branch, and slower with one.
        y = h / tau if tau > 0.0 else 1.0
        decay = exp(-y)
        mean = (1.0 - decay) / y if y > 1e-2 else 1.0 - y * (0.5 - y * (1.0 / 6.0 - y * (1.0 / 24.0 - y / 120.0)))
        behind = F - u
        ratio = max(rho, 1e-9)
        bend = 1.0 - 4.0 * ratio
        equal = abs(bend) < 1e-4
        root = math.sqrt(1.0 if equal else abs(bend))
        m = 0.5 * y / ratio
        d = m * root
        q = m * m * bend
        fast = exp(-(m + d))
        slow = exp(-2.0 * y / (1.0 + root))
        middle = exp(-m)
        sine, cosine = sin_cos(d)
        C = middle * cosine if bend < 0.0 else 0.5 * (slow + fast)
        S = middle * sine / d if bend < 0.0 else 0.5 * (slow - fast) / d
        C = middle * (1.0 + q * (0.5 + q * (1.0 / 24.0 + q / 720.0))) if equal else C
        S = middle * (1.0 + q * (1.0 / 6.0 + q * (1.0 / 120.0 + q / 5040.0))) if equal else S
        turned = m * behind + y * G
        F_end = behind * C + S * turned
        G_end = G * C + S * (m * G - (G + behind) * (y / ratio))
        second = u - (ratio * (G_end - G) + (F_end - behind)) / y
        first = u + behind * mean
        given = second if rho > 0.0 else first
        end = u + (F_end if rho > 0.0 else behind * decay)
        slope = G_end if rho > 0.0 else 0.0
        return (given if tau > 0.0 else u), (end if tau > 0.0 else u), (slope if tau > 0.0 else 0.0)

    def linear_part(self) -> LinearPart:
        tau = self.time_constant_s
        poles = tuple(value for value in (self.inverter_ratio * tau**2, tau) if value > 0.0)
        return LinearPart(denominator=(*poles, 1.0))
