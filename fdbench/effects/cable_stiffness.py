"""Cable stiffness: the cable chain pulls the table back and rubs while it bends."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, LinearPart, Port, kernel, parameter
from fdbench.effects._functions import exp


@final
@dataclass(frozen=True, kw_only=True)
class CableStiffness(Effect):
    r"""Spring to the origin, which may stiffen with the way, and Dahl friction of the bending chain.

    .. math:: F = k x + \kappa\, x |x| + F_d z, \qquad \dot z = (v - |v| z) / x_d

    with the state z, between -1 and 1. At constant velocity over a substep z relaxes exactly; its mean gives the force.

    Source: Dahl (1968), A solid friction model, The Aerospace Corporation, with exponent 1; how the spring
    stiffens is ours.

    Examples
    --------
    One distance x_d after the start the Dahl part has reached 1 - 1/e of its force.

    >>> effect = CableStiffness.typical(spring_stiffness_N_per_m=0.0, dahl_force_N=10.0, dahl_distance_m=0.005)
    >>> force, slope, z = CableStiffness.kernel(0.0, 0.01, 0.0, 0.5, 0.0, *effect.values(), 0.0)
    >>> round(z, 4)
    0.6321
    """

    port = Port.TABLE_FORCE
    states = ("z",)
    amplitude = "spring_stiffness_N_per_m"
    cause_type = "force_over_position"
    further_amplitudes = ("dahl_force_N", "stiffening_N_per_m2")
    needs_amplitude = True  # a chain that rubs pulls too; what rubs alone is friction of another law
    confusable_with = ("thermal_expansion", "link_gravity")

    spring_stiffness_N_per_m: float = parameter("k", low=0.0, high=1e5, typical=200.0)
    dahl_force_N: float = parameter("F_d", low=0.0, high=500.0, typical=8.0)
    dahl_distance_m: float = parameter("x_d", low=1e-4, high=0.1, typical=5e-3)
    stiffening_N_per_m2: float = parameter("kappa", low=0.0, high=1e6, typical=100.0, default=0.0)

    @kernel
    def kernel(t, h, x, v, u, k, F_d, x_d, kappa, z):
        z_steady = 1.0 if v >= 0.0 else -1.0
        y = abs(v) * h / x_d
        decay = exp(-y)
        mean = (1.0 - decay) / y if y > 1e-2 else 1.0 - y * (0.5 - y * (1.0 / 6.0 - y * (1.0 / 24.0 - y / 120.0)))
        distance = z_steady - z
        force = (k + kappa * abs(x)) * x + F_d * (z_steady - distance * mean)
        return force, 0.5 * F_d * h / x_d * decay, z + distance * y * mean

    def linear_part(self) -> LinearPart:
        return LinearPart(numerator=(self.spring_stiffness_N_per_m,), denominator=(1.0, 0.0))
