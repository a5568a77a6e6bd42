"""How much memory a worker may have, and how much it had, told by the system and not by the worker."""

import resource
import sys
from contextlib import suppress
from pathlib import Path

MEGABYTE = 10**6

# Written to clear_refs of proc(5), the largest resident memory counts from now on.
FORGET_PEAK = b"5"


class PeakMemory:
    """The largest resident memory of another process since it was forgotten last, as the system tells it (Linux)."""

    def __init__(self, pid: int) -> None:
        self._clear, self._status = Path(f"/proc/{pid}/clear_refs"), Path(f"/proc/{pid}/status")
        self._is_forgotten = False

    def forget(self) -> None:
        """Let the peak begin with what is in use now."""
        with suppress(OSError):
            self._clear.write_bytes(FORGET_PEAK)
            self._is_forgotten = True

    def size_MB(self) -> float | None:
        """Return the peak; None where the system does not tell it."""
        with suppress(OSError):
            for line in self._status.read_bytes().splitlines() if self._is_forgotten else ():
                if line.startswith(b"VmHWM:"):
                    return 1024 * int(line.split()[1]) / MEGABYTE
        return None


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
