"""The beginning of an answer, then silence."""

import contextlib
import os
import struct
import time

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """The beginning of an answer, then silence."""

    def fit(self, context, record):
        for descriptor in range(3, 64):
            with contextlib.suppress(OSError):
                os.write(descriptor, struct.pack("!16sIQ", bytes(16), 100, 0))
        while True:
            time.sleep(1000.0)
