"""Records from files: columns as they are, or renamed and scaled by a mapping; and where measured data lie."""

import math
import os
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import MissingData, RecordError, SpecError, did_you_mean
from fdbench.reading._files import FORMATS, Layout, Raw, format_of, must_exist, origin, read_file
from fdbench.record import FloatArray, Record, check_clock, check_finite, name_fault
from fdbench.units import factor_to_si, si_unit

T = TypeVar("T")


class _ColumnRule(NamedTuple):
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
    raw = read_file(file, format_of(file), None, Layout())
    return _checked(raw.columns, raw, raw.provenance or origin(file), str(file))


def read_mapped(mapping: Mapping[str, Any], folder: str | Path, where: str) -> Record:
    r"""Read a record from a file with foreign columns, which a mapping names.

    :math:`y = (x c) g + o`, with the raw value x, the factor c from its ``unit`` to the SI unit of the same quantity
    (1 without ``unit``), ``gain`` g from there to the unit of the column, and ``offset`` o in the unit of the column.
    Without ``gain`` the unit has to measure what the column does.

    Parameters
    ----------
    mapping : mapping
        Tables ``record`` (``file``; where needed ``format``, ``delimiter``, ``decimal``, ``skip_lines``,
        ``sampling_time_s``, ``condition``: what the axis was doing) and ``columns`` (name -> ``from``; where needed
        ``unit``, ``gain``, ``offset``).
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
    _only_keys(settings, ("file", "format", "delimiter", "decimal", "skip_lines", "sampling_time_s", "condition"), here)
    file = Path(folder) / _entry(settings, "file", str, here)
    kind = _entry(settings, "format", str, here) if "format" in settings else format_of(file)
    if kind not in FORMATS.values():
        raise SpecError(f"{here}: unknown format '{kind}'.{did_you_mean(kind, FORMATS.values())}")
    layout = _layout(settings, kind, here)
    rules = {name: _rule(name, targets, f"{where}: [columns]") for name in targets}
    if ("sampling_time_s" in settings) == ("time_s" in rules) or not rules:
        raise SpecError(
            f"{where}: the clock is either a column time_s or [record] sampling_time_s; one of them, please."
        )

    raw = read_file(file, kind, {rule.source for rule in rules.values()}, layout)
    columns: dict[str, NDArray[Any]] = {name: rule.apply(raw.columns[rule.source]) for name, rule in rules.items()}
    if "sampling_time_s" in settings:
        sampling_time = _number(settings, "sampling_time_s", 0.0, here)
        if sampling_time <= 0.0:
            raise SpecError(f"{here}: sampling_time_s is {sampling_time}; allowed: > 0.")
        columns = {"time_s": sampling_time * np.arange(len(next(iter(columns.values())))), **columns}
    provenance = {**raw.provenance, **origin(file), "mapping": targets, "left_out": raw.left_out}
    if "condition" in settings:
        provenance["condition"] = _entry(settings, "condition", str, here)
    return _checked(columns, raw, provenance, str(file))


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


def _checked(columns: Mapping[str, NDArray[Any]], raw: Raw, provenance: dict[str, Any], source: str) -> Record:
    """Return the record; faults are reported by the file's own names and lines."""
    check_finite(raw.columns, source, raw.place)
    if "time_s" in columns:
        check_clock(columns["time_s"].astype(np.float64), source, raw.place)
    return Record(columns, provenance, source)


def _read_toml(file: Path) -> dict[str, Any]:
    must_exist(file)
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
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


def _layout(settings: Mapping[str, Any], kind: str, where: str) -> Layout:
    given: dict[str, Any] = {
        key: _entry(settings, key, str, where) for key in ("delimiter", "decimal") if key in settings
    }
    if "skip_lines" in settings:
        given["skip_lines"] = settings["skip_lines"]
        if not isinstance(given["skip_lines"], int) or isinstance(given["skip_lines"], bool) or given["skip_lines"] < 0:
            raise SpecError(f"{where}: skip_lines is {given['skip_lines']!r}; allowed: a whole number from 0.")
    if given and kind != "csv":
        raise SpecError(f"{where}: {' and '.join(given)} belong to CSV files, this one is {kind}.")
    layout = Layout(**given)
    if len(layout.delimiter) != 1 or layout.decimal not in (".", ",") or layout.delimiter == layout.decimal:
        raise SpecError(
            f"{where}: delimiter is '{layout.delimiter}' and decimal '{layout.decimal}'; allowed: one character, and "
            "another one of '.' or ','."
        )
    return layout


def _rule(name: str, targets: Mapping[str, Any], where: str) -> _ColumnRule:
    fault = name_fault(name)
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
    return _ColumnRule(_entry(entry, "from", str, here), factor, gain, _number(entry, "offset", 0.0, here))
