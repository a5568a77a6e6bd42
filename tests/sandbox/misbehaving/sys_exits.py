"""sys.exit."""

import sys

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """sys.exit."""

    def fit(self, context, record):
        sys.exit(0)
