"""How a table of text is written, found by the layout in which most cells are numbers."""

import itertools
import statistics
from pathlib import Path
from typing import NamedTuple

from fdbench.errors import RecordError
from fdbench.reading.formats._cells import BLANK, bounded_lines, cells_of, numbers_in

DELIMITERS = f";\t|,{BLANK}"
LONGEST_PREAMBLE = 100  # lines


class Layout(NamedTuple):
    """What stands between cells, the decimal sign, the lines above the names unless they follow, and the encoding."""

    delimiter: str
    decimal: str
    skip_lines: int | None
    encoding: str


def layout_of(file: Path) -> Layout:
    """Return how a file is written.

    Raises
    ------
    RecordError
        If it has no table of numbers, or that has no line of names above it.
    """
    encoding = "utf-8" if all(map(_is_utf_8, bounded_lines(file))) else "cp1252"
    lines = itertools.islice(bounded_lines(file), 2 * LONGEST_PREAMBLE)
    head = b"".join(lines).decode(encoding, errors="replace").splitlines()[: 2 * LONGEST_PREAMBLE]
    layouts = [(mark, decimal) for mark in DELIMITERS for decimal in ".," if mark != decimal]
    delimiter, decimal = max(layouts, key=lambda layout: sum(numbers_in(row, *layout) for row in head))
    cells = [cells_of(row, delimiter) for row in head]
    widths = {place: len(cells[place]) for place, row in enumerate(head) if numbers_in(row, delimiter, decimal)}
    if not widths:
        raise RecordError(
            f"{file}: no line of at least two numbers among the first {len(head)}, between commas, semicolons, "
            "tabs, bars or blanks: no table of samples."
        )
    width = statistics.mode(widths.values())  # a line above the names may hold numbers too
    first = next(place for place in widths if widths[place] == width)
    above = [place for place in range(first) if len(cells[place]) == width and head[place].strip()]
    if not above:
        one_word = " Between blanks a name is one word, or one in quotes." if delimiter == BLANK else ""
        raise RecordError(
            f"{file}: line {first + 1} holds {width} numbers, but no line above it as many names. Add one.{one_word}"
        )
    # Of two such lines the lower one has the units.
    header = above[-2] if len(above) > 1 and above[-2:] == [first - 2, first - 1] else above[-1]
    is_first = not any(row.strip() for row in head[:header]) and not head[header].startswith("#")
    return Layout(delimiter, decimal, None if is_first else header, encoding)


def _is_utf_8(line: bytes) -> bool:
    try:
        line.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True
