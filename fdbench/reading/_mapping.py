"""Records from files: columns as they are, or renamed and scaled by a mapping; and where measured data lie."""

import dataclasses
import difflib
import math
import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fdbench.documents import LARGEST_TOML, read_file, toml_tables
from fdbench.errors import MissingData, RecordError, SpecError, did_you_mean
from fdbench.files import is_utf_8
from fdbench.reading._unread import told_by_head, told_by_suffix
from fdbench.reading.formats import GZIP, Format, Raw, formats, in_utf_8, on_clock, open_unpacked, origin
from fdbench.reading.formats._whole import without_repeated_rows
from fdbench.record import FloatArray, Record, check_clock, check_finite, name_fault
from fdbench.units import factor_to_si, si_unit

T = TypeVar("T")

HEAD_BYTES = 65536  # by which a format is recognised


class _ColumnRule(NamedTuple):
    """How a column of the record comes from one of the file."""

    source: str
    minus: str | None
    factor: float
    gain: float
    offset: float
    late_s: float

    @property
    def is_scaled(self) -> bool:
        """Whether values are multiplied."""
        return (self.factor, self.gain) != (1.0, 1.0)

    @property
    def sources(self) -> list[str]:
        """Columns of the file that it takes."""
        return [self.source] if self.minus is None else [self.source, self.minus]

    def apply(self, raw: Mapping[str, NDArray[Any]]) -> FloatArray:
        values = raw[self.source].astype(np.float64)
        if self.minus is not None:
            values -= raw[self.minus]
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
    kind = format_of(file)
    if not kind.has_our_names:
        raise RecordError(
            f"{file}: the columns of a file of format {kind.name} need a mapping file; `fdbench import {file.name}` "
            "writes one."
        )
    raw = _read(file, kind(), None)
    _check_stamps([(name, name) for name in raw.columns], raw, str(file))
    return _checked(raw.columns, raw, {**raw.provenance} or origin(file), str(file))


def format_of(file: Path) -> type[Format]:
    """Return the format of a file: the one that recognises how it begins, else the one of its extension.

    Raises
    ------
    RecordError
        If the file does not exist, is empty, or is of no known format.
    """
    _must_exist(file)
    with file.open("rb") as stream:
        is_packed = stream.read(len(GZIP)) == GZIP
    with open_unpacked(file) as stream:
        head = in_utf_8(stream.read(HEAD_BYTES))
    kinds = [kind for name in formats.names() if (kind := formats.get(name)).is_text or not is_packed]
    suffix = Path(file.stem if is_packed and file.suffix.lower() == ".gz" else file).suffix.lower()
    found = [kind for kind in kinds if kind.recognises(head)]
    if not found and (told := told_by_head(head)):
        raise RecordError(f"{file}: not read: it is {told}")
    found = found or [kind for kind in kinds if suffix in kind.suffixes]
    if not found and is_packed:
        raise RecordError(f"{file}: not read: it is {told_by_head(GZIP)}")
    if not found and (told := told_by_suffix(suffix)):
        raise RecordError(f"{file}: not read: by its name it is {told}")
    if not found:
        suffixes = ", ".join(sorted(known for kind in kinds for known in kind.suffixes))
        raise RecordError(
            f"{file}: records are not read from '{suffix}' files, and this one does not begin like one of "
            f"{', '.join(formats.names())}. Allowed: {suffixes}."
        )
    _check_size(file, found[0])
    return found[0]


def read_mapped(mapping: Mapping[str, Any], folder: str | Path, where: str) -> Record:
    r"""Read a record from a file with foreign columns, which a mapping names.

    :math:`y = ((x - m) c) g + o`, with the raw value x, that of the column ``minus`` m where one is named, the factor c
    from its ``unit`` to the SI unit of the same quantity (1 without ``unit``), ``gain`` g from there to the unit of the
    column, and ``offset`` o in the unit of the column. Without ``gain`` the unit has to measure what the column does.

    Parameters
    ----------
    mapping : mapping
        Tables ``record`` (``file``; where needed ``format`` and its own keys, such as ``delimiter``, ``decimal``,
        ``skip_lines`` and ``encoding`` of CSV; ``sampling_time_s``, ``samples``: the first one taken and the first one
        behind, ``condition``: what the axis was doing) and ``columns`` (name -> ``from``; where needed ``minus``:
        a column that is taken from it, such as the following error from the command, ``unit``, ``gain``, ``offset``,
        and ``late_s``: by how much later than the clock the column was read, which is put right between two samples by
        a straight line).
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
    file = Path(folder) / _entry(settings, "file", str, here)
    reader = _reader(settings, file, here)
    rules = {name: _rule(name, targets, f"{where}: [columns]") for name in targets}
    if ("sampling_time_s" in settings) == ("time_s" in rules) or not rules:
        raise SpecError(
            f"{where}: the clock is either a column time_s or [record] sampling_time_s; one of them, please."
        )

    raw = _read(file, reader, {source for rule in rules.values() for source in rule.sources})
    if "time_s" in rules and rules["time_s"].source in raw.stamps and rules["time_s"].is_scaled:
        raise SpecError(
            f"{where}: [columns] time_s: '{rules['time_s'].source}' holds times of day, which are read as seconds: "
            "leave out unit and gain."
        )
    _check_stamps([(name, source) for name, rule in rules.items() for source in rule.sources], raw, str(file))
    clock = rules["time_s"].source if "time_s" in rules else None
    raw = on_clock(raw, clock, str(file))
    length = _length(raw)
    if clock is not None:
        raw = without_repeated_rows(raw, clock)
    repeated = length - _length(raw)
    raw = _part(raw, settings, here, file)
    columns: dict[str, NDArray[Any]] = {name: rule.apply(raw.columns) for name, rule in rules.items()}
    if "sampling_time_s" in settings:
        sampling_time = _number(settings, "sampling_time_s", 0.0, here)
        if sampling_time <= 0.0:
            raise SpecError(f"{here}: sampling_time_s is {sampling_time}; allowed: > 0.")
        columns = {"time_s": sampling_time * np.arange(len(next(iter(columns.values())))), **columns}
    columns, raw = _in_time(columns, raw, {name: rule.late_s for name, rule in rules.items() if rule.late_s}, where)
    provenance = {**raw.provenance, **origin(file), "mapping": targets, "left_out": [*raw.left_out]}
    if repeated:
        provenance["repeated_rows_left_out"] = repeated
    if "samples" in settings:
        provenance["samples"] = settings["samples"]
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
    _must_exist(file)
    try:
        return toml_tables(read_file(file, LARGEST_TOML))
    except ValueError as error:
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


def _reader(settings: Mapping[str, Any], file: Path, where: str) -> Format:
    """Return the format that a mapping names, or else that of the file, with the keys that are its own."""
    if "format" in settings:
        name = _entry(settings, "format", str, where)
        if name not in formats.names():
            raise SpecError(f"{where}: unknown format '{name}'.{did_you_mean(name, formats.names())}")
        kind = formats.get(name)
    else:
        kind = format_of(file)
    owners = {key: name for name in formats.names() for key in _keys_of(formats.get(name))}
    own = _keys_of(kind)
    foreign = [key for key in settings if key in owners and key not in own]
    if foreign:
        owner = owners[foreign[0]].upper()
        raise SpecError(f"{where}: {' and '.join(foreign)} belong to {owner} files, this one is {kind.name}.")
    _only_keys(settings, ("file", "format", "sampling_time_s", "samples", "condition", *own), where)
    try:
        return kind(**{key: settings[key] for key in own if key in settings})
    except SpecError as error:
        raise SpecError(f"{where}: {error}") from error


def _keys_of(kind: type[Format]) -> list[str]:
    return [item.name for item in dataclasses.fields(kind)] if dataclasses.is_dataclass(kind) else []


def _read(file: Path, reader: Format, wanted: Collection[str] | None) -> Raw:
    _must_exist(file)
    _check_size(file, type(reader))
    try:
        return reader.read(file, wanted)
    except OSError as error:
        raise RecordError(f"{file}: cannot be read: {error}.") from error


def _part(raw: Raw, settings: Mapping[str, Any], where: str, file: Path) -> Raw:
    """Return the samples that a mapping takes; none may be lost among them."""
    length = _length(raw)
    start, stop = 0, length
    if "samples" in settings:
        given = settings["samples"]
        is_range = isinstance(given, list) and [type(item) for item in given] == [int, int]
        if not is_range or not 0 <= given[0] < given[1] <= length:
            raise SpecError(f"{where}: samples is {given!r}; allowed: [first, first behind] within 0 and {length}.")
        start, stop = given
    lost = [gap for gap in raw.gaps if start < gap < stop]
    if lost:
        raise RecordError(
            f"{file}: samples were lost before {raw.place(lost[0])} ({len(lost)} gaps). A record has no holes: take a "
            f"part without, such as samples = [{start}, {lost[0]}] in [record]."
        )
    columns = {name: column[start:stop] for name, column in raw.columns.items()}
    return dataclasses.replace(raw, columns=columns, place=lambda sample: raw.place(start + sample), gaps=())


def _in_time(
    columns: dict[str, NDArray[Any]], raw: Raw, late_s: Mapping[str, float], where: str
) -> tuple[dict[str, NDArray[Any]], Raw]:
    """Return columns without those seconds by which each was read late, where all of them are known."""
    if not late_s:
        return columns, raw
    length = len(columns["time_s"])
    period_s = float(columns["time_s"][-1] - columns["time_s"][0]) / max(length - 1, 1)
    behind = {name: value / period_s if period_s > 0.0 else 0.0 for name, value in late_s.items()}
    first, last = math.ceil(max(0.0, -min(behind.values()))), length - math.ceil(max(0.0, *behind.values()))
    if last - first < 2:
        longest = max(late_s, key=lambda name: abs(late_s[name]))
        raise SpecError(
            f"{where}: [columns] {longest}: late_s is {late_s[longest]:g}, and the record lasts "
            f"{length * period_s:.4g} s; allowed: less than that."
        )
    places = np.arange(length, dtype=np.float64)
    moved = {
        name: np.interp(places[first:last] + behind[name], places, column) if name in behind else column[first:last]
        for name, column in columns.items()
    }
    return moved, dataclasses.replace(raw, place=lambda sample: raw.place(first + sample))


def _check_stamps(sources: Iterable[tuple[str, str]], raw: Raw, file: str) -> None:
    for name, source in sources:
        if source in raw.stamps and name != "time_s":
            raise RecordError(f"{file}: column {source} holds times of day; only time_s may hold such, not {name}.")


def _length(raw: Raw) -> int:
    return len(next(iter(raw.columns.values())))


def _must_exist(file: Path) -> None:
    if not is_utf_8(file):
        raise RecordError(f"{file}: the name of the file is not UTF-8. Rename it.")
    if file.is_file():
        if file.stat().st_size == 0:
            raise RecordError(f"{file}: the file is empty.")
        return
    if file.exists() and not file.is_dir():
        raise RecordError(f"{file}: a pipe or a device, not a file.")
    if file.is_dir():
        raise RecordError(f"{file}: a folder, not a file.")
    if not file.parent.is_dir():
        raise RecordError(f"{file}: no such file; the folder {file.parent} does not exist either.")
    nearest = difflib.get_close_matches(file.name, [other.name for other in file.parent.iterdir()], n=1, cutoff=0.0)
    raise RecordError(f"{file}: no such file. Nearest in that folder: {nearest[0] if nearest else 'nothing'}.")


def _check_size(file: Path, kind: type[Format]) -> None:
    size = file.stat().st_size
    if size > kind.largest_bytes:
        raise RecordError(
            f"{file}: {size} bytes; of format {kind.name}, at most {kind.largest_bytes} are read. Split the file."
        )


def _rule(name: str, targets: Mapping[str, Any], where: str) -> _ColumnRule:
    fault = name_fault(name)
    if fault:
        raise SpecError(f"{where}: {fault}")
    here = f"{where} {name}"
    entry = _entry(targets, name, dict, where)
    _only_keys(entry, ("from", "minus", "unit", "gain", "offset", "late_s"), here)
    factor, gain = 1.0, _number(entry, "gain", 1.0, here)
    if gain == 0.0:
        raise SpecError(f"{here}: gain is 0; allowed: any other number.")
    if "unit" in entry:
        unit = _entry(entry, "unit", str, here)
        factor = si_unit(unit, here)[1] if "gain" in entry else factor_to_si(unit, name, here)
    offset, late_s = (_number(entry, key, 0.0, here) for key in ("offset", "late_s"))
    if name == "time_s" and late_s != 0.0:
        raise SpecError(f"{here}: late_s is of other columns: by how much later than time_s they were read.")
    minus = _entry(entry, "minus", str, here) if "minus" in entry else None
    return _ColumnRule(_entry(entry, "from", str, here), minus, factor, gain, offset, late_s)
