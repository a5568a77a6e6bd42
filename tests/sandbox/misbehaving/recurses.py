"""Endless recursion."""

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """Endless recursion."""

    def fit(self, context, record):
        return self.fit(context, record)
