"""Tooth-passing force: mechanistic milling force of a tool without run-out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import sin_cos

PI, TURN = math.pi, 2.0 * math.pi
SMALLEST_CHIP_M = 1e-9


@kernel
def one_tooth(j, force, extra, share, s, c, N_t, s_step, c_step, f_t, e, a, b, a_e, b_e, phi_in, phi_out):
    """Add the force of tooth j at a share of a turn, of which s and c are sine and cosine, and turn to the next one."""
    phi = TURN * share
    smooth = f_t * s
    chip = smooth + e
    along = a * c + b * s
    edge = a_e * c + b_e * s
    engaged = (j < N_t) & (phi_in < phi < phi_out)
    without = smooth * along + edge if engaged & (smooth > 0.0) else 0.0
    force += without
    extra += (chip * along + edge if engaged & (chip > 0.0) else 0.0) - without
    share += 1.0 / N_t
    return force, extra, (share - 1.0 if share >= 1.0 else share), s * c_step + c * s_step, c * c_step - s * s_step


@kernel
def four_teeth(j, force, extra, share, s, c, N_t, s_step, c_step, f_t, e, a, b, a_e, b_e, phi_in, phi_out):
    """Add the forces of teeth j to j + 3; a loop over them would keep lanes from running side by side."""
    force, extra, share, s, c = one_tooth(
        j, force, extra, share, s, c, N_t, s_step, c_step, f_t, e, a, b, a_e, b_e, phi_in, phi_out
    )
    force, extra, share, s, c = one_tooth(
        j + 1, force, extra, share, s, c, N_t, s_step, c_step, f_t, -e, a, b, a_e, b_e, phi_in, phi_out
    )
    force, extra, share, s, c = one_tooth(
        j + 2, force, extra, share, s, c, N_t, s_step, c_step, f_t, e, a, b, a_e, b_e, phi_in, phi_out
    )
    force, extra, share, s, c = one_tooth(
        j + 3, force, extra, share, s, c, N_t, s_step, c_step, f_t, -e, a, b, a_e, b_e, phi_in, phi_out
    )
    return force, extra, share, s, c


@kernel
def cutting_force(t, v, N_t, f_s, a_p, K_tc, K_rc, K_te, K_re, phi_in, phi_out, theta, phi_0, e):
    """Return the force (N) along the axis of all engaged teeth, and what run-out adds: tooth j by e or, odd, by -e."""
    f_t = abs(v) / (f_s * N_t)
    turns = f_s * t + phi_0 / TURN
    share = turns - math.floor(turns)
    s, c = sin_cos(TURN * share)
    s_step, c_step = sin_cos(TURN / N_t)
    s_theta, c_theta = sin_cos(theta)
    a = -a_p * (K_tc * c_theta + K_rc * s_theta)
    b = a_p * (K_tc * s_theta - K_rc * c_theta)
    a_e = -a_p * (K_te * c_theta + K_re * s_theta)
    b_e = a_p * (K_te * s_theta - K_re * c_theta)
    force, extra, share, s, c = four_teeth(
        0, 0.0, 0.0, share, s, c, N_t, s_step, c_step, f_t, e, a, b, a_e, b_e, phi_in, phi_out
    )
    if N_t > 4.0:
        force, extra, share, s, c = four_teeth(
            4, force, extra, share, s, c, N_t, s_step, c_step, f_t, e, a, b, a_e, b_e, phi_in, phi_out
        )
    if N_t > 8.0:
        force, extra, share, s, c = four_teeth(
            8, force, extra, share, s, c, N_t, s_step, c_step, f_t, e, a, b, a_e, b_e, phi_in, phi_out
        )
    sign = (1.0 if v >= 0.0 else -1.0) if f_t > SMALLEST_CHIP_M else 0.0
    return sign * force, sign * extra


@final
@dataclass(frozen=True, kw_only=True)
class ToothPassingForce(Effect):
    r"""Sum over the engaged teeth of a milling cutter that feeds along the axis.

    .. math::
        h_j = \frac{|v|}{f_s N_t} \sin\varphi_j, \quad
        \varphi_j = 2 \pi (f_s t + \tfrac12 r t^2 + j / N_t) + \varphi_0, \quad
        F_t = a_p (K_{tc} h_j + K_{te}), \quad F_r = a_p (K_{rc} h_j + K_{re}),

    .. math:: F = \sum_j \cos\theta (-F_t \cos\varphi_j - F_r \sin\varphi_j)
                       + \sin\theta (F_t \sin\varphi_j - F_r \cos\varphi_j)

    where v is the commanded feed: what the axis swings about it returns with the next tooth and cancels in the chip.
    The sum runs over the teeth with :math:`\varphi_{in} < \varphi_j < \varphi_{out}`; h is the chip thickness, F_t and
    F_r the tangential and radial force on a tooth, :math:`\varphi_0` the angle of the tool at t = 0, r its drift.
    The direction
    :math:`\theta` is 0 along the feed and :math:`\pi/2` across it. F turns its sign with v and is 0 at standstill. Like
    every force of its port it counts against motion: in a slot its mean is negative, so that it draws the table on.

    Source: Altintas, Manufacturing Automation (2012), chapter 2, mechanics of milling.

    Examples
    --------
    One tooth at 90 degrees, full chip of 0.01 m/s / 10 Hz = 1 mm: minus the radial force, 1.5 mm * 168.8 MPa * 1 mm.

    >>> shape = {"teeth": 1.0, "spindle_frequency_Hz": 10.0, "axial_depth_m": 1.5e-3, "radial_edge_N_per_m": 0.0}
    >>> effect = ToothPassingForce.typical(**shape)
    >>> force, slope = ToothPassingForce.kernel(0.025, 1e-5, 0.0, 0.01, 0.0, *effect.values())
    >>> round(force, 6)
    -253.2
    """

    port = Port.TABLE_FORCE
    amplitude = "axial_depth_m"
    confusable_with = ("periodic_force", "runout_force")
    disturbance = True
    of_any_axis = True
    follows_command = True

    teeth: float = parameter("N_t", low=1.0, high=12.0, typical=2.0, grid=(1.0, 2.0, 3.0, 4.0), whole=True)
    spindle_frequency_Hz: float = parameter("f_s", low=0.1, high=1000.0, typical=50.0, locate="line_of_motion")
    axial_depth_m: float = parameter("a_p", low=0.0, high=0.05, typical=1e-4)
    tangential_cutting_Pa: float = parameter("K_tc", low=0.0, high=1e10, typical=796.1e6)
    radial_cutting_Pa: float = parameter("K_rc", low=0.0, high=1e10, typical=168.8e6)
    tangential_edge_N_per_m: float = parameter("K_te", low=0.0, high=1e6, typical=27.7e3)
    radial_edge_N_per_m: float = parameter("K_re", low=0.0, high=1e6, typical=30.8e3)
    entry_angle_rad: float = parameter("phi_in", low=0.0, high=TURN, typical=0.0)
    exit_angle_rad: float = parameter("phi_out", low=0.0, high=TURN, typical=math.pi)
    direction_rad: float = parameter("theta", low=-TURN, high=TURN, typical=0.0)
    angle_rad: float = parameter(
        "phi_0", low=-TURN, high=TURN, typical=0.0, default=0.0, phase=True, grid=(0.0, 0.5 * PI, PI, -0.5 * PI)
    )

    @classmethod
    def shape(cls, point: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters: the line that is located is that of the teeth, and so is the angle."""
        pitch = {name: point[name] / point["teeth"] for name in ("spindle_frequency_Hz", "angle_rad")}
        return {**point, **pitch}

    frequency_drift_Hz_per_s: float = parameter("r", low=-10.0, high=10.0, typical=0.0, default=0.0)

    @kernel
    def kernel(t, h, x, v, u, N_t, f_s, a_p, K_tc, K_rc, K_te, K_re, phi_in, phi_out, theta, phi_0, r):
        turned = t + 0.5 * r / f_s * t * t
        force, _ = cutting_force(turned, v, N_t, f_s, a_p, K_tc, K_rc, K_te, K_re, phi_in, phi_out, theta, phi_0, 0.0)
        return force, 0.0
