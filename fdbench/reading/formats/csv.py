"""Text of cells between commas, semicolons, tabs, bars or blanks, below a line of names."""

import csv
import io
import itertools
import json
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple, Self, final

import numpy as np

from fdbench.errors import RecordError, SpecError
from fdbench.reading.formats._cells import (
    BLANK,
    OURS,
    bounded_lines,
    cells_of,
    check_end,
    footer_of,
    is_number,
    line_of,
    numbers_in,
    without_footer,
)
from fdbench.reading.formats._format import EVERYTHING, Format, Raw, choose, stored_provenance, unique
from fdbench.reading.formats._layout import LONGEST_PREAMBLE, layout_of
from fdbench.reading.formats._stamps import is_stamp, seconds_of
from fdbench.reading.formats._text import marked_encoding, open_text, open_unpacked, with_single_blanks
from fdbench.reading.formats._whole import MOST_HOLES, surveyed
from fdbench.record import FloatArray
from fdbench.units import spelt_unit

ENCODINGS = ("utf-8", "cp1252")

# All but the tab, which may stand between cells.
_CONTROL = re.compile(r"[\x00-\x08\x0a-\x1f\x7f-\x9f]")
LONGEST_NAME, LONGEST_CELL = 200, 60


class _Header(NamedTuple):
    """The names of the columns, the number of the last line above the numbers, units, and the provenance."""

    names: list[str]
    line: int
    units: dict[str, str]
    stored: dict[str, Any]


@final
@dataclass(frozen=True)
class Csv(Format):
    """Comma-separated values, read by pyarrow, with messages that name line and cell.

    Lines above the names are found by themselves where they have another number of cells than the numbers, else
    ``skip_lines`` says how many there are. A line of units below the names is left out where a mapping names the units.

    Parameters
    ----------
    delimiter : str
        What stands between two cells; of blanks there may be several.
    decimal : str
        Decimal sign, ``.`` or ``,``.
    skip_lines : int or None
        Lines above the names.
    encoding : str
        Of files without a byte order mark: ``utf-8``, or ``cp1252`` (Windows in western Europe). UTF-16 has a mark.
    """

    suffixes = (".csv", ".txt", ".tsv", ".dat", ".log")
    is_text = True
    has_our_names = True

    delimiter: str = ","
    decimal: str = "."
    skip_lines: int | None = None
    encoding: str = "utf-8"

    def __post_init__(self) -> None:
        skipped = self.skip_lines
        if skipped is not None and (not isinstance(skipped, int) or isinstance(skipped, bool) or skipped < 0):
            raise SpecError(f"skip_lines is {skipped!r}; allowed: a whole number from 0.")
        is_text = isinstance(self.delimiter, str) and len(self.delimiter) == 1
        if not is_text or self.decimal not in (".", ",") or self.delimiter == self.decimal:
            raise SpecError(
                f"delimiter is '{self.delimiter}' and decimal '{self.decimal}'; allowed: one character, and "
                "another one of '.' or ','."
            )
        if self.encoding not in ENCODINGS:
            raise SpecError(f"encoding is {self.encoding!r}; allowed: {' or '.join(ENCODINGS)}; UTF-16 needs none.")

    def read(self, file: Path, wanted: Collection[str] | None) -> Raw:
        """Return columns; see `Format.read`. Those that a mapping names may hold empty cells, which are no numbers."""
        return self._read(file, wanted, 0.0 if wanted in (None, EVERYTHING) else 1.0)

    def _read(self, file: Path, wanted: Collection[str] | None, most_holes: float) -> Raw:
        with open_unpacked(file) as stream:
            marked = marked_encoding(stream.read(len("\ufeff".encode())))
        if marked and self.encoding != "utf-8":
            raise RecordError(f"{file}: its byte order mark says {marked}. Leave out encoding = '{self.encoding}'.")
        try:
            return self._columns(file, wanted, most_holes)
        except csv.Error as error:
            raise RecordError(f"{file}: no CSV file: {error}.") from error

    @classmethod
    def survey(cls, file: Path) -> tuple[Self, Raw]:
        """Return how a file is written, by the layout in which most cells are numbers, and all columns of numbers."""
        try:
            reader = cls(*layout_of(file))
        except csv.Error as error:
            raise RecordError(f"{file}: no CSV file: {error}.") from error
        return reader, surveyed(reader._read(file, EVERYTHING, MOST_HOLES))

    def _columns(self, file: Path, wanted: Collection[str] | None, most_holes: float) -> Raw:
        """Return columns, of which at most the share ``most_holes`` of the cells is empty."""
        import pyarrow

        header = self._header(file, wanted is None)
        chosen = choose(header.names, wanted, file)
        cells = self._first_cells(file, header)
        stamps = [name for name in chosen if cells.get(name) and all(map(is_stamp, cells[name]))]
        if wanted is EVERYTHING:
            numeric = [name for name in cells if cells[name] and all(map(self._is_number, cells[name]))]
            chosen = [name for name in header.names if name in (*numeric, *stamps)]
        try:
            table = self._table(file, header, chosen, stamps)
        except UnicodeDecodeError as error:
            raise RecordError(f"{file}: a character that {self.encoding} has not: {error}.") from error
        except pyarrow.ArrowInvalid as error:
            numbers = [name for name in chosen if name not in stamps]
            raise self._fault(file, header, numbers, str(error)) from error
        check_end(file, self.decimal)
        whole = [name for name in chosen if table.column(name).null_count <= most_holes * len(table)]
        if wanted is not EVERYTHING and len(whole) < len(chosen):
            raise self._fault(file, header, chosen, "empty cells")
        columns = {name: table.column(name).to_numpy() for name in whole if name not in stamps}
        seconds = {name: self._seconds(file, header, name, table) for name in whole if name in stamps}
        starts = {name: next(cell for cell in cells[name]) for name in seconds}
        return Raw(
            columns={name: seconds[name] if name in seconds else columns[name] for name in whole},
            provenance=header.stored,
            left_out=[name for name in header.names if name not in whole],
            place=lambda sample: f"sample {sample} (line {line_of(file, header.line, sample)})",
            units={**header.units, **dict.fromkeys(seconds, "s")},
            stamps=list(seconds),
            notes=[
                *(f"'{name}' holds times of day, taken as seconds from {start}" for name, start in starts.items()),
                *self._footer(file),
            ],
        )

    def _seconds(self, file: Path, header: _Header, name: str, table: Any) -> FloatArray:
        cells = table.column(name).to_pylist()
        try:
            seconds = seconds_of(cells)
        except ValueError as error:
            raise RecordError(f"{file}, column {name}: {error}.") from error
        wrong = next((place for place in np.flatnonzero(np.isnan(seconds)) if cells[place]), None)
        if wrong is not None:
            raise RecordError(
                f"{file}: line {line_of(file, header.line, int(wrong))}, column {name}: "
                f"{cells[wrong][:LONGEST_CELL]!r} is no time such as those above it. Correct or remove it."
            )
        return seconds

    def _footer(self, file: Path) -> list[str]:
        with self._open_whole(file) as stream:
            footer = footer_of(stream)
        count = sum(bool(row.strip()) for row in footer.split(b"\n"))
        return [f"lines of comments below the table: {count}, left out"] if count else []

    def _table(self, file: Path, header: _Header, chosen: list[str], stamps: list[str]) -> Any:
        import pyarrow
        from pyarrow import csv as arrow_csv

        with self._open(file) as stream:
            return arrow_csv.read_csv(
                stream,
                arrow_csv.ReadOptions(column_names=header.names, skip_rows=header.line, encoding=self.encoding),
                arrow_csv.ParseOptions(delimiter=self.delimiter),
                arrow_csv.ConvertOptions(
                    column_types={name: pyarrow.string() if name in stamps else pyarrow.float64() for name in chosen},
                    include_columns=chosen,
                    null_values=[""],
                    strings_can_be_null=True,
                    decimal_point=self.decimal,
                ),
            )

    def _open(self, file: Path) -> IO[bytes]:
        return without_footer(self._open_whole(file))

    def _open_whole(self, file: Path) -> IO[bytes]:
        return with_single_blanks(file) if self.delimiter == BLANK else open_text(file)

    def _first_cells(self, file: Path, header: _Header) -> dict[str, list[str]]:
        """Return the filled cells of each column in the first rows."""
        lines = itertools.islice(bounded_lines(file), header.line, header.line + LONGEST_PREAMBLE)
        rows = [self._cells(line.decode(self.encoding, errors="replace").rstrip("\r\n")) for line in lines]
        rows = [row for row in rows if len(row) == len(header.names)]
        return {name: [row[place] for row in rows if row[place]] for place, name in enumerate(header.names) if name}

    def _is_number(self, cell: str) -> bool:
        return is_number(cell, self.decimal)

    def _header(self, file: Path, has_our_names: bool) -> _Header:
        stored: dict[str, Any] = {}
        skipped = self.skip_lines or 0
        for line in self._lines(file, skipped):
            number, text = line
            if text.startswith(OURS.decode()):
                stored = stored_provenance(text.removeprefix(OURS.decode()), file)
            if text.strip() and (self.skip_lines is not None or not text.startswith("#")):
                break
        else:
            above = f" below line {skipped}, up to which skip_lines leaves it out" if skipped else ""
            raise RecordError(f"{file}: the file is empty{above}.")
        if self.skip_lines is None:
            number, text = self._below_preamble(file, number, text)
        names = self._cells(text.lstrip("# "))
        if longest := [len(name) for name in names if len(name) > LONGEST_NAME]:
            raise RecordError(
                f"{file}: line {number} holds {longest[0]} characters where the name of a column should be."
            )
        if all(is_number(name, self.decimal) for name in names):
            raise RecordError(
                f"{file}: line {number} holds numbers where the names of the columns should be. Add them."
            )
        is_spaced = len(names) == 1 and BLANK in names[0] and self._is_spaced_below(file, number)
        for delimiter in ";\t|" + BLANK * is_spaced:
            if len(names) == 1 and delimiter in names[0]:
                raise RecordError(
                    f"{file}: line {number} has no {self.delimiter!r} but {delimiter!r} between its names. Use a "
                    f'mapping file with delimiter = {json.dumps(delimiter)} in [record], and decimal = "," for '
                    f"decimal commas; `fdbench import {file.name}` writes one."
                )
        if has_our_names:
            return _Header(names, number, {}, stored)
        names = unique(names)
        below = next(((place, self._cells(row)) for place, row in self._lines(file, number) if row.strip()), None)
        has_units = below is not None and len(below[1]) == len(names) and any(map(spelt_unit, below[1]))
        if below is None or not has_units or any(is_number(cell, self.decimal) for cell in below[1]):
            return _Header(names, number, {}, stored)
        return _Header(names, below[0], dict(zip(names, below[1], strict=True)), stored)

    def _is_spaced_below(self, file: Path, line: int) -> bool:
        row = next((text for _, text in self._lines(file, line) if text.strip()), "")
        return max(numbers_in(row, BLANK, decimal) for decimal in ".,") > 1

    def _lines(self, file: Path, above: int) -> Iterator[tuple[int, str]]:
        """Yield number and text of the lines below line ``above``."""
        for number, line in enumerate(bounded_lines(file), 1):
            if number > above:
                yield number, self._text(line, number, file)

    def _text(self, line: bytes, number: int, file: Path) -> str:
        try:
            text = line.decode(self.encoding).rstrip("\r\n")
        except UnicodeDecodeError:
            raise RecordError(
                f"{file}: line {number} is not UTF-8 text. Save the file as CSV in UTF-8, or use a mapping file with "
                'encoding = "cp1252" in [record].'
            ) from None
        if _CONTROL.search(text):
            raise RecordError(
                f"{file}: line {number} holds control characters: a binary file, or one with "
                "unusual ends of lines. Save it as CSV in UTF-8."
            )
        return text

    def _cells(self, text: str) -> list[str]:
        return cells_of(text, self.delimiter)

    def _below_preamble(self, file: Path, number: int, text: str) -> tuple[int, str]:
        """Return the header: the first line, or below lines of another width the first as wide as the numbers."""
        seen, width = [(number, text)], len(self._cells(text))
        lines = itertools.islice(bounded_lines(file), number, number + LONGEST_PREAMBLE)
        for place, line in enumerate(lines, number + 1):
            row = line.decode(self.encoding, errors="replace").rstrip("\r\n")
            cells = self._cells(row)
            if cells and all(is_number(cell, self.decimal) for cell in cells):
                alike = [item for item in seen if len(self._cells(item[1])) == len(cells)]
                is_header = bool(alike) and len(cells) != width and all(self._cells(alike[0][1]))
                return alike[0] if is_header else (number, text)
            seen.append((place, row))
        return number, text

    def _fault(self, file: Path, header: _Header, chosen: Collection[str], message: str) -> RecordError:
        """Return what is wrong with a file that the fast reader refused, found by a slow second look."""
        names, empty = header.names, True
        places = {name: names.index(name) for name in chosen}
        with io.TextIOWrapper(self._open(file), self.encoding, errors="replace", newline="") as lines:
            reader = csv.reader(lines, delimiter=self.delimiter)
            for row in reader:
                if reader.line_num <= header.line or not row:
                    continue
                empty = False
                where = f"{file}: line {reader.line_num}"
                cells = self._cells(BLANK.join(row)) if self.delimiter == BLANK else [cell.strip() for cell in row]
                if cells == names:
                    return RecordError(
                        f"{where} repeats the names of the columns. Split the file: one record has one clock."
                    )
                if len(cells) != len(names):
                    return RecordError(
                        f"{where} has {len(cells)} cells, the header has {len(names)}.{self._hint(names)}"
                    )
                for name, place in places.items():
                    cell = cells[place]
                    if not cell:
                        return RecordError(
                            f"{where}, column {name}: the cell is empty. A record has no holes: cut the part out."
                        )
                    if not is_number(cell, self.decimal):
                        shown = cell if len(cell) <= LONGEST_CELL else f"{cell[:LONGEST_CELL]}..."
                        return RecordError(
                            f"{where}, column {name}: {shown!r} is not a number.{self._text_hint(cells, cell)}"
                        )
        return RecordError(f"{file}: 0 samples; a record needs at least 3." if empty else f"{file}: {message}")

    def _hint(self, names: list[str]) -> str:
        hint = " If its numbers have decimal commas: write it with semicolons."
        hint = hint if "," in (self.delimiter, self.decimal) else ""
        if len(names) == 1:
            hint += " Lines above the header are left out by skip_lines in [record] of a mapping file."
        return hint

    def _text_hint(self, cells: list[str], cell: str) -> str:
        other = "," if self.decimal == "." else "."
        if is_number(cell, other):
            return f' If that is its decimal sign, set decimal = "{other}" in [record] of a mapping file.'
        if not any(is_number(other) for other in cells):
            return " A line of units does not belong in the file: remove it, and name the units in a mapping file."
        return " Correct or remove it."
