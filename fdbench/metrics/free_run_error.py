"""How far the predicted motion, or force, of a command never tried is from the true one."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.statistics import rms


@final
class FreeRunError(Metric):
    r"""Root mean square error of a free run in the validation motion, relative to the response itself.

    .. math:: 100 \frac{\mathrm{rms}(\hat y - y)}{\mathrm{rms}(y - \bar y)}

    y is what the model's target is when the machine makes the scenario's validation motion without process forces and
    noise, :math:`\hat y` what ``Estimator.predict`` says of it from the command alone. 0 is for a perfect prediction.

    Validity: a model that lacks an effect of the machine has an error that no better parameters take away.

    ``worst`` is ten times the error of predicting the mean.

    Source: Ljung, System Identification (1999), section 16.6, simulation on validation data.

    Examples
    --------
    A response of 1 m/s about its mean, predicted with 0.9 m/s.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> outcome = example_outcome(Estimate(), response=[3.0, 1.0], predicted_response=[2.9, 1.1])
    >>> round(FreeRunError().score(outcome), 9)
    10.0
    """

    unit = "%"
    worst = 1000.0
    track = "output"
    primary = True

    def skip(self, outcome: Outcome) -> str | None:
        if outcome.truth.response is None:
            return "the scenario has no validation motion"
        return "the estimator predicts no response to a command" if outcome.response is None else None

    def score(self, outcome: Outcome) -> float:
        truth, response = np.asarray(outcome.truth.response), np.asarray(outcome.response)
        return 100.0 * rms(response - truth) / rms(truth - truth.mean())
