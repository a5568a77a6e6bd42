"""Files that are whole or not there: written beside their place and moved to it; names, trees."""

import ast
import os
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fdbench.errors import FdbenchError

# Names that are parts of paths, of tables in Markdown and of what is printed.
LONGEST_NAME = 100
PLAIN_NAME = re.compile(rf"\w[\w .-]{{0,{LONGEST_NAME - 1}}}")
VARIANT_NAME = re.compile(rf"{PLAIN_NAME.pattern}(\[[\w.,=+-]{{1,200}}\])?")  # of an estimator with arguments

UNFINISHED = ".partial"  # ends the name of a file that is being written
FORGOTTEN_S = 3600.0  # without a change to it, after which its writer is held to have been killed

# Folders of devices and of what is open already, such as standard output.
DEVICES = {Path("/dev"), Path("/dev/fd"), Path("/proc/self/fd")}


def is_utf_8(path: str | Path) -> bool:
    """Return whether a path can be written in a text; Linux allows others, whose bytes Python keeps as surrogates."""
    return not any("\udc80" <= letter <= "\udcff" for letter in str(path))


def parsed(file: Path) -> ast.Module:
    """Return the tree of a Python file; an empty one where it cannot be read, which is told where it is imported."""
    try:
        return ast.parse(file.read_bytes())
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # the latter two are of what is nested too deeply
        return ast.Module(body=[], type_ignores=[])


@contextmanager
def replaced(path: str | Path, error: type[FdbenchError] = FdbenchError, *, folders: bool = False) -> Iterator[Path]:
    """Yield a file beside ``path`` that takes its place when all has gone well; else what was there stays.

    Parameters
    ----------
    path : path
        What is no file, such as ``/dev/stdout``, is written to as it is.
    error : type
        What is raised if the file cannot be written, as on a full disk; the message names it.
    folders : bool
        Make the folders above it.
    """
    path = Path(path)
    if not is_utf_8(path):
        raise error(f"{path}: the name is not UTF-8. Give another one.")
    is_special = path.parent in DEVICES or (path.exists() and not path.is_file() and not path.is_dir())
    place = path.resolve() if path.is_symlink() and not is_special else path
    beside = place.with_name(f".{place.name}.{os.getpid()}.{threading.get_native_id()}{UNFINISHED}")
    partial = path if is_special else beside
    try:
        if folders:
            place.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        if not is_special:
            partial.replace(place)
    except OSError as cause:
        raise error(f"{path}: cannot be written: {cause.strerror or cause}.") from cause
    finally:
        if not is_special:
            with suppress(OSError):  # what went wrong before says more
                partial.unlink()


def remove_forgotten(folder: Path) -> None:
    """Remove what writers that were killed have left in a folder and below: files that `replaced` had begun."""
    for unfinished in folder.rglob(f".*{UNFINISHED}"):
        with suppress(OSError):  # its writer was quicker
            if time.time() - unfinished.stat().st_mtime > FORGOTTEN_S:
                unfinished.unlink()


def write_text(path: str | Path, text: str, error: type[FdbenchError] = FdbenchError, *, folders: bool = False) -> None:
    """Write a text file in UTF-8, whole or not at all; see `replaced`."""
    with replaced(path, error, folders=folders) as partial:
        partial.write_text(text, "utf-8", newline="\n")
