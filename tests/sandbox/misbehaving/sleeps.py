"""Endless sleep."""

import time

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """Endless sleep."""

    def fit(self, context, record):
        while True:
            time.sleep(1000.0)
