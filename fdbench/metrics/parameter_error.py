"""How far the parameters are from the truth."""

from typing import final

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._parameters import comparable, relative_error_percent


@final
class ParameterError(Metric):
    r"""Root mean square of the relative errors of the model's parameters.

    .. math:: 100 \sqrt{\frac{1}{p} \sum_{i=1}^{p} \left( \frac{\hat\beta_i - \beta_i}{\beta_i} \right)^2}

    over the p parameters whose truth :math:`\beta_i` is finite and not zero. One that the estimate does not name, or
    gives as NaN, counts as zero: an error of 100 %, the same as that of an estimator that has learnt nothing.

    Validity: relative errors weigh a small friction as much as a large mass; look at each in ``parameters.parquet``.
    For measured records the truth is a published value, so that the error does not fall below that value's own.

    ``worst`` is ten times the error of learning nothing.

    Source: definition.
    """

    unit = "%"
    worst = 1000.0
    track = "parameters"

    def skip(self, outcome: Outcome) -> str | None:
        if not comparable(outcome.truth.parameters):
            return "no true parameter is known that is not zero"
        return None if outcome.estimate.parameters else "the estimate claims no parameters"

    def score(self, outcome: Outcome) -> float:
        return relative_error_percent(outcome.estimate.parameters, outcome.truth.parameters)
