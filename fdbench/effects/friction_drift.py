"""Friction drift: a cold axis runs harder until it has warmed up."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import exp, tanh


@final
@dataclass(frozen=True, kw_only=True)
class FrictionDrift(Effect):
    r"""Extra Coulomb friction at the start of the record that dies away while the grease warms up.

    .. math:: F(v) = F_w\, e^{-c/\tau} \tanh(v / v_0), \qquad c = (1 - w)\, t + w \int_0^t |v| / v_w \,\mathrm{d}t

    t: time from the start of the record; c: the same where an axis warms up by itself (w = 0), and the way run over a
    usual speed v_w where it warms up by its own motion (w = 1), as by the heat of friction. A negative force is
    friction that grows. Re-calibration absorbs the mean, so only the change counts.

    Source: Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7); the laws are ours.

    Examples
    --------
    >>> effect = FrictionDrift.typical(cold_force_N=20.0, warm_up_time_s=10.0)
    >>> force, slope, clock = FrictionDrift.kernel(10.0, 1e-4, 0.0, 0.1, 0.0, *effect.values(), 0.0)
    >>> round(force, 4)  # 20 / e
    7.3576
    """

    port = Port.TABLE_FORCE
    states = ("s",)
    amplitude = "cold_force_N"
    cause_type = "friction_over_time"
    confusable_with = ("position_dependent_friction", "stribeck_friction", "quadratic_drag")

    cold_force_N: float = parameter("F_w", low=-500.0, high=500.0, typical=24.0)
    warm_up_time_s: float = parameter("tau", low=0.1, high=1e5, typical=10.0, grid=(3.0, 10.0, 60.0))
    transition_velocity_m_per_s: float = parameter("v_0", low=1e-4, high=0.05, typical=1e-3)
    share_of_motion: float = parameter("w", low=0.0, high=1.0, typical=0.0, grid=(0.0, 0.5, 1.0), default=0.0)
    usual_velocity_m_per_s: float = parameter("v_w", low=1e-4, high=10.0, typical=0.1, default=0.1)

    @kernel
    def kernel(t, h, x, v, u, F_w, tau, v_0, w, v_w, s):
        s += abs(v) * h
        level = F_w * exp(-((1.0 - w) * t + w * (s / v_w)) / tau)
        force = level * tanh(v / v_0)
        slope = force / v if abs(v) > 1e-9 * v_0 else level / v_0
        return force, max(slope, 0.0), s
