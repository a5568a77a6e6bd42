"""TwinCAT Scope's binary export (.svb): a head, a header for each channel, then times and values."""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._format import MOST_COLUMNS, Log, Raw, unique

TICK_S = 1e-7  # of a FILETIME of Windows
STAMP_BYTES = 4
YEAR_TICKS = 365.2425 * 86400.0 / TICK_S
YEARS = 370.0, 600.0  # from 1601 on, in which files are recorded
LARGEST_HEAD = 2**24  # bytes

TYPES: Mapping[str, str] = {
    **{"REAL64": "<f8", "REAL32": "<f4", "BIT": "<u1", "BIT8": "<u1"},
    **{f"INT{8 * size}": f"<i{size}" for size in (1, 2, 4, 8)},
    **{f"UINT{8 * size}": f"<u{size}" for size in (1, 2, 4, 8)},
}


class _Channel(NamedTuple):
    """What the header of a channel says; the sampling time is in ticks."""

    name: str
    sample_time: int
    kind: str
    size: int
    samples: int
    data_bytes: int
    start: int
    scale: tuple[float, float]


class _Reader:
    """Takes numbers and texts from the head, in little-endian order."""

    def __init__(self, content: bytes, place: int = 0) -> None:
        self._content, self.place = content, place

    def take(self, code: str) -> Any:
        (value,) = struct.unpack_from(f"<{code}", self._content, self.place)
        self.place += struct.calcsize(f"<{code}")
        return value

    def text(self) -> str:
        size = self.take("i")
        if not 0 <= size <= len(self._content) - self.place:
            raise ValueError(f"a text of {size} bytes")
        self.place += size
        return self._content[self.place - size : self.place].decode("utf-8", errors="replace")


@final
class TwincatSvb(Log):
    """What TwinCAT Scope 3 exports as ``svb`` with its head in the same file; each channel has its own times.

    Times are ticks of 100 ns since the start of the record, in 32 bits, which run over every 429.5 s; without them the
    sampling time counts. Units are not in the file, nor whether its values are scaled.

    Layout from Beckhoff's Infosys (TE13xx, "Export to svb"); where it is open, by a public reader of such files that
    counts on the size of the head, positions from the begin of the file, and times before each value. The samples in
    the tests are written after these, not by TwinCAT.
    """

    suffixes = (".svb",)
    usual_position_unit = "mm"

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file begins with a plausible head, as it has no magic bytes."""
        try:
            _, start, end, count = _main(_Reader(head))
        except (struct.error, ValueError):
            return False
        low, high = (years * YEAR_TICKS for years in YEARS)
        return low < start < high and start <= end < high and 0 < count <= MOST_COLUMNS

    def read_all(self, file: Path) -> Raw:
        """Return all channels on their clocks."""
        with file.open("rb") as stream:
            head = stream.read(LARGEST_HEAD)
        try:
            channels = _channels(head)
        except (struct.error, ValueError) as error:
            raise RecordError(f"{file}: not a binary export of TwinCAT Scope, or a damaged one: {error}.") from error
        columns: dict[str, NDArray[Any]] = {}
        clocks: dict[str, str] = {}
        for name, channel in zip(unique([channel.name for channel in channels]), channels, strict=True):
            clock = f"time of {name}"
            columns[clock], columns[name] = _samples(file, channel)
            clocks[name] = clock
        is_scaled = any(sorted(channel.scale) != [0.0, 1.0] for channel in channels)
        scaled = "a channel has a scale factor or an offset, and the file does not say whether its values are scaled"
        return Raw(
            columns=columns,
            units=dict.fromkeys(clocks.values(), "s"),
            clocks=clocks,
            notes=[scaled] if is_scaled else [],
        )


def _main(reader: _Reader) -> tuple[int, int, int, int]:
    """Return size of the head, first and last time in ticks, and number of channels."""
    size = reader.take("q")
    reader.text()
    return size, reader.take("q"), reader.take("q"), reader.take("i")


def _channels(head: bytes) -> list[_Channel]:
    reader = _Reader(head)
    size, _, _, count = _main(reader)
    if not 0 < count <= MOST_COLUMNS:
        raise ValueError(f"{count} channels")
    found = [_channel(reader) for _ in range(count)]
    if reader.place != size:
        raise ValueError(f"a head of {reader.place} bytes that says it has {size}")
    return found


def _channel(reader: _Reader) -> _Channel:
    begin, size = reader.place, reader.take("q")
    name = reader.text()
    reader.text()  # net id
    reader.take("i")  # port
    sample_time = reader.take("q")
    reader.take("?")  # whether it has a symbol
    reader.text()
    reader.text()  # comment
    reader.take("q")  # index group
    reader.take("q")  # index offset
    kind = reader.text()
    reader.take("i")  # number of the kind
    size_of_value, samples, data_bytes, start = (reader.take(code) for code in "iqqq")
    scale = reader.take("d"), reader.take("d")
    channel = _Channel(name, sample_time, kind.removeprefix("ADST_"), size_of_value, samples, data_bytes, start, scale)
    reader.take("q")  # bit mask
    if reader.place - begin != size:
        raise ValueError(f"channel '{name}' has a header of {reader.place - begin} bytes that says it has {size}")
    return channel


def _samples(file: Path, channel: _Channel) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return times, s, and values."""
    where = f"{file}: channel '{channel.name}'"
    code = TYPES.get(channel.kind)
    if code is None or np.dtype(code).itemsize != channel.size:
        raise RecordError(f"{where} holds {channel.size} bytes of {channel.kind}; read are {', '.join(TYPES)}.")
    has_times = channel.data_bytes == channel.samples * (channel.size + STAMP_BYTES)
    if channel.samples < 1 or not (has_times or channel.data_bytes == channel.samples * channel.size):
        raise RecordError(f"{where} has {channel.samples} values in {channel.data_bytes} bytes.")
    if channel.start < 0 or channel.start + channel.data_bytes > file.stat().st_size:
        raise RecordError(f"{where} ends behind the end of the file. The file was cut.")
    kind = np.dtype([("time", "<u4"), ("value", code)] if has_times else [("value", code)])
    data = np.fromfile(file, kind, channel.samples, offset=channel.start)
    if not has_times:
        return TICK_S * channel.sample_time * np.arange(channel.samples), data["value"]
    steps = np.diff(data["time"])  # in 32 bits, so that a clock that runs over goes on
    ticks = np.concatenate(([int(data["time"][0])], steps.astype(np.int64))).cumsum()
    return TICK_S * ticks, data["value"]
