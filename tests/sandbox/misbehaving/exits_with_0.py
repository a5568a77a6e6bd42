"""End the process as if all were well."""

import os

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """End the process as if all were well."""

    def fit(self, context, record):
        os._exit(0)
