"""What a worker may read, write and do, and how it is kept to it.

An audit hook of Python refuses with a message that says what was refused; Landlock and seccomp, where the system has
them, hold compiled code too. What the hook alone refuses can be undone by who is bent on it.
"""

import os
import site
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fdbench.catalogue import PACKAGE, scenario_folder
from fdbench.sandbox import landlock, seccomp
from fdbench.sandbox.memory import limit_memory

# Of this package: what holds scenarios, draws and scores. The simulator of the nominal model stays in reach.
BARRED = (
    *("benchmark", "checks", "commands", "diagnosis", "envs", "metrics", "report", "reproduce"),
    *("api", "trials", "virtual_axes"),
    *("cli", "draw", "scenario"),
)

# Compiled files tell what their sources do.
_BARRED_PATHS = (*BARRED, *(f"{name}.py" for name in BARRED), "_scenarios", "__pycache__")

_BARRED_MODULES = frozenset(f"fdbench.{name}" for name in BARRED)

SYSTEM = (
    *("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/etc/ld.so.cache"),
    *("/etc/localtime", "/usr/share/zoneinfo", "/dev/null", "/dev/urandom", "/dev/random"),
    *("/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system/cpu"),
)

# Audit events that are refused whatever they are for, by their beginning.
REFUSED_EVENTS = {
    "subprocess.Popen": "start a process",
    "os.system": "start a process",
    "os.exec": "start a process",
    "os.fork": "start a process",
    "os.posix_spawn": "start a process",
    "os.spawn": "start a process",
    "pty.spawn": "start a process",
    "os.kill": "send a signal",
    "signal.pthread_kill": "send a signal",
    "socket.": "use the network",
    "resource.setrlimit": "change its limits",
    "resource.prlimit": "change its limits",
}

READING_EVENTS = ("os.listdir", "os.scandir", "ctypes.dlopen")

WRITING_EVENTS = (
    *("os.chmod", "os.chown", "os.link", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.symlink"),
    *("os.truncate", "os.utime", "os.setxattr", "os.removexattr"),
)

_WRITING_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


class Refused(PermissionError):
    """What an estimator may not do."""


@dataclass(frozen=True)
class Reach:
    """What may be read, with all below it, and which folders may be listed besides."""

    read: tuple[str, ...]
    listed: tuple[str, ...]


def confinement() -> str:
    """Return what keeps workers to their reach on this system.

    >>> confinement().endswith("audit hook")
    True
    """
    version = landlock.version()
    found = [f"Landlock {version}"] if version else []
    found += ["seccomp"] if seccomp.is_available() else []
    return f"{', '.join(found)} and audit hook" if found else "audit hook"


def common_reach(path: Sequence[str]) -> Reach:
    """Return what every worker may read: Python, what is installed, what can be imported, and shared libraries."""
    installed = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    # Another copy of this package may lie beside the one that runs.
    homes = {*installed, *path, f"{sysconfig.get_path('stdlib')}/site-packages", str(PACKAGE.parent)}
    packages = [Path(home, PACKAGE.name) for home in homes]
    barred = {os.path.realpath(package / part) for package in packages for part in _BARRED_PATHS}
    barred.add(os.path.realpath(scenario_folder()))
    installed |= {*site.getsitepackages(), f"{sys.base_prefix}/lib", f"{sys.prefix}/lib", f"{sys.prefix}/pyvenv.cfg"}
    roots = {os.path.realpath(root) for root in (*SYSTEM, *installed)}
    folders = sorted({os.path.realpath(entry) for entry in path})
    elsewhere = [folder for folder in folders if not any(_is_below(folder, root) for root in roots)]
    roots |= {part for folder in elsewhere for part in _importable(folder)}
    return Reach(tuple(sorted({part for root in roots for part in _without(root, barred)})), tuple(folders))


def _importable(folder: str) -> Iterator[str]:
    """Yield the modules and packages in a folder, and what an installation notes beside them; no links to files."""
    if not os.path.isdir(folder):
        return
    for entry in os.scandir(folder):
        is_package = entry.is_dir() and os.path.exists(f"{entry.path}/__init__.py")
        if is_package or (entry.name.endswith((".py", ".so", ".dist-info", ".egg-info")) and not entry.is_symlink()):
            yield os.path.realpath(entry.path)


def _without(root: str, barred: Iterable[str]) -> Iterator[str]:
    """Yield paths that together are all of ``root`` but what is barred."""
    inside = [path for path in barred if _is_below(path, root)]
    if not inside:
        yield root
    elif root not in inside:
        for entry in os.scandir(root):
            if not entry.is_symlink():
                yield from _without(entry.path, inside)


def _is_below(path: str, root: str) -> bool:
    return path == root or path.startswith(f"{root.rstrip('/')}/")


def confine(reach: Reach, written: Sequence[Path], memory_MB: float, *, has_landlock: bool, has_seccomp: bool) -> None:
    """Keep this process to what it may read and write, for good; by Landlock and seccomp too where the system has them.

    Raises
    ------
    OSError
        If one of them cannot be applied.
    """
    folders = tuple(os.path.realpath(folder) for folder in written)
    limit_memory(memory_MB)
    if has_landlock:
        landlock.restrict(read=reach.read, listed=reach.listed, written=(*folders, "/dev/null"))
    if has_seccomp:
        seccomp.restrict()
    sys.addaudithook(_hook({*reach.read, *folders}, set(reach.listed), {*folders, "/dev/null"}))


def _hook(read: set[str], listed: set[str], written: set[str]) -> Any:
    realpath, lexists, fsdecode = os.path.realpath, os.path.lexists, os.fsdecode
    refused_beginnings = tuple(REFUSED_EVENTS)
    watched = frozenset({*READING_EVENTS, *WRITING_EVENTS, "open", "import"})

    def is_within(path: str, allowed: set[str]) -> bool:
        while path not in allowed:
            above = path.rpartition("/")[0]
            if not above:
                return False
            path = above
        return True

    def check(path: Any, is_write: bool, is_listing: bool) -> None:
        if not isinstance(path, str | bytes | os.PathLike):
            return  # a file that is open already, or the working folder
        real = realpath(fsdecode(path))
        if is_write:
            if not is_within(real, written):
                raise Refused(f"an estimator may not write {real}")
        elif not (is_within(real, read) or (is_listing and real in listed)) and lexists(real):
            raise Refused(f"an estimator may not read {real}")

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event in watched:
            if event == "open":
                path, _, flags = arguments
                check(path, bool(isinstance(flags, int) and flags & _WRITING_FLAGS), False)
            elif event == "import":
                for barred in _BARRED_MODULES:
                    if arguments[0] == barred or arguments[0].startswith(f"{barred}."):
                        raise Refused(f"an estimator may not import {arguments[0]}")
            elif event == "ctypes.dlopen":
                if isinstance(arguments[0], str) and "/" in arguments[0]:
                    check(arguments[0], False, False)
            elif event in READING_EVENTS:
                check(arguments[0] if arguments[0] is not None else ".", False, True)
            else:
                for path in arguments[: 2 if event in ("os.rename", "os.link") else 1]:
                    check(path, True, False)
        elif event.startswith(refused_beginnings):
            act = next(text for beginning, text in REFUSED_EVENTS.items() if event.startswith(beginning))
            raise Refused(f"an estimator may not {act} ({event})")

    return hook
