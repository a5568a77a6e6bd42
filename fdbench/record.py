"""Records: named columns of samples on a uniform clock, with units in the names and provenance.

Reads CSV, Parquet and MAT files, as they are or through a TOML mapping; writes CSV and Parquet.
"""

import csv
import difflib
import hashlib
import itertools
import json
import math
import os
import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import MissingData, RecordError, SpecError, UnknownName, did_you_mean
from fdbench.units import UNITS, factor_to_si, si_unit, split_unit

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
    "held_sample": "1 where the sample repeats the last one, else 0",
}

# A step of the clock may differ from the sampling time by this share of it.
CLOCK_TOLERANCE = 1e-3

# File extension -> format.
FORMATS = {".csv": "csv", ".parquet": "parquet", ".mat": "mat"}


_NUMBERS = {
    decimal: re.compile(rf"[+-]?((\d+({point}\d*)?|{point}\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.IGNORECASE)
    for decimal, point in ((".", r"\."), (",", ","))
}


def _sample(index: int) -> str:
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
        ``time_s`` and the measured channels; the suffix of a name is its unit (see ``COLUMNS``).
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
        object.__setattr__(self, "columns", frozen)
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
        try:
            with Path(path).open("wb") as file:
                file.write(head.encode())
                arrow_csv.write_csv(self._table(), file, arrow_csv.WriteOptions(include_header=False))
        except OSError as error:
            raise RecordError(f"{path}: cannot be written: {error.strerror}.") from error

    def to_parquet(self, path: str | Path) -> None:
        """Write as Parquet, with the provenance as metadata ``fdbench`` of the schema."""
        from pyarrow import parquet

        table = self._table().replace_schema_metadata({"fdbench": self._provenance_text()})
        try:
            with Path(path).open("wb") as file:
                parquet.write_table(table, file)
        except OSError as error:
            raise RecordError(f"{path}: cannot be written: {error.strerror}.") from error

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
    fault = _name_fault(name)
    if fault:
        hint = f' A mapping file can rename and convert it: [columns] name = {{ from = "{name}", unit = ... }}.'
        raise RecordError(f"{source}: {fault}{hint if name else ''}")


@lru_cache(maxsize=1024)
def _name_fault(name: str) -> str:
    prefix = name[:2] if name[:2] in ("x_", "y_") else ""
    plain = name.removeprefix(prefix)
    if plain in COLUMNS and (not prefix or plain != "time_s"):
        return ""
    if not name:
        return "a column has no name. If pandas wrote its index: write with index=False."
    known = [prefix + column for column in COLUMNS if not prefix or column != "time_s"]
    stem, suffix = split_unit(plain)
    if not suffix or not re.fullmatch("[a-z][a-z0-9_]*", stem):
        allowed = "others are accepted in lower case with an SI unit at the end"
        return f"unknown column '{name}'; {allowed}.{did_you_mean(name, known)}"
    for column in known:
        if stem == split_unit(column.removeprefix(prefix))[0]:
            return f"column '{name}' is in {UNITS[suffix]}; allowed: {column}."
        if _looks_like(name, column):
            return f"unknown column '{name}'. Did you mean {column}?"
    return ""


def _looks_like(name: str, known: str) -> bool:
    """Whether all words of two names agree but one, which differs by a slip of the pen."""
    words, expected = name.split("_"), known.split("_")
    different = [pair for pair in zip(words, expected, strict=False) if pair[0] != pair[1]]
    if len(words) != len(expected) or len(different) != 1:
        return False
    word, other = different[0]
    return word[0:1] == other[0] and word.isalpha() and difflib.SequenceMatcher(None, word, other).ratio() >= 0.8


def _frozen_column(name: str, values: object, length: int, source: str) -> FloatArray:
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise RecordError(f"{source}: column {name} holds {array.dtype}, not real numbers.")
    if array.shape != (length,):
        raise RecordError(f"{source}: column {name} has shape {array.shape}, time_s has ({length},).")
    column = np.array(array, dtype=np.float64)
    column.flags.writeable = False
    return column


def check_finite(columns: Mapping[str, NDArray[Any]], source: str, place: Callable[[int], str] = _sample) -> None:
    """Raise RecordError at the first NaN or infinite value; ``place`` words where a sample lies."""
    for name, column in columns.items():
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise RecordError(
                f"{source}: column {name} is {column[bad[0]]} at {place(int(bad[0]))} ({bad.size} of {len(column)} "
                "values are not finite). A record has no holes: cut the part out, or interpolate and say so."
            )


def check_clock(time_s: FloatArray, source: str, place: Callable[[int], str] = _sample) -> None:
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


# ---- reading ----


class _Layout(NamedTuple):
    """How a CSV file is written."""

    delimiter: str = ","
    decimal: str = "."


class _Raw(NamedTuple):
    """The columns as a file has them, what it says of their origin, the names left out, and where a sample lies."""

    columns: dict[str, NDArray[Any]]
    provenance: dict[str, Any]
    left_out: list[str]
    place: Callable[[int], str] = _sample


class _Rule(NamedTuple):
    """How a column of the record comes from one of the file."""

    source: str
    factor: float
    gain: float
    offset: float

    def apply(self, raw: NDArray[Any]) -> FloatArray:
        values = raw.astype(np.float64)
        with np.errstate(over="ignore"):
            for factor in (self.factor, self.gain):
                values = values if factor == 1.0 else values * factor
            return values if self.offset == 0.0 else values + self.offset


def read_record(path: str | Path, data_folder: str | Path | None = None) -> Record:
    """Read a record from a CSV, Parquet or MAT file whose columns have our names, or from a TOML mapping.

    Parameters
    ----------
    path : path
        The file; a mapping ends in ``.toml`` (see ``read_mapped``).
    data_folder : path or None
        For a mapping: the folder of its data file, in place of the mapping's own.

    Raises
    ------
    RecordError
        If the file or its data are at fault.
    SpecError
        If the mapping breaks its schema.
    """
    file = Path(path)
    if file.suffix.lower() == ".toml":
        return read_mapped(_read_toml(file), file.parent if data_folder is None else data_folder, str(file))
    if data_folder is not None:
        raise RecordError(f"{file}: data_folder is for mapping files (.toml) only.")
    raw = _read_file(file, _format_of(file), None, _Layout())
    return _checked(raw.columns, raw, raw.provenance or _origin(file), str(file))


def read_mapped(mapping: Mapping[str, Any], folder: str | Path, where: str) -> Record:
    r"""Read a record from a file with foreign columns, which a mapping names.

    :math:`y = (x c) g + o`, with the raw value x, the factor c from its ``unit`` to the SI unit of the same quantity
    (1 without ``unit``), ``gain`` g from there to the unit of the column, and ``offset`` o in the unit of the column.
    Without ``gain`` the unit has to measure what the column does.

    Parameters
    ----------
    mapping : mapping
        Tables ``record`` (``file``; where needed ``format``, ``delimiter``, ``decimal``, ``sampling_time_s``) and
        ``columns`` (name -> ``from``; where needed ``unit``, ``gain``, ``offset``).
    folder : path
        Where a relative ``file`` lies.
    where : str
        Name of the mapping for messages.

    Raises
    ------
    RecordError
        If the file or its data are at fault.
    SpecError
        If the mapping breaks its schema.
    """
    _only_keys(mapping, ("record", "columns"), where)
    settings, targets = _entry(mapping, "record", dict, where), _entry(mapping, "columns", dict, where)
    here = f"{where}: [record]"
    _only_keys(settings, ("file", "format", "delimiter", "decimal", "sampling_time_s"), here)
    file = Path(folder) / _entry(settings, "file", str, here)
    kind = _entry(settings, "format", str, here) if "format" in settings else _format_of(file)
    if kind not in FORMATS.values():
        raise SpecError(f"{here}: unknown format '{kind}'.{did_you_mean(kind, FORMATS.values())}")
    layout = _layout(settings, kind, here)
    rules = {name: _rule(name, targets, f"{where}: [columns]") for name in targets}
    if ("sampling_time_s" in settings) == ("time_s" in rules) or not rules:
        raise SpecError(
            f"{where}: the clock is either a column time_s or [record] sampling_time_s; one of them, please."
        )

    raw = _read_file(file, kind, {rule.source for rule in rules.values()}, layout)
    columns: dict[str, NDArray[Any]] = {name: rule.apply(raw.columns[rule.source]) for name, rule in rules.items()}
    if "sampling_time_s" in settings:
        sampling_time = _number(settings, "sampling_time_s", 0.0, here)
        if sampling_time <= 0.0:
            raise SpecError(f"{here}: sampling_time_s is {sampling_time}; allowed: > 0.")
        columns = {"time_s": sampling_time * np.arange(len(next(iter(columns.values())))), **columns}
    origin = {**raw.provenance, **_origin(file), "mapping": targets, "left_out": raw.left_out}
    return _checked(columns, raw, origin, str(file))


def measured_file(relative: str, obtain: str) -> Path:
    """Return where the measured file ``relative`` lies, such as ``emps/DATA_EMPS.mat``.

    The folder is the one that the environment variable FDBENCH_DATA names, else ``fdbench`` in the user's data
    folder (XDG_DATA_HOME, else ``~/.local/share``).

    Raises
    ------
    MissingData
        If it is not there; the message says where to put it and, in the words of ``obtain``, where to get it.
    """
    data_home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    path = Path(os.environ.get("FDBENCH_DATA") or Path(data_home) / "fdbench") / relative
    if not path.is_file():
        raise MissingData(
            f"{path}: the measured data are not on this machine. To get them: {obtain} Put the file there, or set the "
            f"environment variable FDBENCH_DATA to the folder that holds {relative}."
        )
    return path


def _checked(columns: Mapping[str, NDArray[Any]], raw: _Raw, provenance: dict[str, Any], source: str) -> Record:
    """Return the record; faults are reported by the file's own names and lines."""
    check_finite(raw.columns, source, raw.place)
    if "time_s" in columns:
        check_clock(columns["time_s"].astype(np.float64), source, raw.place)
    return Record(columns, provenance, source)


def _origin(file: Path) -> dict[str, Any]:
    with file.open("rb") as stream:
        return {"file": file.name, "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}


# ---- the mapping's schema ----


def _read_toml(file: Path) -> dict[str, Any]:
    _must_exist(file)
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SpecError(f"{file}: not valid TOML: {error}.") from error


def _only_keys(table: Mapping[str, Any], allowed: Collection[str], where: str) -> None:
    for key in table:
        if key not in allowed:
            raise SpecError(f"{where}: unknown key '{key}'.{did_you_mean(key, allowed)}")


def _entry(table: Mapping[str, Any], key: str, kind: type[T], where: str) -> T:
    if key not in table:
        raise SpecError(f"{where}: '{key}' is missing.")
    value = table[key]
    if not isinstance(value, kind):
        word = {"str": "a text", "dict": "a table"}[kind.__name__]
        raise SpecError(f"{where}: '{key}' is {value!r}; it has to be {word}.")
    return value


def _number(table: Mapping[str, Any], key: str, default: float, where: str) -> float:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise SpecError(f"{where}: '{key}' is {value!r}; it has to be a finite number.")
    return float(value)


def _layout(settings: Mapping[str, Any], kind: str, where: str) -> _Layout:
    given = {key: _entry(settings, key, str, where) for key in _Layout._fields if key in settings}
    if given and kind != "csv":
        raise SpecError(f"{where}: {' and '.join(given)} belong to CSV files, this one is {kind}.")
    layout = _Layout(**given)
    if len(layout.delimiter) != 1 or layout.decimal not in (".", ",") or layout.delimiter == layout.decimal:
        raise SpecError(
            f"{where}: delimiter is '{layout.delimiter}' and decimal '{layout.decimal}'; allowed: one character, and "
            "another one of '.' or ','."
        )
    return layout


def _rule(name: str, targets: Mapping[str, Any], where: str) -> _Rule:
    fault = _name_fault(name)
    if fault:
        raise SpecError(f"{where}: {fault}")
    here = f"{where} {name}"
    entry = _entry(targets, name, dict, where)
    _only_keys(entry, ("from", "unit", "gain", "offset"), here)
    factor, gain = 1.0, _number(entry, "gain", 1.0, here)
    if gain == 0.0:
        raise SpecError(f"{here}: gain is 0; allowed: any other number.")
    if "unit" in entry:
        unit = _entry(entry, "unit", str, here)
        factor = si_unit(unit, here)[1] if "gain" in entry else factor_to_si(unit, name, here)
    return _Rule(_entry(entry, "from", str, here), factor, gain, _number(entry, "offset", 0.0, here))


# ---- the files ----


def _must_exist(file: Path) -> None:
    if file.is_file():
        return
    if file.is_dir():
        raise RecordError(f"{file}: a folder, not a file.")
    if not file.parent.is_dir():
        raise RecordError(f"{file}: no such file; the folder {file.parent} does not exist either.")
    nearest = difflib.get_close_matches(file.name, [other.name for other in file.parent.iterdir()], n=1, cutoff=0.0)
    raise RecordError(f"{file}: no such file. Nearest in that folder: {nearest[0] if nearest else 'nothing'}.")


def _format_of(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix not in FORMATS:
        raise RecordError(f"{file}: records are not read from '{suffix}' files. Allowed: {', '.join(FORMATS)}.")
    return FORMATS[suffix]


def _read_file(file: Path, kind: str, wanted: Collection[str] | None, layout: _Layout) -> _Raw:
    _must_exist(file)
    if file.stat().st_size == 0:
        raise RecordError(f"{file}: the file is empty.")
    try:
        if kind == "csv":
            return _read_csv(file, wanted, layout)
        return _read_parquet(file, wanted) if kind == "parquet" else _read_mat(file, wanted)
    except OSError as error:
        raise RecordError(f"{file}: cannot be read: {error}.") from error


def _choose(names: list[str], wanted: Collection[str] | None, file: Path) -> list[str]:
    """Return the names to read: those wanted by a mapping, or else all, which then have to be known."""
    for index, name in enumerate(names):
        if name in names[:index]:
            raise RecordError(f"{file}: two columns are named '{name}'. Rename one of them.")
    if wanted is None:
        for name in names:
            check_column_name(name, str(file))
        return names
    for name in sorted(wanted):
        if name not in names:
            raise RecordError(f"{file}: no column '{name}', which the mapping names.{_among(name, names)}")
    return [name for name in names if name in wanted]


def _among(name: str, names: list[str]) -> str:
    nearest = difflib.get_close_matches(name, names, n=1)
    return f" The file has: {', '.join(names)}." + (f" Did you mean {nearest[0]}?" if nearest else "")


def _stored_provenance(text: str | bytes, file: Path) -> dict[str, Any]:
    try:
        stored = json.loads(text)
    except ValueError as error:
        raise RecordError(
            f"{file}: the provenance of fdbench is damaged ({error}). Remove it to read the file."
        ) from error
    if not isinstance(stored, dict):
        raise RecordError(f"{file}: the provenance of fdbench is no table. Remove it to read the file.")
    return stored


def _read_parquet(file: Path, wanted: Collection[str] | None) -> _Raw:
    import pyarrow
    from pyarrow import parquet

    try:
        content = parquet.ParquetFile(file)
    except pyarrow.ArrowInvalid as error:
        raise RecordError(f"{file}: not a Parquet file, or a damaged one: {error}") from error
    schema = content.schema_arrow
    chosen = _choose(schema.names, wanted, file)
    stored = (schema.metadata or {}).get(b"fdbench")
    columns: dict[str, NDArray[Any]] = {}
    for name, column in zip(chosen, content.read(columns=chosen).select(chosen).columns, strict=True):
        if column.null_count:
            hole = column.is_null().to_pylist().index(True)
            raise RecordError(
                f"{file}: column {name} has {column.null_count} empty cells, the first at {_sample(hole)}."
            )
        columns[name] = column.to_numpy()
        if columns[name].dtype.kind not in "biuf":
            first = next((text for text in column.to_pylist() if not _is_number(str(text))), column[0])
            raise RecordError(f"{file}: column {name} holds {column.type}, not numbers, such as {str(first)!r}.")
    left_out = [name for name in schema.names if name not in chosen]
    return _Raw(columns, _stored_provenance(stored, file) if stored else {}, left_out)


def _read_mat(file: Path, wanted: Collection[str] | None) -> _Raw:
    from scipy.io import loadmat

    with file.open("rb") as stream:
        head = stream.read(19)
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise RecordError(
            f"{file}: a MAT file of version 7.3 (HDF5). In MATLAB: save(file, '-v7'), or write CSV or Parquet."
        )
    try:
        content = loadmat(file)
    except Exception as error:  # scipy has no common base for what damaged files raise
        raise RecordError(f"{file}: not a MAT file, or a damaged one: {error}") from error
    arrays = {name: np.asarray(array) for name, array in content.items() if not name.startswith("__")}
    scalars = {name for name, array in arrays.items() if array.size == 1 and array.dtype.kind in "biuf"}
    chosen = _choose([name for name in arrays if wanted is not None or name not in scalars], wanted, file)
    for name in chosen:
        array = arrays[name]
        if array.dtype.kind not in "biuf":
            words = {"c": "complex numbers", "U": "text", "V": "a struct"}
            what = words.get(array.dtype.kind, "cells, objects or a sparse matrix")
            raise RecordError(f"{file}: variable {name} holds {what}; a column holds real numbers.")
        if max(array.shape) != array.size:
            raise RecordError(f"{file}: variable {name} has shape {array.shape}; a column has (n, 1) or (1, n).")
    columns = {name: arrays[name].ravel() for name in chosen}
    left_out = [name for name in arrays if name not in chosen]
    if wanted is not None or not scalars:
        return _Raw(columns, {}, left_out)
    kept = {name: float(arrays[name].item()) for name in sorted(scalars)}
    return _Raw(columns, {**_origin(file), "scalars": kept}, [])


def _read_csv(file: Path, wanted: Collection[str] | None, layout: _Layout) -> _Raw:
    import pyarrow
    from pyarrow import csv as arrow_csv

    names, header_line, stored = _csv_header(file, layout)
    chosen = _choose(names, wanted, file)
    try:
        table = arrow_csv.read_csv(
            file,
            arrow_csv.ReadOptions(column_names=names, skip_rows=header_line),
            arrow_csv.ParseOptions(delimiter=layout.delimiter),
            arrow_csv.ConvertOptions(
                column_types=dict.fromkeys(chosen, pyarrow.float64()),
                include_columns=chosen,
                null_values=[""],
                decimal_point=layout.decimal,
            ),
        )
    except pyarrow.ArrowInvalid as error:
        raise _csv_fault(file, names, chosen, header_line, layout, str(error)) from error
    if any(column.null_count for column in table.columns):
        raise _csv_fault(file, names, chosen, header_line, layout, "empty cells")
    columns = {name: table.column(name).to_numpy() for name in chosen}
    left_out = [name for name in names if name not in chosen]
    return _Raw(
        columns, stored, left_out, lambda sample: f"sample {sample} (line {_csv_line(file, header_line, sample)})"
    )


def _csv_header(file: Path, layout: _Layout) -> tuple[list[str], int, dict[str, Any]]:
    """Return the names of the columns, the number of their line, and the provenance in a comment above it."""
    stored: dict[str, Any] = {}
    with file.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            try:
                text = line.decode("utf-8-sig").rstrip("\r\n")
            except UnicodeDecodeError:
                raise RecordError(f"{file}: line {number} is not UTF-8 text. Save the file as CSV in UTF-8.") from None
            if text.startswith("# fdbench "):
                stored = _stored_provenance(text.removeprefix("# fdbench "), file)
            if text.strip() and not text.startswith("#"):
                break
        else:
            raise RecordError(f"{file}: the file is empty.")
    names = [name.strip() for name in next(csv.reader([text], delimiter=layout.delimiter))]
    if all(_is_number(name, layout.decimal) for name in names):
        raise RecordError(f"{file}: line {number} holds numbers where the names of the columns should be. Add them.")
    for delimiter in ";\t|":
        if len(names) == 1 and delimiter in names[0]:
            raise RecordError(
                f"{file}: line {number} has no '{layout.delimiter}' but '{delimiter}' between its names. Use a mapping "
                f'file with delimiter = {json.dumps(delimiter)} in [record], and decimal = "," for decimal commas.'
            )
    return names, number, stored


def _csv_fault(
    file: Path, names: list[str], chosen: list[str], header_line: int, layout: _Layout, message: str
) -> RecordError:
    """Return what is wrong with a file that the fast reader refused, found by a slow second look."""
    empty = True
    with file.open(encoding="utf-8-sig", errors="replace", newline="") as lines:
        reader = csv.reader(lines, delimiter=layout.delimiter)
        for row in reader:
            if reader.line_num <= header_line or not row:
                continue
            empty = False
            where = f"{file}: line {reader.line_num}"
            cells = [cell.strip() for cell in row]
            if cells == names:
                return RecordError(
                    f"{where} repeats the names of the columns. Split the file: one record has one clock."
                )
            if len(cells) != len(names):
                hint = " If its numbers have decimal commas: write it with semicolons." if "," in layout else ""
                return RecordError(f"{where} has {len(cells)} cells, the header has {len(names)}.{hint}")
            for name in chosen:
                cell = cells[names.index(name)]
                if not cell:
                    return RecordError(
                        f"{where}, column {name}: the cell is empty. A record has no holes: cut the part out."
                    )
                if not _is_number(cell, layout.decimal):
                    return RecordError(
                        f"{where}, column {name}: {cell!r} is not a number.{_text_hint(cells, cell, layout)}"
                    )
    return RecordError(f"{file}: 0 samples; a record needs at least 3." if empty else f"{file}: {message}")


def _text_hint(cells: list[str], cell: str, layout: _Layout) -> str:
    other = "," if layout.decimal == "." else "."
    if _is_number(cell, other):
        return f' If that is its decimal sign, set decimal = "{other}" in [record] of a mapping file.'
    if not any(_is_number(other) for other in cells):
        return " A line of units does not belong in the file: remove it, and name the units in a mapping file."
    return " Correct or remove it."


def _is_number(text: str, decimal: str = ".") -> bool:
    return _NUMBERS[decimal].fullmatch(text) is not None


def _csv_line(file: Path, header_line: int, sample: int) -> int:
    """Return the line of a sample; blank lines do not count as samples."""
    with file.open("rb") as lines:
        filled = (number for number, line in enumerate(lines, 1) if number > header_line and line.strip(b"\r\n"))
        return next(itertools.islice(filled, sample, None))
