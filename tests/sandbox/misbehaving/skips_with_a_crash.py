"""Dies when it is asked whether it applies."""

import ctypes

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """Dies when it is asked whether it applies."""

    def fit(self, context, record):
        return Estimate()

    def skip(self, context):
        ctypes.string_at(0)
