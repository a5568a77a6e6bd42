"""A process that lives on behind Python's back."""

import ctypes
import time

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """A process that lives on behind Python's back."""

    def fit(self, context, record):
        if ctypes.CDLL(None).fork() == 0:
            while True:
                time.sleep(1000.0)
        raise ValueError("forked")
