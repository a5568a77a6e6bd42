"""Quadratic drag: a force against motion with the square of the velocity."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class QuadraticDrag(Effect):
    r"""Turbulent drag of a guideway's lubricant or of the air.

    .. math:: F(v) = c\, v |v|

    Source: Chou, Duan, Okwudire, A linear hybrid model for enhanced servo error pre-compensation, eq. (12), whose 0.1
    is read in mN, mm and s, though N is printed: 0.1 mN at 1 mm/s is 100 N s^2/m^2.

    Examples
    --------
    >>> effect = QuadraticDrag(quadratic_drag_N_s2_per_m2=100.0)
    >>> QuadraticDrag.kernel(0.0, 1e-4, 0.0, -0.5, 0.0, *effect.values())
    (-25.0, 100.0)
    """

    port = Port.TABLE_FORCE
    amplitude = "quadratic_drag_N_s2_per_m2"
    confusable_with = ("friction_drift",)
    expected_failures: ClassVar[Mapping[str, str]] = {
        "is_named_first": "with friction of a free form in every hypothesis, viscous friction does nearly as much",
    }

    quadratic_drag_N_s2_per_m2: float = parameter("c", low=0.0, high=1e5, typical=500.0)

    @kernel
    def kernel(t, h, x, v, u, c):
        return c * v * abs(v), 2.0 * c * abs(v)
