"""An error whose text cannot be made."""

from fdbench.estimator import BatchEstimator


class _Silent(Exception):
    """Fails when it is to be printed."""

    def __str__(self):
        raise RuntimeError("no text")


class Misbehaving(BatchEstimator):
    """An error whose text cannot be made."""

    def fit(self, context, record):
        raise _Silent
