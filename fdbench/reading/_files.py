"""The file formats: raw columns of a CSV, Parquet or MAT file, with messages that name line and cell."""

import csv
import difflib
import hashlib
import itertools
import json
import re
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.record import check_column_name, nth_sample

# File extension -> format.
FORMATS = {".csv": "csv", ".parquet": "parquet", ".mat": "mat"}


_NUMBERS = {
    decimal: re.compile(rf"[+-]?((\d+({point}\d*)?|{point}\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.IGNORECASE)
    for decimal, point in ((".", r"\."), (",", ","))
}

# All but the tab, which may stand between cells.
_CONTROL = re.compile(r"[\x00-\x08\x0a-\x1f\x7f-\x9f]")
LONGEST_NAME, LONGEST_CELL = 200, 60
LONGEST_PREAMBLE = 100  # lines


class Layout(NamedTuple):
    """How a CSV file is written; without ``skip_lines`` lines above the header are found by themselves."""

    delimiter: str = ","
    decimal: str = "."
    skip_lines: int | None = None


class Raw(NamedTuple):
    """The columns as a file has them, what it says of their origin, the names left out, and where a sample lies."""

    columns: dict[str, NDArray[Any]]
    provenance: dict[str, Any]
    left_out: list[str]
    place: Callable[[int], str] = nth_sample


def must_exist(file: Path) -> None:
    if file.is_file():
        return
    if file.is_dir():
        raise RecordError(f"{file}: a folder, not a file.")
    if not file.parent.is_dir():
        raise RecordError(f"{file}: no such file; the folder {file.parent} does not exist either.")
    nearest = difflib.get_close_matches(file.name, [other.name for other in file.parent.iterdir()], n=1, cutoff=0.0)
    raise RecordError(f"{file}: no such file. Nearest in that folder: {nearest[0] if nearest else 'nothing'}.")


def format_of(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix not in FORMATS:
        raise RecordError(f"{file}: records are not read from '{suffix}' files. Allowed: {', '.join(FORMATS)}.")
    return FORMATS[suffix]


def read_file(file: Path, kind: str, wanted: Collection[str] | None, layout: Layout) -> Raw:
    must_exist(file)
    if file.stat().st_size == 0:
        raise RecordError(f"{file}: the file is empty.")
    try:
        if kind == "csv":
            return _read_csv(file, wanted, layout)
        return _read_parquet(file, wanted) if kind == "parquet" else _read_mat(file, wanted)
    except OSError as error:
        raise RecordError(f"{file}: cannot be read: {error}.") from error
    except csv.Error as error:
        raise RecordError(f"{file}: no CSV file: {error}.") from error


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


def _read_parquet(file: Path, wanted: Collection[str] | None) -> Raw:
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
                f"{file}: column {name} has {column.null_count} empty cells, the first at {nth_sample(hole)}."
            )
        columns[name] = column.to_numpy()
        if columns[name].dtype.kind not in "biuf":
            first = next((text for text in column.to_pylist() if not _is_number(str(text))), column[0])
            raise RecordError(f"{file}: column {name} holds {column.type}, not numbers, such as {str(first)!r}.")
    left_out = [name for name in schema.names if name not in chosen]
    return Raw(columns, _stored_provenance(stored, file) if stored else {}, left_out)


def _read_mat(file: Path, wanted: Collection[str] | None) -> Raw:
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
        return Raw(columns, {}, left_out)
    kept = {name: float(arrays[name].item()) for name in sorted(scalars)}
    return Raw(columns, {**origin(file), "scalars": kept}, [])


def _read_csv(file: Path, wanted: Collection[str] | None, layout: Layout) -> Raw:
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
    return Raw(
        columns, stored, left_out, lambda sample: f"sample {sample} (line {_csv_line(file, header_line, sample)})"
    )


def _csv_header(file: Path, layout: Layout) -> tuple[list[str], int, dict[str, Any]]:
    """Return the names of the columns, the number of their line, and the provenance in a comment above it."""
    stored: dict[str, Any] = {}
    skipped = layout.skip_lines or 0
    with file.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            if number <= skipped:
                continue
            text = _text_of(line, number, file)
            if text.startswith("# fdbench "):
                stored = _stored_provenance(text.removeprefix("# fdbench "), file)
            if text.strip() and not text.startswith("#"):
                break
        else:
            above = f" below line {skipped}, up to which skip_lines leaves it out" if skipped else ""
            raise RecordError(f"{file}: the file is empty{above}.")
    if layout.skip_lines is None:
        number, text = _below_preamble(file, number, text, layout)
    names = _cells(text, layout)
    if longest := [len(name) for name in names if len(name) > LONGEST_NAME]:
        raise RecordError(f"{file}: line {number} holds {longest[0]} characters where the name of a column should be.")
    if all(_is_number(name, layout.decimal) for name in names):
        raise RecordError(f"{file}: line {number} holds numbers where the names of the columns should be. Add them.")
    for delimiter in ";\t|":
        if len(names) == 1 and delimiter in names[0]:
            raise RecordError(
                f"{file}: line {number} has no {layout.delimiter!r} but {delimiter!r} between its names. Use a mapping "
                f'file with delimiter = {json.dumps(delimiter)} in [record], and decimal = "," for decimal commas.'
            )
    return names, number, stored


def _text_of(line: bytes, number: int, file: Path) -> str:
    try:
        text = line.decode("utf-8-sig").rstrip("\r\n")
    except UnicodeDecodeError:
        raise RecordError(f"{file}: line {number} is not UTF-8 text. Save the file as CSV in UTF-8.") from None
    if _CONTROL.search(text):
        raise RecordError(
            f"{file}: line {number} holds control characters: a binary file, or one with "
            "unusual ends of lines. Save it as CSV in UTF-8."
        )
    return text


def _cells(text: str, layout: Layout) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([text], delimiter=layout.delimiter), [])]


def _below_preamble(file: Path, number: int, text: str, layout: Layout) -> tuple[int, str]:
    """Return the header's line: the first one, or below lines of another width the first as wide as the numbers."""
    seen, width = [(number, text)], len(_cells(text, layout))
    with file.open("rb") as lines:
        for place, line in enumerate(itertools.islice(lines, number, number + LONGEST_PREAMBLE), number + 1):
            row = line.decode("utf-8", errors="replace").rstrip("\r\n")
            cells = _cells(row, layout)
            if cells and all(_is_number(cell, layout.decimal) for cell in cells):
                alike = [item for item in seen if len(_cells(item[1], layout)) == len(cells)]
                is_header = bool(alike) and len(cells) != width and all(_cells(alike[0][1], layout))
                return alike[0] if is_header else (number, text)
            seen.append((place, row))
    return number, text


def _csv_fault(
    file: Path, names: list[str], chosen: list[str], header_line: int, layout: Layout, message: str
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
                if len(names) == 1:
                    hint += " Lines above the header are left out by skip_lines in [record] of a mapping file."
                return RecordError(f"{where} has {len(cells)} cells, the header has {len(names)}.{hint}")
            for name in chosen:
                cell = cells[names.index(name)]
                if not cell:
                    return RecordError(
                        f"{where}, column {name}: the cell is empty. A record has no holes: cut the part out."
                    )
                if not _is_number(cell, layout.decimal):
                    shown = cell if len(cell) <= LONGEST_CELL else f"{cell[:LONGEST_CELL]}..."
                    return RecordError(
                        f"{where}, column {name}: {shown!r} is not a number.{_text_hint(cells, cell, layout)}"
                    )
    return RecordError(f"{file}: 0 samples; a record needs at least 3." if empty else f"{file}: {message}")


def _text_hint(cells: list[str], cell: str, layout: Layout) -> str:
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


def origin(file: Path) -> dict[str, Any]:
    with file.open("rb") as stream:
        return {"file": file.name, "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}
