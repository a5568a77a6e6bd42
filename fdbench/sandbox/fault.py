"""What went wrong in a plug-in, where in its own files, and after which calls, as a worker answers it."""

import os
import traceback
from typing import Any

from fdbench.sandbox.confine import Refused

LONGEST_TEXT, LONGEST_TRACEBACK, MOST_FRAMES = 500, 20_000, 40


def described(error: BaseException, own: tuple[str, ...], memory_MB: float) -> dict[str, Any]:
    """Return what is said of an error.

    Parameters
    ----------
    error : BaseException
    own : tuple of str
        Files, and folders of packages, in which it is located.
    memory_MB : float
        How much memory was allowed.
    """
    frames = traceback.extract_tb(error.__traceback__)
    inside = [frame for frame in frames if is_own(frame.filename, own)]
    place = f"{os.path.basename(inside[-1].filename)}:{inside[-1].lineno}" if inside else ""
    text = _text(error)
    if isinstance(error, Refused):
        said = text
    elif isinstance(error, MemoryError):
        said = f"needed more than {memory_MB:g} MB of memory{f' ({text})' if text else ''}"
    else:
        said = f"{_name(error)}: {text}" if text else _name(error)
    # The calls into a module that cannot be imported are those of the cause.
    calls = (
        frames if inside or error.__cause__ is None else [*frames, *traceback.extract_tb(error.__cause__.__traceback__)]
    )
    shown = "".join(traceback.format_list(calls[-MOST_FRAMES:]))[-LONGEST_TRACEBACK:]
    return {
        "place": place,
        "text": said,
        "traceback": f"Traceback (most recent call last):\n{shown}{said}\n",
        "is_fatal": isinstance(error, MemoryError) or not isinstance(error, Exception),
    }


def is_own(file: str, own: tuple[str, ...]) -> bool:
    """Return whether a file is one of some files, or lies in one of some folders."""
    return any(file == path or file.startswith(f"{path}/") for path in own)


def _text(error: BaseException) -> str:
    try:
        return " ".join(str(error)[: 10 * LONGEST_TEXT].split())[:LONGEST_TEXT]
    except BaseException:  # noqa: BLE001 - the text of an error is made by the plug-in
        return "its text cannot be made"


def _name(error: BaseException) -> str:
    return type.__dict__["__name__"].__get__(type(error))[:LONGEST_TEXT]  # type: ignore[no-any-return]
