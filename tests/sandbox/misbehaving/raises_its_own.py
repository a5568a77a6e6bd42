"""An error that is no Exception."""

from fdbench.estimator import BatchEstimator


class _Own(BaseException):
    """Derived from the root of all errors."""


class Misbehaving(BatchEstimator):
    """An error that is no Exception."""

    def fit(self, context, record):
        raise _Own("own")
