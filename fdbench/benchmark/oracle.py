"""The reference row that knows the truth; no plug-in, since a plug-in has no path to the truth."""

from fdbench.estimator import Estimate
from fdbench.regression import Regression
from fdbench.scenario import Truth

NAME = "oracle"


def oracle(regression: Regression, truth: Truth) -> Estimate:
    r"""Return the true parameters and disturbance, and the prediction that follows from them.

    .. math:: \hat\beta = \beta, \quad \hat d = d, \quad \hat y = Z \beta + g\, d

    with g the disturbance gain; see `Truth.output`.
    """
    disturbance = None if truth.disturbance_N is None else truth.disturbance_N[regression.rows]
    return Estimate(parameters=dict(truth.parameters), disturbance_N=disturbance, output=truth.output(regression))
