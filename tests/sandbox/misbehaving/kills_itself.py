"""Signal 9 to itself."""

import os
import signal

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """Signal 9 to itself."""

    def fit(self, context, record):
        os.kill(os.getpid(), signal.SIGKILL)
