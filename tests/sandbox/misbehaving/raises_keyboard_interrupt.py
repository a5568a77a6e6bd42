"""KeyboardInterrupt that no one has typed."""

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """KeyboardInterrupt that no one has typed."""

    def fit(self, context, record):
        raise KeyboardInterrupt
