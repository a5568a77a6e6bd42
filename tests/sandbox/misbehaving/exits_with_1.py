"""End the process."""

import os

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """End the process."""

    def fit(self, context, record):
        os._exit(1)
