"""Stribeck friction: extra resistance near standstill that falls as the axis starts to slide."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import exp, tanh
from fdbench.effects.lugre_friction import LugreFriction


@final
@dataclass(frozen=True, kw_only=True)
class StribeckFriction(Effect):
    r"""The part of steady friction above the Coulomb level.

    .. math:: F(v) = F_d\, e^{-(v/v_s)^2} \tanh(v / v_0), \qquad F_d = F_s - F_c

    F_d: by how much the static force F_s exceeds the Coulomb force F_c, which is an effect of its own.

    Source: Stribeck (1902), Z. Verein Deutscher Ingenieure 46; Armstrong-Helouvry, Dupont, Canudas de Wit (1994),
    Automatica 30(7), for the curve, here with exponent 2.

    Examples
    --------
    At v_s, 20 times v_0, hardly less than 40 N / e is left.

    >>> effect = StribeckFriction.typical(stribeck_force_N=40.0, stribeck_velocity_m_per_s=0.01)
    >>> force, slope = StribeckFriction.kernel(0.0, 1e-4, 0.0, 0.01, 0.0, *effect.values())
    >>> round(force, 4)
    14.7152
    """

    port = Port.TABLE_FORCE
    amplitude = "stribeck_force_N"
    confusable_with = ("position_dependent_friction", "friction_drift", "load_dependent_friction", "lugre_friction")

    stribeck_force_N: float = parameter("F_d", low=0.0, high=2000.0, typical=40.0)
    stribeck_velocity_m_per_s: float = parameter("v_s", low=1e-4, high=0.1, typical=3e-3, grid=(1e-3, 3e-3, 1e-2))
    transition_velocity_m_per_s: float = parameter("v_0", low=1e-5, high=0.05, typical=5e-4)

    def joined_to(self, known: Effect) -> Effect | None:
        r"""Return known bristles that hold the static force, too, before they slide.

        .. math:: F_s' = F_s + F_d, \qquad v_s' = \frac{(F_s - F_c) v_s + F_d v_d}{F_s - F_c + F_d}

        with those of the bristles, and v_d, the Stribeck velocity of this one.
        """
        if not isinstance(known, LugreFriction):
            return None
        own, added = max(known.static_force_N - known.coulomb_force_N, 0.0), self.stribeck_force_N
        if added == 0.0:
            return known
        speeds = own * known.stribeck_velocity_m_per_s + added * self.stribeck_velocity_m_per_s
        return known.within(
            static_force_N=known.static_force_N + added, stribeck_velocity_m_per_s=speeds / (own + added)
        )

    @kernel
    def kernel(t, h, x, v, u, F_d, v_s, v_0):
        ratio = v / v_s
        force = F_d * exp(-(ratio * ratio)) * tanh(v / v_0)
        slope = force / v if abs(v) > 1e-9 * v_0 else F_d / v_0
        return force, slope
