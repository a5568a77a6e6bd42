"""A prediction of another length."""

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """A prediction of another length."""

    def fit(self, context, record):
        return Estimate()

    def predict(self, context, estimate, command):
        return np.zeros(7)
