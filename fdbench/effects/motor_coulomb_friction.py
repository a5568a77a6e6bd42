"""Coulomb friction of motor, bearings and screw, in front of what is elastic."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import tanh


@final
@dataclass(frozen=True, kw_only=True)
class MotorCoulombFriction(Effect):
    r"""Constant force against the motion of the motor side, which does not stretch the screw.

    .. math:: F(v_m) = F_m \tanh(v_m / v_0)

    No data sheet divides friction between guide and motor: the diagnosis lets every hypothesis move a part of what is
    known from the table to the motor, within limits.

    Source: Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7).

    Examples
    --------
    >>> effect = MotorCoulombFriction(motor_coulomb_force_N=20.0, transition_velocity_m_per_s=0.001)
    >>> force, slope = MotorCoulombFriction.kernel(0.0, 1e-4, 0.0, -0.5, 0.0, *effect.values())
    >>> force, slope
    (-20.0, 40.0)
    """

    port = Port.MOTOR_FORCE
    amplitude = "motor_coulomb_force_N"
    calibrates = "friction_side"
    needs_screw = True
    confusable_with = ("coulomb_friction",)
    expected_failures: ClassVar[Mapping[str, str]] = {
        "is_named_first": "a nominal parameter, which at twice its typical size is within its uncertainty on that axis",
    }

    motor_coulomb_force_N: float = parameter("F_m", low=-1000.0, high=5000.0, typical=30.0)
    transition_velocity_m_per_s: float = parameter("v_0", low=1e-5, high=0.05, typical=1e-3)

    @kernel
    def kernel(t, h, x, v, u, F_m, v_0):
        force = F_m * tanh(v / v_0)
        slope = force / v if abs(v) > 1e-9 * v_0 else F_m / v_0
        return force, max(slope, 0.0)
