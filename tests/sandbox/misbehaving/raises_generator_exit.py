"""GeneratorExit."""

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """GeneratorExit."""

    def fit(self, context, record):
        raise GeneratorExit
