"""Seccomp: Linux refuses this process and its threads system calls that Landlock leaves open, from compiled code too.

No other process is started, limited, slowed down or looked into, no socket is opened, no file's mode, owner or time
changes, and there is no memory beside the limits. Source: Linux,
Documentation/userspace-api/seccomp_filter.rst and tools/include/uapi/linux/bpf_common.h.
"""

import ctypes
import errno
import os
import platform
import sys

GET_SECCOMP, SET_SECCOMP, FILTER, NO_NEW_PRIVILEGES = 21, 22, 2, 38

LOAD, EQUAL, AT_LEAST, ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06

ALLOW, REFUSE = 0x7FFF0000, 0x00050000

# Places in struct seccomp_data; of an argument, the lower half.
NUMBER, ARCHITECTURE, FIRST_ARGUMENT = 0, 4, 16

X86_64, FIRST_OF_X32, THREAD = 0xC000003E, 0x40000000, 0x00010000

CLONE, CLONE3 = 56, 435

REFUSED = {
    "socket": 41,
    "fork": 57,
    "vfork": 58,
    "ptrace": 101,
    "setpriority": 141,
    "ioprio_set": 251,
    "perf_event_open": 298,
    "process_vm_readv": 310,
    "process_vm_writev": 311,
    "pidfd_getfd": 438,
    "process_madvise": 440,
    # It opens sockets without the call of that name.
    "io_uring_setup": 425,
    # Memory that no limit of a process counts.
    "shmget": 29,
    "memfd_create": 319,
    "memfd_secret": 447,
    # Landlock leaves open who may use a file, and when it was changed.
    "chmod": 90,
    "fchmod": 91,
    "fchmodat": 268,
    "fchmodat2": 452,
    "chown": 92,
    "fchown": 93,
    "lchown": 94,
    "fchownat": 260,
    "utime": 132,
    "utimes": 235,
    "futimesat": 261,
    "utimensat": 280,
    "setxattr": 188,
    "lsetxattr": 189,
    "fsetxattr": 190,
    "removexattr": 197,
    "lremovexattr": 198,
    "fremovexattr": 199,
    "setxattrat": 463,
    "removexattrat": 466,
}

# Their first argument is a process, 0 for the one that calls.
OF_ITSELF = {
    "sched_setparam": 142,
    "sched_setscheduler": 144,
    "sched_setaffinity": 203,
    "prlimit64": 302,
    "sched_setattr": 314,
}


class _Instruction(ctypes.Structure):
    _fields_ = (("code", ctypes.c_uint16), ("yes", ctypes.c_uint8), ("no", ctypes.c_uint8), ("value", ctypes.c_uint32))


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_uint16), ("instructions", ctypes.POINTER(_Instruction)))


def is_available() -> bool:
    """Return whether this system has it, and the numbers of its calls are known here: those of x86-64."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return False
    return int(ctypes.CDLL(None).prctl(GET_SECCOMP, 0, 0, 0, 0)) >= 0


def restrict() -> None:
    """Refuse the calls for good.

    Raises
    ------
    OSError
        If the system cannot.
    """
    instructions = [_Instruction(*parts) for parts in _instructions()]
    program = _Program(len(instructions), (_Instruction * len(instructions))(*instructions))
    library = ctypes.CDLL(None, use_errno=True)
    library.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    if library.prctl(SET_SECCOMP, FILTER, ctypes.byref(program), 0, 0) < 0:
        raise OSError(ctypes.get_errno(), f"seccomp: {os.strerror(ctypes.get_errno())}")


def _instructions() -> list[tuple[int, int, int, int]]:
    """Return code, steps to skip where it holds and where not, and value of each instruction."""
    refused = (RETURN, 0, 0, REFUSE | errno.EPERM)
    found = [(LOAD, 0, 0, ARCHITECTURE), (EQUAL, 1, 0, X86_64), refused]
    found += [(LOAD, 0, 0, NUMBER), (AT_LEAST, 0, 1, FIRST_OF_X32), refused]
    for number in REFUSED.values():
        found += [(EQUAL, 0, 1, number), refused]
    # Its flags lie in memory, out of sight; the C library falls back on clone.
    found += [(EQUAL, 0, 1, CLONE3), (RETURN, 0, 0, REFUSE | errno.ENOSYS)]
    allowed = (RETURN, 0, 0, ALLOW)
    for number, test in ((CLONE, (ANY_BIT, 1, 0, THREAD)), *((n, (EQUAL, 1, 0, 0)) for n in OF_ITSELF.values())):
        found += [(EQUAL, 0, 4, number), (LOAD, 0, 0, FIRST_ARGUMENT), test, refused, allowed]
    return [*found, allowed]
