"""End the process behind Python's back."""

import ctypes

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """End the process behind Python's back."""

    def fit(self, context, record):
        ctypes.CDLL(None)._exit(0)
