"""Abort."""

import os

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """Abort."""

    def fit(self, context, record):
        os.abort()
        return Estimate()
