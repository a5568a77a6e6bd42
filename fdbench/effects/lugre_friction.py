"""LuGre friction: bristles that bend before the axis slides (presliding), with a Stribeck curve."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self, final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import exp, plus_exp
from fdbench.effects.coulomb_friction import CoulombFriction


@final
@dataclass(frozen=True, kw_only=True)
class LugreFriction(Effect):
    r"""Mean bristle deflection z as an internal state.

    .. math::
        \dot z = v - \frac{\sigma_0 |v|}{g(v)} z, \qquad
        g(v) = F_c + (F_s - F_c)\, e^{-(v/v_s)^2}, \qquad F = \sigma_0 z + \sigma_1 \dot z

    F_c: Coulomb force; F_s: static force; v_s: Stribeck velocity; sigma_0 and sigma_1: stiffness and damping of the
    bristles; g in N, sigma_0 times that of the paper. At constant velocity over a substep z relaxes exactly, so no
    speed or stiffness makes the bristle unstable; the force is its mean. Viscous friction is an effect of its own.

    Source: Canudas de Wit, Olsson, Astrom, Lischinsky (1995), IEEE Trans. Automatic Control 40(3), 419-425.

    Examples
    --------
    In steady sliding well above v_s the force is the Coulomb force.

    >>> effect = LugreFriction.typical(coulomb_force_N=120.0)
    >>> z = 120.0 / effect.bristle_stiffness_N_per_m
    >>> force, slope, z = LugreFriction.kernel(0.0, 1e-4, 0.0, 0.5, 0.0, *effect.values(), z)
    >>> round(force, 9)
    120.0
    """

    port = Port.TABLE_FORCE
    states = ("z",)
    usually_known = True
    amplitude = "coulomb_force_N"
    further_amplitudes = ("static_force_N",)
    confusable_with = ("stribeck_friction", "backlash")

    coulomb_force_N: float = parameter("F_c", low=0.0, high=5000.0, typical=120.0)
    static_force_N: float = parameter("F_s", low=0.0, high=8000.0, typical=150.0, at_least="coulomb_force_N")
    stribeck_velocity_m_per_s: float = parameter("v_s", low=1e-4, high=0.1, typical=3e-3)
    bristle_stiffness_N_per_m: float = parameter(
        "sigma_0", low=1e3, high=1e9, typical=2e7, grid=(2e5, 1e6, 5e6, 2e7, 6e7)
    )
    bristle_damping_N_s_per_m: float = parameter("sigma_1", low=0.0, high=1e6, typical=1e4, grid=(1e4,))

    @classmethod
    def in_place_of(cls, known: Effect, shape: Mapping[str, float] = MappingProxyType({})) -> Self | None:
        """Return bristles with the level of a known Coulomb friction, which bend as far and settle as fast as usual."""
        if not isinstance(known, CoulombFriction) or known.coulomb_force_N <= 0.0:
            return None
        usual, level = cls.typical(), known.coulomb_force_N
        effect = cls.typical(**shape)
        stiffness = effect.bristle_stiffness_N_per_m * level / usual.coulomb_force_N
        damping = stiffness * usual.bristle_damping_N_s_per_m / usual.bristle_stiffness_N_per_m
        bristles = effect.within(bristle_stiffness_N_per_m=stiffness, bristle_damping_N_s_per_m=damping)
        return bristles.changed(coulomb_force_N=level, static_force_N=level)

    @classmethod
    def that_sticks(cls, known: Effect, way_m: float) -> Self | None:
        """Return bristles with the level of a known Coulomb friction that bend over a way."""
        usual = cls.typical()
        bent = usual.within(bristle_stiffness_N_per_m=usual.coulomb_force_N / way_m)
        return cls.in_place_of(known, {"bristle_stiffness_N_per_m": bent.bristle_stiffness_N_per_m})

    @property
    def bend_m(self) -> float:
        """Way over which it bends before it slides, F_c / sigma_0."""
        return self.coulomb_force_N / self.bristle_stiffness_N_per_m

    @kernel
    def kernel(t, h, x, v, u, F_c, F_s, v_s, sigma_0, sigma_1, z):
        ratio = v / v_s
        g = plus_exp(F_c, F_s - F_c, -(ratio * ratio))
        z_steady = g / sigma_0 if v >= 0.0 else -g / sigma_0
        y = min(sigma_0 * abs(v) * h / g, 700.0) if g > 0.0 else 700.0
        decay = exp(-y)
        mean = (1.0 - decay) / y if y > 1e-2 else 1.0 - y * (0.5 - y * (1.0 / 6.0 - y * (1.0 / 24.0 - y / 120.0)))
        distance = z_steady - z
        z_end = z + distance * y * mean
        force = sigma_0 * (z_steady - distance * mean) + sigma_1 * ((z_end - z) / h)
        slope = (0.5 * sigma_0 * h + sigma_1) * decay
        return force, slope, z_end
