"""How much memory a worker may have, and how much it had."""

import os
import resource
import sys
from pathlib import Path

MEGABYTE = 10**6

# Written to clear_refs of proc(5): the largest resident memory counts from now on.
FORGET_PEAK = b"5"


class PeakMemory:
    """The largest resident memory of this process, since it was forgotten last where the system can (Linux)."""

    def __init__(self) -> None:
        clear = "/proc/self/clear_refs"
        self._clear = os.open(clear, os.O_WRONLY | os.O_CLOEXEC) if os.access(clear, os.W_OK) else None

    def forget(self) -> None:
        """Let the peak begin with what is in use now."""
        if self._clear is not None:
            os.pwrite(self._clear, FORGET_PEAK, 0)

    def size_MB(self) -> float:
        """Return the peak."""
        size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return size * (1 if sys.platform == "darwin" else 1024) / MEGABYTE


def limit_memory(memory_MB: float) -> None:
    """Let this process have no more memory than this, and write no larger file."""
    allowed = int(memory_MB * MEGABYTE)
    for name, size in (
        ("RLIMIT_DATA", allowed),
        ("RLIMIT_AS", allowed + _address_space()),
        ("RLIMIT_FSIZE", allowed),
        ("RLIMIT_CORE", 0),
    ):
        kind = getattr(resource, name)
        _, most = resource.getrlimit(kind)
        size = size if most == resource.RLIM_INFINITY else min(size, most)
        resource.setrlimit(kind, (size, size))


def _address_space() -> int:
    """Return the bytes of addresses that this process has, much of which is no memory."""
    if sys.platform != "linux":
        return 2**36
    return int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
