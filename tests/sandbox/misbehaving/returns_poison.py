"""An Estimate that is another one each time it is read."""

from fdbench.estimator import BatchEstimator, Estimate


class _Poisoned(Estimate):
    """Raises where it is read a second time."""

    @property
    def output(self):
        raise RuntimeError("poisoned")

    @output.setter
    def output(self, value):
        pass


class Misbehaving(BatchEstimator):
    """An Estimate that is another one each time it is read."""

    def fit(self, context, record):
        estimate = object.__new__(_Poisoned)
        vars(estimate).update(vars(Estimate()))
        return estimate
