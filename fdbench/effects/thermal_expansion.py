"""Thermal expansion: the screw grows while it warms up, and carries the table along."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import exp


@final
@dataclass(frozen=True, kw_only=True)
class ThermalExpansion(Effect):
    r"""Growth of the screw away from its fixed bearing at x_b.

    .. math:: x_t - x_m = \alpha\, \Delta T\, (1 - e^{-c/\tau})\, (x_m - x_b),
        \qquad c = (1 - w)\, t + w \int_0^t |v| / v_w \,\mathrm{d}t

    x_t: position of the table; x_m: that of the motor side; Delta T: rise of the screw's temperature in the end; t:
    time from the start of the record; c: the same where heat comes from elsewhere (w = 0), and the way run over a usual
    speed v_w where it comes from the motion (w = 1). Steel expands by 11.5 um/(m K).

    Source: Weck, McKeown, Bonse, Herbst (1995), CIRP Annals 44(2), on thermal errors of machine tools; one constant, of
    time or of the way, is our choice.

    Examples
    --------
    Fully warmed by 2 K, half a metre from the bearing: 11.5 um.

    >>> effect = ThermalExpansion.typical(temperature_rise_K=2.0, warm_up_time_s=1.0, fixed_bearing_m=-0.1)
    >>> behind, way = ThermalExpansion.kernel(100.0, 1e-4, 0.4, 0.0, 0.0, *effect.values(), 0.0)
    >>> round(-behind * 1e6, 9)
    11.5
    """

    port = Port.TRANSMISSION
    states = ("s",)
    amplitude = "temperature_rise_K"
    cause_type = "sensor"
    confusable_with = ("cable_stiffness", "lead_error")

    temperature_rise_K: float = parameter("dT", low=-50.0, high=50.0, typical=4.0)
    warm_up_time_s: float = parameter("tau", low=0.1, high=1e5, typical=10.0, grid=(3.0, 10.0, 60.0))
    fixed_bearing_m: float = parameter("x_b", low=-5.0, high=5.0, typical=-0.2, grid=(-0.2,))
    expansion_per_K: float = parameter("alpha", low=1e-6, high=3e-5, typical=1.15e-5)
    share_of_motion: float = parameter("w", low=0.0, high=1.0, typical=0.0, grid=(0.0, 0.5, 1.0), default=0.0)
    usual_velocity_m_per_s: float = parameter("v_w", low=1e-4, high=10.0, typical=0.1, default=0.1)

    @kernel
    def kernel(t, h, x, v, u, dT, tau, x_b, alpha, w, v_w, s):
        s += abs(v) * h
        warm = 1.0 - exp(-((1.0 - w) * t + w * (s / v_w)) / tau)
        return -(alpha * dT * warm * (x - x_b)), s
