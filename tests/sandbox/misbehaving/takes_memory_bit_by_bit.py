"""Memory until there is none."""

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """Memory until there is none."""

    def fit(self, context, record):
        taken = []
        while True:
            taken.append(bytearray(10_000_000))
