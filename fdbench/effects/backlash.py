"""Backlash: a gap that the motor crosses before the table follows."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    r"""Dead zone of width b in the screw: within it no force passes.

    .. math:: F_s = k (u - g) + c (\dot u - \dot g), \qquad g = \min(\max(u, -b/2), b/2)

    F_s: force that the screw passes on; k and c: its stiffness and damping; u = x_m - x_t: position of the motor side
    minus that of the table. On a rigid axis the table stands still until the gap is crossed (play), so that its scale
    lags behind the motor by b/2 and each reversal loses b. The gap starts centred.

    Validity: with damping the flanks pull for a moment where they part; Nordin, Galic, Gutman (1997), Int. J. Adaptive
    Control and Signal Processing 11, avoid that.

    Source: Nordin, Gutman (2002), Automatica 38(10), a survey of models of backlash.

    Examples
    --------
    Of 12 um of twist, 5 um are the gap; the other 7 um stretch the screw.

    >>> (gap,) = Backlash.kernel(0.0, 1e-4, 0.0, 0.0, 12e-6, *Backlash(gap_m=10e-6).values())
    >>> round(gap * 1e6, 9)
    5.0
    """

    port = Port.TRANSMISSION
    rank = 1
    amplitude = "gap_m"
    starts = (4.0, 16.0)
    cause_type = "play"
    confusable_with = ("axial_compliance", "lugre_friction")

    gap_m: float = parameter("b", low=0.0, high=2e-3, typical=5e-6)

    @kernel
    def kernel(t, h, x, v, u, b):
        return (min(max(u, -0.5 * b), 0.5 * b),)
