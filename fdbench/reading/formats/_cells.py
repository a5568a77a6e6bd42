"""Cells of a line of text, and what is a number."""

import csv
import itertools
import re
from pathlib import Path

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


def cells_of(text: str, delimiter: str) -> list[str]:
    """Return the cells of a line."""
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter), [])]


def numbers_in(row: str, delimiter: str, decimal: str) -> int:
    """Return how many numbers a line holds, 0 where it holds fewer than two or more words than numbers."""
    cells = [cell for cell in cells_of(row, delimiter) if cell]
    numbers = sum(is_number(cell, decimal) for cell in cells)
    return numbers if numbers >= 2 and 2 * numbers >= len(cells) else 0


def line_of(file: Path, header_line: int, sample: int) -> int:
    """Return the line of a sample; blank lines do not count as samples."""
    with file.open("rb") as lines:
        filled = (number for number, line in enumerate(lines, 1) if number > header_line and line.strip(b"\r\n"))
        return next(itertools.islice(filled, sample, None))
