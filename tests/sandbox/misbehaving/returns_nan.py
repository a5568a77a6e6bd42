"""NaN."""

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """NaN."""

    def fit(self, context, record):
        return Estimate(parameters={"beta_1": np.nan})
