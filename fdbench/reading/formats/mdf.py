"""ASAM MDF measurement files (extra ``logs``): groups of channels, each group on its clock."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Literal, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._format import Log, Raw, library

DEEPEST = 3  # header, data group, channel group, channel
LEAST_S, BYTES_PER_S = 60.0, 1e6  # that a reader may take


class Signal(NamedTuple):
    """A channel of numbers: name, group, unit, values and times, s."""

    name: str
    group: int
    unit: str
    samples: NDArray[Any]
    times: NDArray[Any]


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
        signals, fault = _signals(file)
        if fault:
            raise RecordError(f"{file}: not an MDF file, or a damaged one: {fault}")
        columns: dict[str, NDArray[Any]] = {}
        clocks: dict[str, str] = {}
        units: dict[str, str] = {}
        for signal in signals:
            clock = f"time of group {signal.group}"
            columns.setdefault(clock, signal.times)
            name = signal.name if signal.name not in columns else f"{signal.name} (group {signal.group})"
            columns[name], clocks[name], units[name] = signal.samples, clock, signal.unit
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


def _signals(file: Path) -> tuple[list[Signal], str]:
    """Return the channels of numbers, or what is wrong with the file.

    asammdf reads in a process of its own: of a damaged file, its machine code may write where it should not.
    """
    library("asammdf", file)
    with tempfile.TemporaryDirectory() as place:
        written = Path(place) / "signals.npz"
        command = [sys.executable, "-P", "-m", "fdbench.reading.formats._mdf_child", str(file), str(written)]
        package = str(Path(__file__).resolve().parents[3])
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([package, os.environ.get("PYTHONPATH", "")])}
        limit_s = LEAST_S + file.stat().st_size / BYTES_PER_S
        try:
            done = subprocess.run(command, capture_output=True, timeout=limit_s, check=False, env=environment)
        except subprocess.TimeoutExpired:
            return [], f"its reader asammdf takes more than {limit_s:.0f} s."
        said = done.stdout.decode("utf-8", errors="replace").strip()
        if done.returncode or not written.is_file():
            return [], said or f"its reader asammdf crashed ({done.returncode})."
        with np.load(written) as arrays:
            facts = json.loads(said)
            found = [
                Signal(name, group, unit, arrays[f"{n}.samples"], arrays[f"{n}.times"])
                for n, (name, group, unit) in enumerate(facts)
            ]
            return found, ""
