"""More than an answer may hold."""

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """More than an answer may hold."""

    def fit(self, context, record):
        return Estimate(output=np.zeros(60_000_000))
