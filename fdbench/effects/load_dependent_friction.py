"""Load-dependent friction: nut and guideway run harder while they pass on a force."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import tanh


@final
@dataclass(frozen=True, kw_only=True)
class LoadDependentFriction(Effect):
    r"""Friction in proportion to the force that the screw passes on to the table.

    .. math:: F(v) = \mu |F_s| \tanh(v / v_0)

    F_s: that force; on a rigid axis the one that the motor delivers.

    Source: Duclusaud, Passault, Padois, Ly (2025), Extended Friction Models for the Physics Simulation of Servo
    Actuators, IEEE ICRA, the load-dependent term.

    Examples
    --------
    1000 N through the screw and a coefficient of 0.03:

    >>> effect = LoadDependentFriction.typical(friction_coefficient=0.03)
    >>> LoadDependentFriction.kernel(0.0, 1e-4, 0.0, 0.5, -1000.0, *effect.values())
    (30.0, 60.0)
    """

    port = Port.TABLE_FORCE
    amplitude = "friction_coefficient"
    cause_type = "friction_over_load"
    confusable_with = ("stribeck_friction",)

    friction_coefficient: float = parameter("mu", low=0.0, high=0.5, typical=0.03)
    transition_velocity_m_per_s: float = parameter("v_0", low=1e-4, high=0.05, typical=1e-3)

    @kernel
    def kernel(t, h, x, v, u, mu, v_0):
        level = mu * abs(u)
        force = level * tanh(v / v_0)
        slope = force / v if abs(v) > 1e-9 * v_0 else level / v_0
        return force, slope
