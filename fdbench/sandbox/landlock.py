"""Landlock: Linux keeps this process and its threads from files, whatever code asks for them, compiled code included.

Source: Linux, Documentation/userspace-api/landlock.rst. Another system or an older kernel has none: version 0.
"""

import ctypes
import errno
import os
import sys
from collections.abc import Iterable

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446

VERSION_FLAG, PATH_BENEATH, NO_NEW_PRIVILEGES = 1, 1, 38

EXECUTE, WRITE_FILE, READ_FILE, READ_DIR, TRUNCATE = 1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 14

# Rights on files that each version of the interface knows, of which each bit is one.
FILE_RIGHTS = {1: 2**13 - 1, 2: 2**14 - 1, 3: 2**15 - 1, 4: 2**15 - 1, 5: 2**16 - 1}

OF_A_FILE = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | 1 << 15

ALL_TCP, ALL_SCOPES = 0b11, 0b11


class _Ruleset(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scopes", ctypes.c_uint64))


class _FolderRule(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


def version() -> int:
    """Return the version of the interface, or 0 where there is none."""
    if sys.platform != "linux":
        return 0
    return max(0, int(_library().syscall(CREATE_RULESET, None, 0, VERSION_FLAG)))


def restrict(*, read: Iterable[str], listed: Iterable[str], written: Iterable[str]) -> None:
    """Let this process only read, list and write below these paths.

    TCP, signals to other processes and their memory are out of reach too, as far as the kernel's version has it.

    Raises
    ------
    OSError
        If the system cannot.
    """
    known = version()
    if not known:
        raise OSError(errno.ENOSYS, "this system has no Landlock")
    library = _library()
    files = FILE_RIGHTS[min(known, max(FILE_RIGHTS))]
    rules = _Ruleset(files, ALL_TCP if known >= 4 else 0, ALL_SCOPES if known >= 6 else 0)
    size = 24 if known >= 6 else 16 if known >= 4 else 8
    ruleset = _checked(library.syscall(CREATE_RULESET, ctypes.byref(rules), size, 0))
    rights = dict.fromkeys(listed, READ_DIR)
    rights |= dict.fromkeys(read, READ_FILE | READ_DIR)
    rights |= dict.fromkeys(written, files & ~EXECUTE)
    for path, allowed in rights.items():
        _add(library, ruleset, path, allowed & files)
    _checked(library.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0))
    _checked(library.syscall(RESTRICT_SELF, ruleset, 0))
    os.close(ruleset)


def _add(library: ctypes.CDLL, ruleset: int, path: str, allowed: int) -> None:
    try:
        folder = os.open(path, os.O_PATH | os.O_CLOEXEC)  # type: ignore[attr-defined, unused-ignore]
    except FileNotFoundError:
        return
    try:
        rule = _FolderRule(allowed if os.path.isdir(path) else allowed & OF_A_FILE, folder)
        _checked(library.syscall(ADD_RULE, ruleset, PATH_BENEATH, ctypes.byref(rule), 0))
    finally:
        os.close(folder)


def _library() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _checked(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"Landlock: {errno.errorcode.get(number, number)}: {os.strerror(number)}")
    return result
