"""Processes that live on, each the child of the one before."""

import ctypes
import os
import time

from fdbench.estimator import BatchEstimator

SET_NAME = 15


class Misbehaving(BatchEstimator):
    """Processes that live on, each the child of the one before."""

    def fit(self, context, record):
        library, worker = ctypes.CDLL(None), os.getpid()
        for _ in range(4):
            if library.fork() != 0:
                break
            os.setsid()
            library.prctl(SET_NAME, b"left behind")
        while os.getpid() != worker:
            time.sleep(1000.0)
        raise ValueError("forked")
