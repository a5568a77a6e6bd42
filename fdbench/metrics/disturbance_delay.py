"""By how much the disturbance force comes late, or early."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._series import alternating_disturbance, no_disturbance
from fdbench.regression import FloatArray

# Points of the correlation for each sampling time, between which a parabola is laid.
OVERSAMPLING = 8
LONGEST_S = 1.0


@final
class DisturbanceDelay(Metric):
    r"""Time by which the claimed disturbance has to be shifted to correlate best with the true one.

    .. math:: |\tau|, \quad \tau = \arg\max_{|\tau| \le \tau_{max}}
              \sum_k \tilde{\hat d}(t_k + \tau)\, \tilde d(t_k)

    Both forces without their mean over the scenario's window; the correlation is interpolated as that of a
    band-limited signal (eight points for each sampling time), and by a parabola at its top. It is not divided by the
    overlap, so that of shifts a period apart the shortest wins.

    The limit :math:`\tau_{max}` is half a period where the scenario gives one, as a shift of more cannot be told from
    one of less; else 1 s; a quarter of the window at most. An estimate that does not vary has no delay that could be
    measured and gets the limit, the largest one that can be.

    Validity: constant delays. A phase error of a controller or filter is a delay at the disturbance's frequency only.

    ``worst``, 1 s, is the longest delay that can be found.

    Source: Knapp, Carter (1976), IEEE Trans. Acoustics, Speech and Signal Processing 24, for the correlation.

    Examples
    --------
    A wave that is claimed two samples of 3.003 ms too late.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> k = np.arange(400)
    >>> claim = Estimate(disturbance_N=np.sin(0.9 * (k - 2)))
    >>> late_s = DisturbanceDelay().score(example_outcome(claim, disturbance_N=np.sin(0.9 * k)))
    >>> round(late_s / 0.003003003, 2)
    2.0
    """

    unit = "s"
    worst = LONGEST_S
    track = "disturbance"

    def skip(self, outcome: Outcome) -> str | None:
        return no_disturbance(outcome)

    def score(self, outcome: Outcome) -> float:
        estimate, truth = alternating_disturbance(outcome)
        step_s = outcome.regression.sampling_time_s
        limit_s = min(LONGEST_S, 0.25 * step_s * len(truth))
        if outcome.scenario.estimation.disturbance_period_s is not None:
            limit_s = min(limit_s, 0.5 * outcome.scenario.estimation.disturbance_period_s)
        if np.ptp(estimate) == 0.0:
            return limit_s
        return step_s * abs(delay(estimate, truth, limit_s / step_s))


def delay(late: FloatArray, early: FloatArray, limit: float) -> float:
    """Return the delay of one series behind another, in samples, within the limit.

    >>> k = np.arange(400)
    >>> delay(np.sin(0.9 * (k - 1.3)), np.sin(0.9 * k), 3.5)
    1.30
    """
    size = 1 << (2 * len(early) - 1).bit_length()
    cross = np.fft.rfft(late, size) * np.conj(np.fft.rfft(early, size))
    correlation = np.fft.irfft(cross, OVERSAMPLING * size)
    reach = int(limit * OVERSAMPLING)
    steps = np.arange(-reach, reach + 1)
    values = correlation[steps]
    top = int(np.argmax(values))
    offset = 0.0
    if 0 < top < 2 * reach:
        left, middle, right = values[top - 1 : top + 2]
        curvature = left - 2.0 * middle + right
        offset = 0.5 * float((left - right) / curvature) if curvature < 0.0 else 0.0
    return float(steps[top] + offset) / OVERSAMPLING
