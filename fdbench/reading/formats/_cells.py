"""Cells of a line of text, and what is a number."""

import contextlib
import csv
import io
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from fdbench.errors import RecordError
from fdbench.reading.formats._text import open_text

LONGEST_LINE = 2**20  # bytes
BLANK, BRACKETS = " ", ("[", "(")
COMMENT_SIGNS = "#% "
OURS = b"# fdbench "
NUMBERS = {
    decimal: re.compile(rf"[+-]?((\d+({point}\d*)?|{point}\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.IGNORECASE)
    for decimal, point in ((".", r"\."), (",", ","))
}


def is_number(text: str, decimal: str = ".") -> bool:
    """Return whether a cell holds a number.

    >>> is_number("1,5"), is_number("1,5", ",")
    (False, True)
    """
    return NUMBERS[decimal].fullmatch(text) is not None


def number_in(cell: str) -> float:
    """Return the number in a cell, written as in C: what Python alone takes for one is none.

    >>> number_in("1e3")
    1000.0
    >>> number_in("1_0")
    Traceback (most recent call last):
    ValueError: '1_0' is not a number
    """
    if "_" not in cell and cell.isascii():
        with contextlib.suppress(ValueError):
            return float(cell)
    raise ValueError(f"'{cell}' is not a number")


def cells_of(text: str, delimiter: str) -> list[str]:
    """Return the cells of a line; between blanks there may be several, and a unit in brackets belongs to its name.

    >>> cells_of("a b; c", ";"), cells_of("  time [s]   force  x ", BLANK)
    (['a b', 'c'], ['time [s]', 'force', 'x'])
    """
    line = " ".join(text.lstrip(COMMENT_SIGNS).split()) if delimiter == BLANK else text
    cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    if delimiter != BLANK:
        return cells
    named: list[str] = []
    for cell in cells:
        if named and cell.startswith(BRACKETS) and not named[-1].startswith(BRACKETS):
            named[-1] += f" {cell}"
        else:
            named.append(cell)
    return named


def numbers_in(row: str, delimiter: str, decimal: str) -> int:
    """Return how many numbers a line holds, 0 where it holds fewer than two, more words, or a comment."""
    if row.startswith(tuple(COMMENT_SIGNS.strip())):
        return 0
    cells = [cell for cell in cells_of(row, delimiter) if cell]
    numbers = sum(is_number(cell, decimal) for cell in cells)
    return numbers if numbers >= 2 and 2 * numbers >= len(cells) else 0


def bounded_lines(file: Path) -> Iterator[bytes]:
    """Yield the lines of a file, as `open_text` has them.

    Raises
    ------
    RecordError
        If one is longer than `LONGEST_LINE`, as a binary file's may be.
    """
    with open_text(file) as stream:
        number = 0
        while line := stream.readline(LONGEST_LINE + 1):
            number += 1
            if len(line) > LONGEST_LINE:
                raise RecordError(f"{file}: line {number} is longer than {LONGEST_LINE} bytes: no table of samples.")
            yield line


def line_of(file: Path, header_line: int, sample: int) -> int:
    """Return the line of a sample; blank lines do not count as samples."""
    lines = enumerate(bounded_lines(file), 1)
    filled = (number for number, line in lines if number > header_line and line.strip(b"\r\n"))
    return next(itertools.islice(filled, sample, None))


def footer_of(stream: IO[bytes]) -> bytes:
    r"""Return the comments below a table of text, with the blank lines among them; the stream stays where it is.

    >>> footer_of(io.BytesIO(b"t,x\n0,1\n\n# end\n"))
    b'\n# end\n'
    """
    start = stream.tell()
    stream.seek(max(start, stream.seek(0, io.SEEK_END) - LONGEST_LINE))
    rows = stream.read().split(b"\n")
    stream.seek(start)
    footer = list(itertools.takewhile(lambda row: not row.strip() or _is_comment(row), reversed(rows)))[::-1]
    return b"\n".join(footer) if len(footer) < len(rows) and any(map(_is_comment, footer)) else b""


def without_footer(stream: IO[bytes]) -> IO[bytes]:
    """Return a stream of a table of text that ends where `footer_of` begins."""
    footer = footer_of(stream)
    if not footer:
        return stream
    with stream:
        return io.BytesIO(stream.read().removesuffix(footer))


def _is_comment(row: bytes) -> bool:
    return row.lstrip().startswith(tuple(sign.encode() for sign in COMMENT_SIGNS.strip()))


def check_end(file: Path, decimal: str) -> None:
    """Refuse a file that was cut within its last number, where that can be told.

    fdbench ends each line; elsewhere the last one need not have an end (RFC 4180), but has as many decimals as the
    others where these all have as many.
    """
    with open_text(file) as stream:
        is_ours = stream.read(len(OURS)) == OURS
        stream.seek(max(0, stream.seek(0, io.SEEK_END) - LONGEST_LINE))
        rows = stream.read().split(b"\n")
    if rows[-1].strip() == b"" or _is_comment(rows[-1]):
        return
    mark = re.escape(decimal.encode())
    decimals = [re.search(mark + rb"(\d+)\s*$", row) for row in rows[1:]]
    digits = {0 if found is None else len(found[1]) for found in decimals[:-1]}
    last = 0 if not decimals or decimals[-1] is None else len(decimals[-1][1])
    if is_ours or (len(digits) == 1 and last < max(digits)):
        raise RecordError(f"{file}: the last line has no end. The file was cut there: remove the line.")
