"""Direction-dependent friction: the axis runs harder one way than the other."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import tanh


@final
@dataclass(frozen=True, kw_only=True)
class DirectionDependentFriction(Effect):
    r"""Viscous and Coulomb friction that are larger by an asymmetry forwards and smaller by it backwards.

    .. math:: F(v) = B_a v \tanh(v / v_0) + C_a \tanh^2(v / v_0)

    Beside a nominal friction B v + C sgn v the axis has B + B_a and C + C_a forwards, B - B_a and C - C_a backwards.
    Unlike a constant force it is none at rest.

    Source: Janot, Gautier, Brunot (2019), Data Set and Reference Models of EMPS, the model with direction-dependent
    friction: four parameters, viscous and Coulomb in each direction.

    Examples
    --------
    >>> effect = DirectionDependentFriction.typical(viscous_asymmetry_N_s_per_m=20.0, coulomb_asymmetry_N=4.0)
    >>> DirectionDependentFriction.kernel(0.0, 1e-4, 0.0, 0.5, 0.0, *effect.values())[0]  # 20 * 0.5 + 4
    14.0
    >>> DirectionDependentFriction.kernel(0.0, 1e-4, 0.0, -0.5, 0.0, *effect.values())[0]
    14.0
    """

    port = Port.TABLE_FORCE
    amplitude = "viscous_asymmetry_N_s_per_m"
    further_amplitudes = ("coulomb_asymmetry_N",)
    confusable_with = ("constant_force",)

    viscous_asymmetry_N_s_per_m: float = parameter("B_a", low=-2000.0, high=2000.0, typical=20.0)
    coulomb_asymmetry_N: float = parameter("C_a", low=-200.0, high=200.0, typical=5.0)
    transition_velocity_m_per_s: float = parameter("v_0", low=1e-4, high=0.05, typical=1e-3)

    @kernel
    def kernel(t, h, x, v, u, B_a, C_a, v_0):
        s = tanh(v / v_0)
        rise = (1.0 - s * s) / v_0
        slope = B_a * (s + v * rise) + 2.0 * C_a * s * rise
        return B_a * v * s + C_a * s * s, max(slope, 0.0)
