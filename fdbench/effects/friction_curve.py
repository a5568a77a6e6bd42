"""Friction curve: by how much friction over speed differs from its nominal curve, as a free smooth function."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class FrictionCurve(Effect):
    r"""Deviation of friction from its nominal curve, alike in both directions: bumps on a logarithmic axis of speed.

    .. math:: F(v) = \operatorname{sgn}(v) \sum_{k=0}^{3} a_k \frac{4 v^2 v_k^2}{(v^2 + v_k^2)^2}, \qquad
        v_k = 10^{-1 - k/2} v_f

    v_f: the fastest speed. Each bump is a_k at its speed and half of that at 0.41 and 2.4 times it. No nominal
    friction is right in form, so the diagnosis lets every hypothesis have such a deviation, within limits.

    Source: a linear basis for the friction curves of Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica
    30(7); the basis is ours.

    Examples
    --------
    >>> effect = FrictionCurve.typical(force_0_N=2.0, fastest_m_per_s=0.1)
    >>> force, slope = FrictionCurve.kernel(0.0, 1e-4, 0.0, -0.01, 0.0, *effect.values())
    >>> round(force, 9)
    -2.0
    """

    port = Port.TABLE_FORCE
    amplitude = "force_0_N"
    further_amplitudes = ("force_1_N", "force_2_N", "force_3_N")
    calibrates = "friction_form"
    expected_failures: ClassVar[Mapping[str, str]] = {
        "is_named_first": "a nominal parameter, which at twice its typical size is within its uncertainty on that axis",
    }

    force_0_N: float = parameter("a_0", low=-1000.0, high=1000.0, typical=5.0)
    force_1_N: float = parameter("a_1", low=-1000.0, high=1000.0, typical=0.0)
    force_2_N: float = parameter("a_2", low=-1000.0, high=1000.0, typical=0.0)
    force_3_N: float = parameter("a_3", low=-1000.0, high=1000.0, typical=0.0)
    fastest_m_per_s: float = parameter("v_f", low=1e-4, high=100.0, typical=0.3)

    @kernel
    def kernel(t, h, x, v, u, a_0, a_1, a_2, a_3, v_f):
        square, fast = v * v, 0.01 * v_f * v_f
        medium, slow, slowest = 0.1 * fast, 0.01 * fast, 0.001 * fast
        bumps = a_0 * fast / ((square + fast) * (square + fast))
        bumps += a_1 * medium / ((square + medium) * (square + medium))
        bumps += a_2 * slow / ((square + slow) * (square + slow))
        slope = 4.0 * abs(v) * (bumps + a_3 * slowest / ((square + slowest) * (square + slowest)))
        return slope * v, max(slope, 0.0)
