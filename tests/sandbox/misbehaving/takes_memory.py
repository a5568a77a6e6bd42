"""16 GB."""

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """16 GB."""

    def fit(self, context, record):
        return Estimate(output=np.ones(2_000_000_000))
