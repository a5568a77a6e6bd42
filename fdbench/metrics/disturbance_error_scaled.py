"""How far the shape of the disturbance force is from the truth, whatever its scale."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._series import alternating_disturbance, no_disturbance
from fdbench.regression import FloatArray
from fdbench.statistics import rms


@final
class DisturbanceErrorScaled(Metric):
    r"""Root mean square error of the alternating disturbance after the best gain, relative to the disturbance's own.

    .. math:: 100 \frac{\mathrm{rms}(c\, \tilde{\hat d} - \tilde d)}{\mathrm{rms}(\tilde d)}, \quad
              c = \max\left( 0, \frac{\tilde{\hat d} \cdot \tilde d}{\tilde{\hat d} \cdot \tilde{\hat d}} \right)

    Both forces without their mean over the scenario's window. The gain is not negative: a wrong sign is not a matter
    of scale. The difference to ``disturbance_error`` is what a wrong mass or a shrinking prior costs. The value
    never exceeds 100 %, that of an estimate of zero; for c > 0 it is 100 sqrt(1 - r^2) with the correlation r.

    Validity: as for ``disturbance_error``.

    ``worst`` is ten times the error of claiming nothing, as for ``disturbance_error``.

    Source: definition.

    Examples
    --------
    Half of the amplitude is missing, which a gain of 2 mends; a wrong sign is not mended.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> wave = np.array([1.0, -1.0, 1.0, -1.0])
    >>> claims = (Estimate(disturbance_N=sign * wave) for sign in (1.0, -1.0))
    >>> [DisturbanceErrorScaled().score(example_outcome(claim, disturbance_N=2.0 * wave)) for claim in claims]
    [0.0, 100.0]
    """

    unit = "%"
    worst = 1000.0
    track = "disturbance"

    def skip(self, outcome: Outcome) -> str | None:
        return no_disturbance(outcome)

    def score(self, outcome: Outcome) -> float:
        estimate, truth = alternating_disturbance(outcome)
        return 100.0 * rms(best_gain(estimate, truth) * estimate - truth) / rms(truth)


def best_gain(estimate: FloatArray, truth: FloatArray) -> float:
    """Return the gain of at least 0 that brings an estimate nearest to the truth.

    >>> truth = np.array([1.0, -2.0, 1.0])
    >>> best_gain(4.0 * truth, truth), best_gain(-truth, truth), best_gain(0.0 * truth, truth)
    (0.25, 0.0, 0.0)
    """
    power = float(np.dot(estimate, estimate))
    return max(0.0, float(np.dot(estimate, truth)) / power) if power > 0.0 else 0.0
