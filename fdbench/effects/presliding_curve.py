"""Presliding curve: by how much friction that bends before it slides differs from its nominal curve over the way."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import exp


@final
@dataclass(frozen=True, kw_only=True)
class PreslidingCurve(Effect):
    r"""Springs that slip, in place of a part of the nominal bristles.

    .. math::
        F = \sum_{k=0}^{2} a_k (p_k - y), \qquad
        \dot p_k = \frac{v}{b_k} \text{ within } |p_k| \le 1, \quad b_k = 3^{1 - k} b, \qquad
        \dot y = \frac{v - |v| y}{b}

    p_k: bend of a spring that slips, as in Maxwell's slip model; y: that of the nominal bristles (Dahl's); b: way over
    which these bend, their Coulomb force over their stiffness. Both are 1 where they slide, so that nothing is left of
    it in steady sliding. No law of presliding is that of a real contact, so the diagnosis lets every hypothesis whose
    friction bends have such a deviation, within limits. At constant velocity over a substep bends are exact; the force
    is that of their mean, of slips between both ends.

    Source: Al-Bender, Lampaert, Swevers (2005), IEEE Trans. Automatic Control 50(11), 1883-1887, for hysteresis as a
    sum of slips; the basis is ours.

    Examples
    --------
    A spring of three times the way lags behind at the start of a stroke, and not at all in sliding.

    >>> effect = PreslidingCurve.typical(soft_force_N=10.0, way_m=1e-5)
    >>> force, *_ = PreslidingCurve.kernel(0.0, 1e-4, 0.0, 0.1, 0.0, *effect.values(), 0.0, 0.0, 0.0, 0.0)
    >>> round(force, 3)
    -2.012
    >>> force, *_ = PreslidingCurve.kernel(0.0, 1e-4, 0.0, 0.1, 0.0, *effect.values(), 1.0, 1.0, 1.0, 1.0)
    >>> round(force, 9)
    0.0
    """

    port = Port.TABLE_FORCE
    states = ("y", "p_0", "p_1", "p_2")
    amplitude = "soft_force_N"
    further_amplitudes = ("middle_force_N", "stiff_force_N")
    calibrates = "friction_form"
    expected_failures: ClassVar[Mapping[str, str]] = {
        "is_named_first": "a nominal parameter of an axis whose friction bends, and else nothing",
    }

    soft_force_N: float = parameter("a_0", low=-5000.0, high=5000.0, typical=5.0)
    middle_force_N: float = parameter("a_1", low=-5000.0, high=5000.0, typical=0.0)
    stiff_force_N: float = parameter("a_2", low=-5000.0, high=5000.0, typical=0.0)
    way_m: float = parameter("b", low=1e-9, high=1.0, typical=6e-6)

    @kernel
    def kernel(t, h, x, v, u, a_0, a_1, a_2, b, y, p_0, p_1, p_2):
        side, bend = (1.0 if v >= 0.0 else -1.0), v * h / b
        way = min(abs(bend), 100.0)
        past = exp(-way)
        mean = (1.0 - past) / way if way > 1e-4 else 1.0 - 0.5 * way
        bristles = side + (y - side) * mean
        soft, middle, stiff = p_0 + bend / 3.0, p_1 + bend, p_2 + bend * 3.0
        q_0, q_1, q_2 = min(max(soft, -1.0), 1.0), min(max(middle, -1.0), 1.0), min(max(stiff, -1.0), 1.0)
        force = a_0 * (0.5 * (p_0 + q_0) - bristles) + a_1 * (0.5 * (p_1 + q_1) - bristles)
        force += a_2 * (0.5 * (p_2 + q_2) - bristles)
        rate = (a_0 / 3.0 if q_0 == soft else 0.0) + (a_1 if q_1 == middle else 0.0)
        rate += (3.0 * a_2 if q_2 == stiff else 0.0) - (a_0 + a_1 + a_2) * past
        return force, max(0.5 * (h / b) * rate, 0.0), side + (y - side) * past, q_0, q_1, q_2
