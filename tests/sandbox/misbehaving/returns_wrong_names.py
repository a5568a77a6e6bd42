"""A parameter that the model lacks."""

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """A parameter that the model lacks."""

    def fit(self, context, record):
        return Estimate(parameters={"beta1": 0.5})
