"""Endless loop."""

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """Endless loop."""

    def fit(self, context, record):
        while True:
            pass
