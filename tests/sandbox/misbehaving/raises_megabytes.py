"""An error with 20 MB of text."""

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """An error with 20 MB of text."""

    def fit(self, context, record):
        raise ValueError(20_000_000 * "x")
