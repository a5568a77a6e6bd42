"""How far the parameters are from the truth."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._parameters import comparable, value_of


@final
class ParameterError(Metric):
    r"""Error of the model's parameters, each weighed by the size of its regressor.

    .. math:: 100 \sqrt{\frac{\sum_i \overline{z_i^2} (\hat\beta_i - \beta_i)^2}{\sum_i \overline{z_i^2} \beta_i^2}}

    with the regressor :math:`z_i` of parameter i: what its error costs in the output, relative to what the parameter
    contributes. A parameter that the estimate does not name, or gives as NaN, counts as zero, so that an estimator
    that has learnt nothing has 100 %.

    Validity: look at each parameter's own error in ``parameters.parquet``. For measured records the truth is a
    published value, so that the error does not fall below that value's own.

    ``worst`` is ten times the error of learning nothing.

    Source: definition. For uncorrelated regressors the numerator is the mean square of the error in the output.

    Examples
    --------
    The second regressor is four times the first: what an error of it costs is four times as much.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> true, rows = {"beta_1": 3.0, "beta_2": 1.0}, [[1.0, 4.0], [-1.0, 4.0]]
    >>> claims = ({"beta_1": 3.5, "beta_2": 1.0}, {"beta_1": 3.0, "beta_2": 1.5}, {"beta_1": 3.0})
    >>> for claim in (Estimate(parameters=claim) for claim in claims):
    ...     print(ParameterError().score(example_outcome(claim, target=[0, 0], regressors=rows, parameters=true)))
    10.0
    40.0
    80.0
    """

    unit = "%"
    worst = 1000.0
    track = "parameters"
    primary = True

    def skip(self, outcome: Outcome) -> str | None:
        if not comparable(outcome.truth.parameters):
            return "no true parameter is known that is not zero"
        if not set(outcome.regression.names) & set(outcome.truth.parameters):
            return "the model has no regressors with known true parameters"
        return None if outcome.estimate.parameters else "the estimate claims no parameters"

    def score(self, outcome: Outcome) -> float:
        truth, estimate = outcome.truth.parameters, outcome.estimate.parameters
        known = [index for index, name in enumerate(outcome.regression.names) if name in truth]
        names = [outcome.regression.names[index] for index in known]
        size = np.sqrt(np.mean(outcome.regression.regressors[:, known] ** 2, axis=0))
        true = np.array([truth[name] for name in names])
        error = np.array([value_of(estimate, name) for name in names]) - true
        return float(100.0 * np.linalg.norm(size * error) / np.linalg.norm(size * true))
