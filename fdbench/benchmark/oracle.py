"""The reference row that knows the truth; no plug-in, since a plug-in has no path to the truth."""

import numpy as np

from fdbench.estimator import Estimate
from fdbench.regression import Regression
from fdbench.scenario import Truth

NAME = "oracle"


def oracle(regression: Regression, truth: Truth) -> Estimate:
    r"""Return the true parameters and disturbance, and the prediction that follows from them.

    .. math:: \hat\beta = \beta, \quad \hat d = d, \quad \hat y = Z \beta + g\, d

    with g the disturbance gain. What remains of :math:`y - \hat y` is noise and what no linear model holds. Without a
    known disturbance d is left out; without every parameter of the regression so is the output.
    """
    disturbance = None if truth.disturbance_N is None else truth.disturbance_N[regression.rows]
    output = None
    if all(name in truth.parameters for name in regression.names):
        beta = np.array([truth.parameters[name] for name in regression.names])
        output = regression.regressors @ beta
        if disturbance is not None:
            output = output + regression.disturbance_gain * disturbance
    return Estimate(parameters=dict(truth.parameters), disturbance_N=disturbance, output=output)
