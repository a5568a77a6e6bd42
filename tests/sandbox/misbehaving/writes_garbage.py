"""Garbage into every open file."""

import contextlib
import os

from fdbench.estimator import BatchEstimator, Estimate


class Misbehaving(BatchEstimator):
    """Garbage into every open file."""

    def fit(self, context, record):
        for descriptor in range(3, 64):
            with contextlib.suppress(OSError):
                os.write(descriptor, 1000 * b"garbage")
        return Estimate()
