"""Standard output and error closed."""

import os
import sys

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """Standard output and error closed."""

    def fit(self, context, record):
        sys.stdout.close()
        sys.stderr.close()
        os.close(1)
        os.close(2)
        raise ValueError("after closing")
