"""Records: named columns of samples on a uniform clock, with units in the names and provenance.

Writes CSV and Parquet; `fdbench.reading` reads them.
"""

import difflib
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError, UnknownName, did_you_mean
from fdbench.files import replaced
from fdbench.units import UNITS, split_unit

FloatArray = NDArray[np.float64]
T = TypeVar("T")

# The known columns. Those of one axis of several carry the prefix x_ or y_.
COLUMNS: dict[str, str] = {
    "time_s": "time of the sample",
    "reference_position_m": "position that the controller is asked for",
    "reference_velocity_m_per_s": "velocity that the controller is asked for",
    "reference_acceleration_m_per_s2": "acceleration that the controller is asked for",
    "position_m": "position that closes the loop",
    "velocity_m_per_s": "velocity that closes the loop",
    "acceleration_m_per_s2": "acceleration of the table",
    "motor_position_m": "position of the motor's encoder times the lead",
    "motor_velocity_m_per_s": "velocity of the motor times the lead",
    "table_position_m": "position of the table's scale",
    "table_velocity_m_per_s": "velocity of the table's scale",
    "motor_force_N": "command at the motor in table coordinates",
    "motor_torque_Nm": "torque command at the motor",
    "motor_current_A": "current command at the motor",
    "process_force_N": "force of the process against positive motion",
    "disturbance_N": "force against positive motion that the nominal plant lacks",
    "force_N": "resultant cutting force",
    "displacement_m": "displacement of the spindle",
    "spindle_angle_rad": "angle of the spindle",
    "spindle_speed_rad_per_s": "speed of the spindle",
    "feedrate_m_per_s": "commanded feedrate",
    "temperature_K": "temperature of the axis",
    "training_sample": "1 where the force is measured, 0 where it is withheld and to be estimated",
    "held_sample": "1 where the sample repeats the last one, else 0",
}

# Those of a rotary axis, beside motor_torque_Nm and motor_current_A.
ROTARY_COLUMNS: dict[str, str] = {
    "reference_position_rad": "angle that the controller of a rotary axis is asked for",
    "reference_velocity_rad_per_s": "speed that the controller of a rotary axis is asked for",
    "reference_acceleration_rad_per_s2": "acceleration that the controller of a rotary axis is asked for",
    "position_rad": "angle that closes the loop of a rotary axis",
    "velocity_rad_per_s": "speed that closes the loop of a rotary axis",
    "acceleration_rad_per_s2": "acceleration of the load of a rotary axis",
    "motor_velocity_rad_per_s": "speed of a rotary axis by the encoder of its motor",
    "table_velocity_rad_per_s": "speed of a rotary axis by that of its load",
    "motor_position_rad": "angle of a rotary axis by the encoder of its motor",
    "table_position_rad": "angle of a rotary axis by that of its load",
}

# What others call the side that is the table's here.
OTHERWISE = dict.fromkeys(("load", "carriage", "slide", "scale"), "table")

# Sampling times beyond which a clock is damaged, or in another unit.
SHORTEST_S, LONGEST_S = 1e-9, 1e6

# A step of the clock may differ from the sampling time by this share of it.
CLOCK_TOLERANCE = 1e-3


def nth_sample(index: int) -> str:
    """Return how a message calls a sample."""
    return f"sample {index}"


class _UnknownColumn(UnknownName, KeyError):
    """A KeyError too, so that ``in`` and ``get`` work as on any mapping."""

    __str__ = Exception.__str__


@dataclass(frozen=True, eq=False)
class Record(Mapping[str, FloatArray]):
    """Samples of a drive; ``record["velocity_m_per_s"]`` is a read-only column.

    Two records are equal if they have the same columns, in the same order, with the same values.

    Parameters
    ----------
    columns : mapping of str to (n_samples,) array
        ``time_s`` and the measured channels; the suffix of a name is its unit (see ``COLUMNS``). Copied, and read-only
        from then on.
    provenance : mapping
        Where the record comes from: scenario and seed, or file and digest.
    source : str
        Name for messages.

    Raises
    ------
    RecordError
        If a column has an unknown name, a wrong length, a value that is not a finite number, or the clock is
        not uniform.

    Examples
    --------
    >>> record = Record({"time_s": [0.0, 0.5, 1.0], "motor_force_N": [1.0, 2.0, 3.0]})
    >>> record.n_samples, record.sampling_time_s, float(record["motor_force_N"].sum())
    (3, 0.5, 6.0)
    """

    columns: Mapping[str, FloatArray]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    source: str = "record"

    def __post_init__(self) -> None:
        if "time_s" not in self.columns:
            raise RecordError(
                f"{self.source}: column time_s is missing.{did_you_mean('time_s', self.columns)} "
                "A mapping file can give sampling_time_s in its place."
            )
        length = np.size(self.columns["time_s"])
        frozen: dict[str, FloatArray] = {}
        for name, values in self.columns.items():
            check_column_name(name, self.source)
            frozen[name] = _frozen_column(name, values, length, self.source)
        object.__setattr__(self, "columns", MappingProxyType(frozen))
        object.__setattr__(self, "provenance", dict(self.provenance))
        check_finite(frozen, self.source)
        check_clock(frozen["time_s"], self.source)

    def __getitem__(self, name: str) -> FloatArray:
        try:
            return self.columns[name]
        except KeyError:
            raise _UnknownColumn(f"{self.source}: no column {name}.{did_you_mean(name, self.columns)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(self.columns)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Record):
            return NotImplemented
        return list(self) == list(other) and all(np.array_equal(self[name], other[name]) for name in self)

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[type["Record"], tuple[object, ...]]:
        """Pickle as the call of the class: arrays that come out of a pickle by themselves are writeable."""
        return Record, (dict(self.columns), self.provenance, self.source)

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(self.columns["time_s"])

    @property
    def sampling_time_s(self) -> float:
        """Time between two samples."""
        time = self.columns["time_s"]
        return float((time[-1] - time[0]) / (len(time) - 1))

    def slice(self, start: int, stop: int) -> "Record":
        """Return samples ``start`` up to, but without, ``stop``, with the same columns and provenance."""
        if not 0 <= start < stop <= self.n_samples:
            raise RecordError(
                f"{self.source}: no slice {start} to {stop}; allowed: 0 <= start < stop <= {self.n_samples}."
            )
        part = {name: column[start:stop] for name, column in self.columns.items()}
        return Record(part, self.provenance, f"{self.source}[{start}:{stop}]")

    def save(self, path: str | Path) -> None:
        """Write the record as CSV or Parquet, whichever the extension of ``path`` says."""
        writers = {".csv": self.to_csv, ".parquet": self.to_parquet}
        suffix = Path(path).suffix.lower()
        if suffix not in writers:
            raise RecordError(f"{path}: a record cannot be written as '{suffix}'.{did_you_mean(suffix, writers)}")
        writers[suffix](path)

    def to_csv(self, path: str | Path) -> None:
        """Write as CSV: a comment line ``# fdbench {provenance}``, the names, numbers that read back bit for bit."""
        from pyarrow import csv as arrow_csv

        head = f"# fdbench {self._provenance_text()}\n{','.join(self.columns)}\n"
        with replaced(path, RecordError) as partial, partial.open("wb") as file:
            file.write(head.encode())
            arrow_csv.write_csv(self._table(), file, arrow_csv.WriteOptions(include_header=False))

    def to_parquet(self, path: str | Path) -> None:
        """Write as Parquet, with the provenance as metadata ``fdbench`` of the schema."""
        from pyarrow import parquet

        table = self._table().replace_schema_metadata({"fdbench": self._provenance_text()})
        with replaced(path, RecordError) as partial, partial.open("wb") as file:
            parquet.write_table(table, file, write_page_checksum=True)

    def _table(self) -> Any:
        import pyarrow

        return pyarrow.table(dict(self.columns))

    def _provenance_text(self) -> str:
        try:
            return json.dumps(self.provenance)
        except TypeError as error:
            raise RecordError(f"{self.source}: the provenance cannot be written: {error}.") from error


def held_samples(record: Record) -> NDArray[np.bool_]:
    """Return where a sample repeats the last one in every measured channel, shape (n_samples,).

    A held sample is an effect of its own (a dropped sample), not a fault. Time and references run on while
    the measurement is held, so they do not count. A column ``held_sample`` in the record is taken at its word.

    >>> held_samples(Record({"time_s": [0.0, 1.0, 2.0], "position_m": [4.0, 4.0, 5.0]})).tolist()
    [False, True, False]
    """
    if "held_sample" in record:
        return np.not_equal(record["held_sample"], 0.0)
    measured = [column for name, column in record.items() if name != "time_s" and "reference_" not in name]
    held = np.zeros(record.n_samples, dtype=np.bool_)
    if measured:
        held[1:] = np.logical_and.reduce([column[1:] == column[:-1] for column in measured])
    return held


# ---- checks ----


def check_column_name(name: str, source: str) -> None:
    """Raise RecordError if ``name`` is neither a known column nor one with an SI unit as suffix."""
    fault = name_fault(name)
    if fault:
        entry = f'name = {{ from = "{name}", unit = ... }}'
        hint = f" A mapping file can rename and convert it: [columns] {entry}; `fdbench import` writes one."
        raise RecordError(f"{source}: {fault}{hint if name else ''}")


@lru_cache(maxsize=1024)
def name_fault(name: str) -> str:
    """Return what is wrong with a column name, or an empty text."""
    prefix = name[:2] if name[:2] in ("x_", "y_") else ""
    plain = name.removeprefix(prefix)
    if plain in ROTARY_COLUMNS or (plain in COLUMNS and (not prefix or plain != "time_s")):
        return ""
    if not name:
        return "a column has no name. If pandas wrote its index: write with index=False."
    allowed_names = COLUMNS | ROTARY_COLUMNS if "rad" in name else COLUMNS
    known = [prefix + column for column in allowed_names if not prefix or column != "time_s"]
    stem, suffix = split_unit(plain)
    if not suffix or not re.fullmatch("[a-z][a-z0-9_]*", stem):
        allowed = "others are accepted in lower case with an SI unit at the end"
        return f"unknown column '{name}'; {allowed}.{did_you_mean(name, known)}"
    same = [column for column in known if stem == split_unit(column.removeprefix(prefix))[0]]
    if same:
        return f"column '{name}' is in {UNITS[suffix]}; allowed: {' or '.join(same)}."
    for column in known:
        if _looks_like(name, column):
            return f"unknown column '{name}'. Did you mean {column}?"
    return ""


def _looks_like(name: str, known: str) -> bool:
    """Whether all words of two names agree but one, which differs by a slip of the pen or is what others call it."""
    words, expected = name.split("_"), known.split("_")
    different = [pair for pair in zip(words, expected, strict=False) if pair[0] != pair[1]]
    if len(words) != len(expected) or len(different) != 1:
        return False
    word, other = different[0]
    if OTHERWISE.get(word) == other:
        return True
    return word[0:1] == other[0] and word.isalpha() and difflib.SequenceMatcher(None, word, other).ratio() >= 0.8


def _frozen_column(name: str, values: object, length: int, source: str) -> FloatArray:
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise RecordError(f"{source}: column {name} holds {array.dtype}, not real numbers.")
    if array.shape != (length,):
        raise RecordError(f"{source}: column {name} has shape {array.shape}, time_s has ({length},).")
    column = np.array(array, dtype=np.float64)
    column.flags.writeable = False
    return column.view()  # unlike an array of its own, a view of a read-only one cannot be made writeable


def check_finite(columns: Mapping[str, NDArray[Any]], source: str, place: Callable[[int], str] = nth_sample) -> None:
    """Raise RecordError at the first NaN or infinite value; ``place`` words where a sample lies."""
    for name, column in columns.items():
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise RecordError(
                f"{source}: column {name} is {column[bad[0]]} at {place(int(bad[0]))} ({bad.size} of {len(column)} "
                "values are not finite). A record has no holes: cut the part out, or interpolate and say so."
            )


def check_clock(time_s: FloatArray, source: str, place: Callable[[int], str] = nth_sample) -> None:
    """Raise RecordError unless the clock is uniform.

    Each step may differ from the median step by ``CLOCK_TOLERANCE``; errors do not add up, so a slow drift of a
    real clock passes. A uniform clock that was rounded when it was written passes too, down to a tenth of a step.
    """
    if len(time_s) < 3:
        raise RecordError(f"{source}: {len(time_s)} samples; a record needs at least 3.")
    steps = np.diff(time_s)
    sampling_time = float(np.median(steps))

    def between(step: int) -> str:
        return f"{place(step + 1)}: from {float(time_s[step])!r} s to {float(time_s[step + 1])!r} s"

    backward = np.flatnonzero(steps <= 0.0)
    if backward.size:
        raise RecordError(
            f"{source}: time_s does not increase at {between(int(backward[0]))}. "
            "Remove repeated rows, and split the file where two recordings were joined."
        )
    if not SHORTEST_S <= sampling_time <= LONGEST_S:
        raise RecordError(
            f"{source}: the sampling time is {sampling_time:.6g} s; allowed: {SHORTEST_S:g} to {LONGEST_S:g} s. "
            "Probably time_s is in another unit."
        )
    jumps = np.flatnonzero(steps > 1.5 * sampling_time)
    if jumps.size:
        missing = round(steps[jumps[0]] / sampling_time) - 1
        raise RecordError(
            f"{source}: time_s jumps at {between(int(jumps[0]))}; {missing} samples of {sampling_time:.6g} s seem "
            f"to be missing ({jumps.size} jumps in all). Split the record there, or fill the gap and say so."
        )
    deviations = np.abs(steps - sampling_time)
    uneven = np.flatnonzero(deviations > CLOCK_TOLERANCE * sampling_time)
    if uneven.size and not _is_rounded_grid(time_s):
        raise RecordError(
            f"{source}: time_s is not uniform at {between(int(uneven[0]))}; the steps differ by up to "
            f"{deviations.max() / sampling_time:.2g} of the sampling time {sampling_time:.6g} s, allowed is "
            f"{CLOCK_TOLERANCE:g}. Resample; or, if the clock is uniform and only its log is not, give sampling_time_s "
            "in a mapping file in place of the column."
        )


def _is_rounded_grid(time_s: FloatArray) -> bool:
    step = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    resolution = _clock_resolution_s(time_s)
    grid = time_s[0] + step * np.arange(len(time_s))
    return bool(resolution <= 0.1 * step and np.abs(time_s - grid).max() <= 1.001 * resolution)


def _clock_resolution_s(time_s: FloatArray) -> float:
    """Return the unit that the times were rounded to: a power of ten, the spacing of single precision, or 0."""
    for digits in range(1, 10):
        ticks = time_s * 10.0**digits
        if np.abs(ticks - np.rint(ticks)).max() <= 4.0 * np.spacing(np.abs(ticks).max()):
            return 10.0**-digits
    single = time_s.astype(np.float32)
    return float(np.spacing(np.abs(single).max())) if np.array_equal(single, time_s) else 0.0
