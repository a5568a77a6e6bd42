"""Segmentation fault."""

import ctypes

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """Segmentation fault."""

    def fit(self, context, record):
        ctypes.string_at(0)
        return Estimate()
