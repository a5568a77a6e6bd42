"""A million parameters."""

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """A million parameters."""

    def fit(self, context, record):
        return Estimate(parameters={f"beta_{n}": 0.0 for n in range(1_000_000)})
