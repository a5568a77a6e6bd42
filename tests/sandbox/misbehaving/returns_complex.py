"""Complex numbers."""

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """Complex numbers."""

    def fit(self, context, record):
        return Estimate(output=np.zeros(len(context.regression(record).target), dtype=complex))
