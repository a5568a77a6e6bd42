"""What a file format is: how a file is told to be of it, and how its columns are read as they stand."""

import difflib
import hashlib
import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from fdbench.documents import json_value
from fdbench.errors import LONGEST_LIST, LONGEST_NAME, RecordError
from fdbench.reading.formats._whole import surveyed
from fdbench.record import check_column_name, nth_sample
from fdbench.registry import Registry

MOST_COLUMNS = 2000  # of a file
CLOCK_SLACK = 1e-3  # of a sampling time, by which the times of two clocks may differ


class _Everything(Collection[str]):
    """Stands for the names of all columns that hold numbers."""

    def __contains__(self, name: object) -> bool:
        return True

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


EVERYTHING = _Everything()


@dataclass(frozen=True, kw_only=True)
class Raw:
    """The columns as a file has them, and what it says of them.

    Parameters
    ----------
    columns : mapping of str to (n_samples,) array
        Columns, of one length unless they have several clocks.
    provenance : mapping
        What the file says of its origin.
    left_out : sequence of str
        Names of the columns that were not read.
    place : callable
        Words that say where a sample lies in the file.
    units : mapping
        Column -> unit, in the words of the file.
    labels : mapping
        Column -> what the file says that it is, where that is more than its name.
    clocks : mapping
        Column -> the column of its times, in a file with several clocks.
    gaps : sequence of int
        First samples after lost ones, where the file says so and has no times.
    stamps : sequence of str
        Columns of dates and times of day, which are read as seconds from the first of them.
    notes : sequence of str
        Sentences on what the file does not say, or says in a way that could surprise.
    """

    columns: Mapping[str, NDArray[Any]]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    left_out: Collection[str] = ()
    place: Callable[[int], str] = nth_sample
    units: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[str, str] = field(default_factory=dict)
    gaps: Collection[int] = ()
    stamps: Collection[str] = ()
    notes: Collection[str] = ()


class Format(ABC):
    """One kind of file; file name = ``format`` in [record] of a mapping.

    A format that can be written in several ways is a frozen dataclass: its fields are its keys in [record].
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]  # files that are of this format, whatever they begin with
    largest_bytes: ClassVar[int] = 2**32  # of a file
    is_text: ClassVar[bool] = False  # and may be compressed by gzip
    has_our_names: ClassVar[bool] = False  # files may be read without a mapping
    usual_sampling_time_s: ClassVar[float | None] = None  # of its producer, where files do not say
    usual_position_unit: ClassVar[str] = ""  # likewise

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether a file that begins with ``head``, up to 64 KiB, of text in UTF-8, is of this format."""
        return False

    @abstractmethod
    def read(self, file: Path, wanted: Collection[str] | None) -> Raw:
        """Return the wanted columns, `EVERYTHING` that holds numbers, or with None all, which have to have our names.

        Raises
        ------
        RecordError
            If the file is damaged, or lacks a column.
        """

    @classmethod
    def survey(cls, file: Path) -> tuple[Self, Raw]:
        """Return how a file is written, found from it alone, and all its columns of numbers."""
        reader = cls()
        return reader, surveyed(reader.read(file, EVERYTHING))


class Log(Format):
    """A format whose columns are all numbers, with names that are not ours."""

    @abstractmethod
    def read_all(self, file: Path) -> Raw:
        """Return all columns."""

    def read(self, file: Path, wanted: Collection[str] | None) -> Raw:
        """Return the wanted columns, with the times of their clocks."""
        raw = _with_equal_clocks_as_one(self.read_all(file))
        chosen = {*choose(list(raw.columns), wanted, file)}
        kept = chosen | {raw.clocks[name] for name in chosen if name in raw.clocks}
        columns = {name: column for name, column in raw.columns.items() if name in kept}
        return replace(raw, columns=columns, left_out=[name for name in raw.columns if name not in kept])


def choose(names: list[str], wanted: Collection[str] | None, file: Path) -> list[str]:
    """Return the names to read: those wanted by a mapping, or else all, which then have to be known.

    Raises
    ------
    RecordError
        If a wanted name is missing, two columns have one name, there are more than `MOST_COLUMNS`, or a name is not
        ours and none is wanted.
    """
    if len(names) > MOST_COLUMNS:
        raise RecordError(f"{file}: {len(names)} columns; at most {MOST_COLUMNS} are read. Split the file.")
    if len(set(names)) < len(names):
        twice = next(name for index, name in enumerate(names) if name in names[:index])
        raise RecordError(f"{file}: two columns are named '{twice}'. Rename one of them.")
    if wanted is None:
        for name in names:
            check_column_name(name, str(file))
        return names
    for name in sorted(wanted):
        if name not in names:
            nearest = difflib.get_close_matches(name[:LONGEST_NAME], names, n=1)
            hint = f" Did you mean {nearest[0]}?" if nearest else ""
            listed = ", ".join(names) if len(names) <= LONGEST_LIST else f"{len(names)} columns"
            raise RecordError(f"{file}: no column '{name}', which the mapping names. The file has: {listed}.{hint}")
    return [name for name in names if name in wanted]


def library(module: str, file: Path) -> Any:
    """Return a module of a package that only the extra ``logs`` installs.

    Raises
    ------
    RecordError
        If the package is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise RecordError(
            f"{file}: such files are read by the package {package}, which is not installed. To install it: "
            "pip install 'fdbench[logs]'."
        ) from error


def stored_provenance(text: str | bytes, file: Path) -> dict[str, Any]:
    """Return the provenance that fdbench wrote into a file.

    Raises
    ------
    RecordError
        If it is damaged.
    """
    try:
        stored = json_value(text, is_finite=False)
    except ValueError as error:
        raise RecordError(
            f"{file}: the provenance of fdbench is damaged ({error}). Remove it to read the file."
        ) from error
    if not isinstance(stored, dict):
        raise RecordError(f"{file}: the provenance of fdbench is no table. Remove it to read the file.")
    return stored


def origin(file: Path) -> dict[str, Any]:
    """Return name and digest of a file, as provenance."""
    with file.open("rb") as stream:
        return {"file": file.name, "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}


def unique(names: list[str]) -> list[str]:
    """Return names of which those that repeat an earlier one have a number.

    >>> unique(["t", "x", "t"])
    ['t', 'x', 't (2)']
    """
    counts: dict[str, int] = {}
    found = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        found.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return found


def _with_equal_clocks_as_one(raw: Raw) -> Raw:
    clocks = list(dict.fromkeys(raw.clocks.values()))
    first = {
        name: next(other for other in clocks if np.array_equal(raw.columns[other], raw.columns[name], equal_nan=True))
        for name in clocks
    }
    columns = {name: column for name, column in raw.columns.items() if first.get(name, name) == name}
    return replace(raw, columns=columns, clocks={name: first[clock] for name, clock in raw.clocks.items()})


def on_clock(raw: Raw, clock: str | None, source: str) -> Raw:
    """Return columns of several clocks at the times of one of them; the others hold their last value.

    Times at which one of them has no value yet, or has ended, are left out.

    Raises
    ------
    RecordError
        If the columns have several clocks and none is given, or have no time in common.
    """
    if not raw.clocks:
        return raw
    used = {raw.clocks[name] for name in raw.columns if name in raw.clocks}
    if clock is None and len(used) == 1:
        return replace(raw, columns={name: column for name, column in raw.columns.items() if name in raw.clocks})
    if clock is None or clock not in raw.columns:
        raise RecordError(
            f"{source}: the columns have {len(used)} clocks ({', '.join(sorted(used))}): a column time_s in [columns] "
            "of the mapping names the one at which they are read."
        )
    times = raw.columns[clock]
    step = _step(times)
    start = max(float(raw.columns[own][0]) for own in used)
    stop = min(float(raw.columns[own][-1] + _step(raw.columns[own])) for own in used)
    kept = (times >= start - CLOCK_SLACK * step) & (times < stop + CLOCK_SLACK * step)
    if not kept.any():
        raise RecordError(f"{source}: the clocks {', '.join(sorted(used))} have no time in common.")
    columns = {}
    for name, column in raw.columns.items():
        own = raw.columns[raw.clocks.get(name, name)]
        held = np.searchsorted(own, times[kept] + CLOCK_SLACK * step, side="right") - 1
        columns[name] = column[held]
    first = int(np.flatnonzero(kept)[0])
    return replace(raw, columns=columns, place=lambda sample: raw.place(first + sample))


def _step(times: NDArray[Any]) -> float:
    """Return how long the last value of a clock holds."""
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


formats: Registry[Format] = Registry("format", Format)  # type: ignore[type-abstract]
