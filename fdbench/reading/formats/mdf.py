"""ASAM MDF measurement files (extra ``logs``): groups of channels, each group on its clock."""

import gc
import logging
import sys
from pathlib import Path
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._format import Log, Raw, library

DEEPEST = 3  # header, data group, channel group, channel


@final
class Mdf(Log):
    """Versions 3 and 4, values converted to physical ones; channels of text, arrays and structures are left out.

    Layout: ASAM MDF, read by the package asammdf. The samples in the tests are written by asammdf, not by a logger.
    """

    suffixes = (".mf4", ".mdf")

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file begins with the identification block."""
        return head.startswith((b"MDF     ", b"UnFinMF "))

    def read_all(self, file: Path) -> Raw:
        """Return all channels that hold numbers."""
        _check_chains(file)
        signals, fault = _signals(library("asammdf", file), file)
        if fault:
            raise RecordError(f"{file}: not an MDF file, or a damaged one: {fault}")
        columns: dict[str, NDArray[Any]] = {}
        clocks: dict[str, str] = {}
        units: dict[str, str] = {}
        for signal in signals:
            if signal.samples.dtype.kind not in "biuf" or signal.samples.ndim != 1 or not len(signal.samples):
                continue
            clock = f"time of group {signal.group_index}"
            columns.setdefault(clock, np.asarray(signal.timestamps, dtype=np.float64))
            name = signal.name if signal.name not in columns else f"{signal.name} (group {signal.group_index})"
            columns[name], clocks[name], units[name] = np.asarray(signal.samples), clock, signal.unit or ""
        if not columns:
            raise RecordError(f"{file}: no channel of numbers.")
        return Raw(columns=columns, units=units | dict.fromkeys({*clocks.values()}, "s"), clocks=clocks)


def _check_chains(file: Path) -> None:
    """Raise a RecordError where groups or channels follow one another in a circle, in which asammdf would run for ever.

    Each block of a data group, a channel group and a channel has the address of the next one, and of the first one
    below it: ASAM MDF 4.1, sections 5.7 to 5.9, and 3.3, sections 4.4 to 4.6.
    """
    with file.open("rb") as stream:
        head = stream.read(64)
        is_old = head[8:9] < b"4"
        size, to_next = (4, 4) if is_old else (8, 24)
        order: Literal["little", "big"] = "big" if is_old and head[24:26] != bytes(2) else "little"
        seen: set[int] = set()
        waiting = [(64, 0)]
        while waiting:
            place, level = waiting.pop()
            while place > 0:
                if place in seen:
                    raise RecordError(f"{file}: a damaged MDF file: block {place} follows itself.")
                seen.add(place)
                stream.seek(min(place + to_next, 2**62))
                links = stream.read(2 * size)
                following, below = (int.from_bytes(part, order) for part in (links[:size], links[size:]))
                if level == 0:
                    following, below = 0, following  # the header has only the address of the first data group
                waiting += [(below, level + 1)] if below > 0 and level < DEEPEST else []
                place = following


def _signals(asammdf: Any, file: Path) -> tuple[list[Any], str]:
    """Return the signals, or what is wrong with the file."""
    # A reader of a damaged file, half made, fails once more when it is discarded; that goes to this hook.
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    fault = ""
    logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)  # what it logs of a damaged file is raised too
    try:
        with asammdf.MDF(file) as content:
            return list(content.iter_channels(skip_master=True, copy_master=True)), ""
    except Exception as error:  # noqa: BLE001 asammdf has no common base for what damaged files raise
        fault = " ".join(str(error).split()) or type(error).__name__
    finally:
        if fault:
            gc.collect()
        sys.unraisablehook = hook
    return [], fault
