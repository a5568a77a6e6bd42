"""Step force: a constant force from one instant on."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class StepForce(Effect):
    r"""Force that steps from zero to a constant, as a tool that begins to cut.

    .. math:: F(t) = F_0 \text{ for } t \ge t_0, \text{ else } 0

    The kernel returns the mean over its substep, so that the impulse is right wherever the step falls.

    Source: Salehi (2013), sections 3.7 and 4.4: 100 N.

    Examples
    --------
    A step at a quarter of a substep of 1 ms acts over the rest of it.

    >>> effect = StepForce(step_force_N=100.0, start_s=0.50025)
    >>> force, slope = StepForce.kernel(0.5005, 1e-3, 0.0, 0.0, 0.0, *effect.values())
    >>> round(force, 6), StepForce.kernel(0.4995, 1e-3, 0.0, 0.0, 0.0, *effect.values())
    (75.0, (0.0, 0.0))
    """

    port = Port.TABLE_FORCE
    amplitude = "step_force_N"
    cause_type = "process_force"
    disturbance = True

    step_force_N: float = parameter("F_0", low=-5000.0, high=5000.0, typical=100.0)
    start_s: float = parameter("t_0", low=0.0, high=1e6, typical=0.5)

    @kernel
    def kernel(t, h, x, v, u, F_0, t_0):
        share = min(max((t - t_0) / h + 0.5, 0.0), 1.0)
        return F_0 * share, 0.0
