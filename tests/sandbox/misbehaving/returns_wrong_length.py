"""Three values for a thousand rows."""

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """Three values for a thousand rows."""

    def fit(self, context, record):
        return Estimate(output=np.zeros(3))
