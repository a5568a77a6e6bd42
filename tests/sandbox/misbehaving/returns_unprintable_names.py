"""Names that no table can hold."""

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """Names that no table can hold."""

    def fit(self, context, record):
        return Estimate(parameters={"beta_1\ud800": 1.0})
