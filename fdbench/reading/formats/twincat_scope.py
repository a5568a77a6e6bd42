"""TwinCAT Scope's text export: a head of several lines for each channel, times beside the values."""

import re
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._cells import number_in
from fdbench.reading.formats._format import Log, Raw, unique
from fdbench.reading.formats._text import text_of

FILETIME_S = 1e-7  # one tick of the times of Windows
EARLIEST_FILETIME = 1e15  # as milliseconds, thirty thousand years
LONGEST_HEAD = 1000  # lines
_FILETIME = re.compile("[0-9]{1,19}")


class _Head(NamedTuple):
    """What stands above the numbers: the names with None for a column of times, their units, and more."""

    names: list[str | None]
    units: list[str]
    span_s: float
    is_scaled: bool
    lines: int
    delimiter: str


@final
class TwincatScope(Log):
    """What TwinCAT Scope exports as CSV: between tabs, semicolons or bars, times in milliseconds or as file times.

    ``Name`` in the line of names stands above a column of times; it is followed by the channels that share them. Cells
    are empty, or missing at the end of a line, where a channel has no more samples. The decimal sign is that of the
    exporting computer. Each column of times is a clock here, called after its first channel.

    Layout from Beckhoff's Infosys (TE13xx, "Export in csv"; TwinCAT 2 "Scope settings") and the exports of TwinCAT
    Scope 3.4.3145.3 in the tests of CagtayFabry/pytcs. The samples in the tests are written after these exports, not by
    TwinCAT.
    """

    suffixes = ()
    is_text = True
    largest_bytes = 2**28
    usual_position_unit = "mm"

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file begins with the name of the project, and a channel has a sampling time."""
        return head[:4] == b"Name" and head[4:5] in (b"\t", b";", b"|", b",", b" ") and b"\nSampleTime" in head

    def read_all(self, file: Path) -> Raw:
        """Return all channels on their clocks."""
        lines = text_of(file).splitlines()
        head = _head(lines, file)
        cells = _values(lines, head, file)
        names = unique([name for name in head.names if name is not None])
        columns: dict[str, NDArray[Any]] = {}
        clocks: dict[str, str] = {}
        units: dict[str, str] = {}
        of_channel = iter(zip(names, head.units, strict=True))
        clock = ""
        for place, name in enumerate(head.names):
            values = np.array(cells[place])
            if name is None:
                clock = f"time of {head.names[place + 1]}" if place + 1 < len(head.names) else ""
                is_filetime = len(values) > 0 and values[0] > EARLIEST_FILETIME
                columns[clock] = FILETIME_S * (values - values[0]) if is_filetime else 1e-3 * values
                units[clock] = "s"
                continue
            known, unit = next(of_channel)
            if len(values) != len(columns[clock]):
                raise RecordError(
                    f"{file}: channel {name} has {len(values)} values at {len(columns[clock])} times. The file was cut."
                )
            columns[known], clocks[known], units[known] = values, clock, unit
        for clock in dict.fromkeys(clocks.values()):
            times = columns[clock]
            step_s = float(times[-1] - times[-2]) if len(times) > 1 else 0.0
            if not len(times) or head.span_s - times[-1] > 2.0 * step_s:
                end_s = float(times[-1]) if len(times) else 0.0
                raise RecordError(
                    f"{file}: '{clock}' ends at {end_s:.6g} s, the head says {head.span_s:.6g} s. The file was cut."
                )
        scaled = "a channel has a scale factor, and the file does not say whether its values are scaled"
        return Raw(columns=columns, units=units, clocks=clocks, notes=[scaled] if head.is_scaled else [])


def _head(lines: list[str], file: Path) -> _Head:
    delimiter = lines[0][4:5] if lines and lines[0].startswith("Name") else ""
    if not delimiter:
        raise RecordError(f"{file}: no TwinCAT Scope export, which begins with 'Name'.")
    if delimiter not in "\t;|":
        raise RecordError(f"{file}: cells between {delimiter!r} cannot be told from decimals. Export with tabs.")
    rows = [line.split(delimiter) for line in lines[:LONGEST_HEAD]]
    starts = [place for place, row in enumerate(rows) if row[0] == "Name"]
    if len(starts) < 2:
        raise RecordError(f"{file}: a TwinCAT Scope export without a line of channel names.")
    stop = next((place for place in range(starts[1], len(rows)) if not lines[place].strip()), len(rows))
    if stop == LONGEST_HEAD:
        raise RecordError(f"{file}: no blank line below the head within {LONGEST_HEAD} lines.")
    above = {row[0].lower(): row for row in rows[: starts[1]]}
    about = {row[0].lower(): row for row in rows[starts[1] : stop]}
    names = [None if cell == "Name" else cell for cell in rows[starts[1]]]
    if names[-1] == "":
        names.pop()
    places = [place for place, name in enumerate(names) if name is not None]

    def of_channels(key: str) -> list[str]:
        row = about.get(key, [])
        return [row[place].strip() if place < len(row) else "" for place in places]

    start, end = (
        next((row[1] for key, row in above.items() if key.startswith(word) and len(row) > 1), "0")
        for word in ("start", "end")
    )
    are_filetimes = all(_FILETIME.fullmatch(text) for text in (start, end))
    span_s = FILETIME_S * (int(end) - int(start)) if are_filetimes else 0.0
    scales = [*of_channels("scalefactor"), *of_channels("unit scalefactor")]
    units = [unit.partition(" (")[0] if unit != "(None)" else "" for unit in of_channels("unit")]
    return _Head(names, units, span_s, any(scale not in ("", "1") for scale in scales), stop + 1, delimiter)


def _values(lines: list[str], head: _Head, file: Path) -> list[list[float]]:
    columns: list[list[float]] = [[] for _ in head.names]
    for number, line in enumerate(lines[head.lines :], head.lines + 1):
        if line.strip() in ("", "EOF"):
            continue
        row = line.rstrip(head.delimiter).split(head.delimiter)
        if len(row) > len(columns):
            raise RecordError(
                f"{file}: line {number} has {len(row)} cells for {len(columns)} columns of names. Export with a column "
                "of times (Timelines: All)."
            )
        for column, cell in zip(columns, row, strict=False):
            if cell := cell.strip():
                try:
                    column.append(number_in(cell.replace(",", ".")))
                except ValueError:
                    raise RecordError(f"{file}: line {number}: {cell[:60]!r} is not a number.") from None
    return columns
