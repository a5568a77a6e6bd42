"""Coulomb friction: a constant force against motion."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import tanh


@final
@dataclass(frozen=True, kw_only=True)
class CoulombFriction(Effect):
    r"""Constant force against motion, smoothed through zero velocity.

    .. math:: F(v) = F_c \tanh(v / v_0)

    A negative value means that the nominal friction is too large. The slope handed to the integrator is the
    secant F/v, so that the axis creeps to a stop and never chatters.

    Source: Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7); smoothing: Andersson, Soderberg,
    Bjorklund (2007), Tribology International 40.

    Examples
    --------
    >>> effect = CoulombFriction(coulomb_force_N=40.0, transition_velocity_m_per_s=0.001)
    >>> force, slope = CoulombFriction.kernel(0.0, 1e-4, 0.0, -0.5, 0.0, *effect.values())
    >>> force, slope
    (-40.0, 80.0)
    """

    port = Port.TABLE_FORCE
    amplitude = "coulomb_force_N"
    calibrates = "known_effects"
    usually_known = True
    confusable_with = ("motor_coulomb_friction",)

    coulomb_force_N: float = parameter("F_c", low=-1000.0, high=5000.0, typical=60.0)
    transition_velocity_m_per_s: float = parameter("v_0", low=1e-5, high=0.05, typical=1e-3)

    @kernel
    def kernel(t, h, x, v, u, F_c, v_0):
        force = F_c * tanh(v / v_0)
        slope = force / v if abs(v) > 1e-9 * v_0 else F_c / v_0
        return force, max(slope, 0.0)
