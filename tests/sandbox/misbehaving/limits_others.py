"""Limits and looks into the process that started it, opens a socket, takes files and memory, with compiled code."""

import ctypes
import os
import resource
import socket

from fdbench.estimator import BatchEstimator

SCHED_SETATTR, PERF_EVENT_OPEN, IO_URING_SETUP = 314, 298, 425


class Misbehaving(BatchEstimator):
    """Limits and looks into the process that started it, opens a socket, takes files and memory, with compiled code."""

    def fit(self, context, record):
        library, other = ctypes.CDLL(None), os.getppid()
        unlimited = (ctypes.c_uint64 * 2)(2**64 - 1, 2**64 - 1)
        idle = (ctypes.c_uint32 * 12)(48, 5)
        counter = (ctypes.c_uint32 * 32)(1, 128, 1)
        answers = {
            "prlimit": library.prlimit(other, resource.RLIMIT_CPU, ctypes.byref(unlimited), None),
            "setpriority": library.setpriority(os.PRIO_PROCESS, other, 0),
            "sched_setaffinity": library.sched_setaffinity(other, 8, ctypes.byref(unlimited)),
            "sched_setattr": library.syscall(SCHED_SETATTR, other, ctypes.byref(idle), 0),
            "perf_event_open": library.syscall(PERF_EVENT_OPEN, ctypes.byref(counter), other, -1, -1, 0),
            "socket": library.socket(socket.AF_INET, socket.SOCK_DGRAM, 0),
            "io_uring_setup": library.syscall(IO_URING_SETUP, 4, ctypes.create_string_buffer(120)),
            "chmod": library.chmod(__file__.encode(), os.stat(__file__).st_mode & 0o777),
            "utimes": library.utimes(__file__.encode(), None),
            "setxattr": library.setxattr(__file__.encode(), b"user.own", b"1", 1, 0),
            "memfd_create": library.memfd_create(b"memory", 0),
        }
        raise ValueError(", ".join(name for name, answer in answers.items() if answer != -1) or "refused")
