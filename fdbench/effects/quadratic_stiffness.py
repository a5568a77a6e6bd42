"""Quadratic stiffness: a restoring force with the square of the position, such as that of a cable carrier."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class QuadraticStiffness(Effect):
    r"""Restoring force that stiffens with the distance from the origin.

    .. math:: F(x) = \kappa\, x |x|

    Source: Chou, Duan, Okwudire, A linear hybrid model for enhanced servo error pre-compensation, eq. (12), whose 1 is
    read in mN and mm, though N is printed: 1 mN at 1 mm is 1000 N/m^2.

    Examples
    --------
    >>> effect = QuadraticStiffness(quadratic_stiffness_N_per_m2=1000.0)
    >>> QuadraticStiffness.kernel(0.0, 1e-4, -0.5, 0.0, 0.0, *effect.values())
    (-250.0, 0.0)
    """

    port = Port.TABLE_FORCE
    amplitude = "quadratic_stiffness_N_per_m2"
    cause_type = "force_over_position"

    quadratic_stiffness_N_per_m2: float = parameter("kappa", low=0.0, high=1e6, typical=1e3)

    @kernel
    def kernel(t, h, x, v, u, kappa):
        return kappa * x * abs(x), 0.0
