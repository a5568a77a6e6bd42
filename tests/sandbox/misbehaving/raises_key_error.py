"""A slip of the pen."""

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """A slip of the pen."""

    def fit(self, context, record):
        return Estimate(parameters={"beta_1": {}["missing"]})
