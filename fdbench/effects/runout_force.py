"""Run-out force: what radial run-out of the tool adds to the tooth-passing force."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects.tooth_passing_force import TURN, cutting_force


@final
@dataclass(frozen=True, kw_only=True)
class RunoutForce(Effect):
    r"""Milling force with run-out minus the force without it.

    Teeth 0, 2, ... cut a chip thicker by e, teeth 1, 3, ... one thinner by e,

    .. math:: h_j = f_t \sin\varphi_j \pm e, \qquad F = \sum_{h_j > 0} F(h_j) - \sum_j F(h_j)|_{e = 0}

    over the engaged teeth, with the feed per tooth :math:`f_t = |v| / (f_s N_t)`, the angle :math:`\varphi_j` of tooth
    j and its force F(h) as in ``tooth_passing_force``, whose cutting parameters these are. So the force repeats with
    every second tooth, for two teeth once per turn.

    Validity: two teeth. With more, a tool that runs out off centre thickens each chip by another amount; a chip that
    a tooth misses is not left for the next one.

    Source: Kline, DeVor (1983), Int. J. Machine Tool Design and Research 23, on run-out in end milling.

    Examples
    --------
    Tooth 0 at 90 degrees, tooth 1 out of the cut: minus axial depth times radial coefficient times run-out,
    1.5 mm * 168.8 MPa * 10 um.

    >>> effect = RunoutForce.typical(teeth=2.0, spindle_frequency_Hz=50.0, radial_runout_m=1e-5)
    >>> force, slope = RunoutForce.kernel(0.005, 1e-5, 0.0, 0.01, 0.0, *effect.values())
    >>> round(force, 6)
    -2.532
    """

    port = Port.TABLE_FORCE
    amplitude = "radial_runout_m"
    starts = (2.0, 4.0)  # beyond the feed a tooth cuts nothing, and a fit from below stops short
    confusable_with = ("tooth_passing_force",)
    disturbance = True
    of_any_axis = True
    follows_command = True

    expected_failures: ClassVar[Mapping[str, str]] = {
        "is_resolved_around_its_typical_size": "a tooth enters and leaves the cut from one instant to the next",
        "converges_at_second_order": "a tooth enters and leaves the cut from one instant to the next",
    }

    radial_runout_m: float = parameter("e", low=0.0, high=2e-4, typical=1e-5)
    teeth: float = parameter("N_t", low=1.0, high=12.0, typical=2.0, whole=True)
    spindle_frequency_Hz: float = parameter("f_s", low=0.1, high=1000.0, typical=50.0, locate="line_of_motion")
    axial_depth_m: float = parameter("a_p", low=0.0, high=0.05, typical=1.5e-3)
    tangential_cutting_Pa: float = parameter("K_tc", low=0.0, high=1e10, typical=796.1e6)
    radial_cutting_Pa: float = parameter("K_rc", low=0.0, high=1e10, typical=168.8e6)
    tangential_edge_N_per_m: float = parameter("K_te", low=0.0, high=1e6, typical=27.7e3)
    radial_edge_N_per_m: float = parameter("K_re", low=0.0, high=1e6, typical=30.8e3)
    entry_angle_rad: float = parameter("phi_in", low=0.0, high=TURN, typical=0.0)
    exit_angle_rad: float = parameter("phi_out", low=0.0, high=TURN, typical=math.pi)
    direction_rad: float = parameter("theta", low=-TURN, high=TURN, typical=0.0)
    angle_rad: float = parameter("phi_0", low=-TURN, high=TURN, typical=0.0, default=0.0, phase=True)
    frequency_drift_Hz_per_s: float = parameter("r", low=-10.0, high=10.0, typical=0.0, default=0.0)

    @kernel
    def kernel(t, h, x, v, u, e, N_t, f_s, a_p, K_tc, K_rc, K_te, K_re, phi_in, phi_out, theta, phi_0, r):
        turned = t + 0.5 * r / f_s * t * t
        _, extra = cutting_force(turned, v, N_t, f_s, a_p, K_tc, K_rc, K_te, K_re, phi_in, phi_out, theta, phi_0, e)
        return extra, 0.0
