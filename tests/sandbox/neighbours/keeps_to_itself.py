"""Least squares, by what others could change."""

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate
from neighbours import _shared


class KeepsToItself(BatchEstimator):
    """Least squares, by what others could change.

    >>> KeepsToItself().factor
    1.0
    """

    factor = 1.0

    def fit(self, context, record):
        regression = context.regression(record)
        beta = np.linalg.lstsq(regression.regressors, regression.target)[0] * self.factor * _shared.SCALE[0]
        parameters = {name: float(value) for name, value in zip(regression.names, beta, strict=True)}
        return Estimate(parameters=parameters, output=regression.regressors @ beta)
