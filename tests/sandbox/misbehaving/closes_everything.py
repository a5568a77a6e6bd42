"""Every open file closed, the channel too."""

import os

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """Every open file closed, the channel too."""

    def fit(self, context, record):
        os.closerange(0, 256)
        return Estimate()
