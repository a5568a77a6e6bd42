"""Sets limits and speed of the process that started it, and opens a socket, with compiled code."""

import ctypes
import os
import resource
import socket

from fdbench.estimator import BatchEstimator


class Misbehaving(BatchEstimator):
    """Sets limits and speed of the process that started it, and opens a socket, with compiled code."""

    def fit(self, context, record):
        library, other = ctypes.CDLL(None), os.getppid()
        unlimited = (ctypes.c_uint64 * 2)(2**64 - 1, 2**64 - 1)
        answers = (
            library.prlimit(other, resource.RLIMIT_CPU, ctypes.byref(unlimited), None),
            library.setpriority(os.PRIO_PROCESS, other, 0),
            library.sched_setaffinity(other, 8, ctypes.byref(unlimited)),
            library.socket(socket.AF_INET, socket.SOCK_DGRAM, 0),
        )
        raise ValueError("refused" if set(answers) == {-1} else "done")
