"""Endless loop that no signal but the last one ends."""

import signal

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """Endless loop that no signal but the last one ends."""

    def fit(self, context, record):
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGABRT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        while True:
            pass
