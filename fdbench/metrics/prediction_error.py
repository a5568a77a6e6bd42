"""How much of the output is not predicted."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._series import claimed, not_claimed
from fdbench.statistics import rms


@final
class PredictionError(Metric):
    r"""Root mean square of the prediction error relative to that of predicting the mean.

    .. math:: 100 \sqrt{\frac{\sum_k (y_k - \hat y_k)^2}{\sum_k (y_k - \bar y)^2}}

    over all rows; 100 minus it is the fit of the system identification literature. 0 is for an output equal to the
    target. The true model leaves the noise, so that small differences near the noise are best seen as
    ``psd_residual_broadband``.

    Validity: a batch estimator predicts in sample and an online one a step ahead, so that a smoother can go below the
    noise without knowing more.

    ``worst`` is ten times the error of predicting the mean.

    Source: Ljung, System Identification (1999), chapter 16, for the fit.

    Examples
    --------
    A target of 1 m/s about its mean, of which 0.2 m/s is not predicted.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> claim = Estimate(output=np.array([2.8, 1.2]))
    >>> round(PredictionError().score(example_outcome(claim, target=[3.0, 1.0])), 9)
    20.0
    """

    unit = "%"
    worst = 1000.0
    track = "output"

    def skip(self, outcome: Outcome) -> str | None:
        if np.ptp(outcome.regression.target) == 0.0:
            return "the target does not vary"
        return not_claimed(outcome, "output")

    def score(self, outcome: Outcome) -> float:
        target = outcome.regression.target
        return 100.0 * rms(target - claimed(outcome, "output")) / rms(target - target.mean())
