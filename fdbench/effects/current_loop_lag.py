"""Current-loop lag: the motor's force follows the command after a time constant."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, LinearPart, Port, kernel, parameter
from fdbench.effects._functions import exp


@final
@dataclass(frozen=True, kw_only=True)
class CurrentLoopLag(Effect):
    r"""First-order lag of the force.

    .. math:: \tau \dot F = F_{asked} - F

    F_asked: force asked of the motor; F: state, the force that it gives. The command is constant over a substep, so
    that F relaxes exactly; its mean is delivered.

    Source: Altintas, Manufacturing Automation (2012), on the loops of a feed drive.

    Examples
    --------
    One time constant after a step of 100 N: 100 (1 - 1/e).

    >>> effect = CurrentLoopLag(time_constant_s=1e-3)
    >>> mean, F = CurrentLoopLag.kernel(0.0005, 1e-3, 0.0, 0.0, 100.0, *effect.values(), 0.0)
    >>> round(F, 4), round(mean, 4)  # mean: 100 / e
    (63.2121, 36.7879)
    """

    port = Port.COMMAND
    rank = 1
    states = ("F",)
    amplitude = "time_constant_s"
    cause_type = "delay"
    trace_of = "loop_lag"
    confusable_with = ("axial_compliance", "dead_time")

    time_constant_s: float = parameter("tau", low=0.0, high=0.02, typical=5e-4)

    @kernel
    def kernel(t, h, x, v, u, tau, F):
        y = h / tau if tau > 0.0 else 1.0
        decay = exp(-y)
        mean = (1.0 - decay) / y if y > 1e-2 else 1.0 - y * (0.5 - y * (1.0 / 6.0 - y * (1.0 / 24.0 - y / 120.0)))
        behind = F - u
        return (u + behind * mean if tau > 0.0 else u), (u + behind * decay if tau > 0.0 else u)

    def linear_part(self) -> LinearPart:
        return LinearPart(denominator=(self.time_constant_s, 1.0) if self.time_constant_s > 0.0 else (1.0,))
