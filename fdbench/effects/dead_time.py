"""Dead time: bus and inverter pass the command on late."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, LinearPart, Port, kernel, parameter

LATE = float("nan")


@kernel
def passed(seen, changed, h):
    """Return the share of a substep, of which ``seen`` is the end, that lies after a change of the command."""
    return min(max((seen - changed) / h, 0.0), 1.0)


@kernel
def followed(force, value, share):
    """Return the mean force after a change to ``value`` that holds for a share of the substep."""
    return value if share >= 1.0 else force + (value - force) * share


@final
@dataclass(frozen=True, kw_only=True)
class DeadTime(Effect):
    r"""Pure delay of the held command, of any fraction of the control period.

    .. math:: F(t) = F_{asked}(t - t_d)

    F: force delivered; F_asked: force asked of the motor. The last six changes of the command are kept with their
    times; the force is the exact mean over the substep.

    Validity: a delay that spans more than six changes gives no number (NaN), and the axis counts as diverged.

    Source: Astrom, Wittenmark (1997), Computer-Controlled Systems, on sampled systems with a time delay.

    Examples
    --------
    A step that arrives after 0.25 of a substep counts for three quarters of it.

    >>> effect = DeadTime(dead_time_s=0.00025)
    >>> force, *states = DeadTime.kernel(0.0005, 1e-3, 0.0, 0.0, 100.0, *effect.values(), *[0.0] * 13)
    >>> round(force, 9)
    75.0
    """

    port = Port.COMMAND
    states = ("c_0", "c_1", "c_2", "c_3", "c_4", "c_5", "c_6", "s_1", "s_2", "s_3", "s_4", "s_5", "s_6")
    amplitude = "dead_time_s"
    cause_type = "delay"
    trace_of = "loop_lag"
    confusable_with = ("current_loop_lag",)

    dead_time_s: float = parameter("t_d", low=0.0, high=1e-2, typical=5e-4)

    @kernel
    def kernel(t, h, x, v, u, t_d, c_0, c_1, c_2, c_3, c_4, c_5, c_6, s_1, s_2, s_3, s_4, s_5, s_6):
        # c_6 is the newest value and began at s_6; c_0 is the one before s_1.
        start = t - 0.5 * h
        new = u != c_6
        lost = new and c_0 != c_1 and start - t_d < s_1
        c_0, c_1, c_2, c_3 = (c_1 if new else c_0), (c_2 if new else c_1), (c_3 if new else c_2), (c_4 if new else c_3)
        c_4, c_5, c_6 = (c_5 if new else c_4), (c_6 if new else c_5), u
        s_1, s_2, s_3 = (s_2 if new else s_1), (s_3 if new else s_2), (s_4 if new else s_3)
        s_4, s_5, s_6 = (s_5 if new else s_4), (s_6 if new else s_5), (start if new else s_6)
        seen = start + h - t_d
        force = followed(c_0, c_1, passed(seen, s_1, h))
        force = followed(force, c_2, passed(seen, s_2, h))
        force = followed(force, c_3, passed(seen, s_3, h))
        force = followed(force, c_4, passed(seen, s_4, h))
        force = followed(force, c_5, passed(seen, s_5, h))
        force = followed(force, c_6, passed(seen, s_6, h))
        force = LATE if lost else force
        return (force if t_d > 0.0 else u), c_0, c_1, c_2, c_3, c_4, c_5, c_6, s_1, s_2, s_3, s_4, s_5, s_6

    def linear_part(self) -> LinearPart:
        return LinearPart(delay_s=self.dead_time_s)
