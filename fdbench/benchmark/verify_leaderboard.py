"""Whether a leaderboard prints what results give: nonce, commit, digests, and every figure of its tables."""

import re
from collections import Counter
from itertools import zip_longest
from pathlib import Path

from fdbench.documents import LARGEST_JSON, read_file
from fdbench.errors import FdbenchError, brief

_SEALED = re.compile(r"\b(nonce|commit|code) `([^`]*)`")
_SCENARIO = re.compile(r"(?P<seeds>.*\bseeds?), digest `(?P<digest>\w+)`\.")
_CELLS = re.compile(r"(?<!\\)\|")


def printed_otherwise(file: str | Path, expected: str) -> list[str]:
    """Return what a leaderboard prints otherwise than the text that results give, a line for each figure.

    Sentences that explain are not compared.

    Raises
    ------
    FdbenchError
        If the file cannot be read, or prints no figure.
    """
    try:
        found = figures(read_file(file, LARGEST_JSON).decode("utf-8"))
    except OSError as error:
        raise FdbenchError(f"{file}: cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise FdbenchError(f"{file}: cannot be read: {error}.") from error
    if not found:
        raise FdbenchError(f"{file}: no leaderboard: it has no table. `fdbench leaderboard` writes one.")
    due = figures(expected)
    return [
        brief(f"{place}: {_quoted(found, place)} is printed, {_quoted(due, place)} follows from the results")
        for place in {**due, **found}
        if found.get(place) != due.get(place)
    ]


def _quoted(known: dict[str, str], place: str) -> str:
    return f"'{known[place]}'" if place in known else "nothing"


def figures(text: str) -> dict[str, str]:
    r"""Return what a leaderboard prints, by where it stands: heading, row and column.

    >>> figures("The nonce `ab`.\n\n## T\n\n| rank | estimator | score |\n| --- | --- | --- |\n| 1 | `x` | 0.5 |")
    {'nonce': 'ab', 'T, x, rank': '1', 'T, x, estimator': '`x`', 'T, x, score': '0.5'}
    """
    top = " ".join(text.partition("\n## ")[0].split())
    listed = [(name, value) for name, value in _SEALED.findall(top)]
    heading, header = "", list[str]()
    for line in text.splitlines():
        if line.startswith("#"):
            heading = line.lstrip("# ")
        elif line.startswith("|"):
            cells = [cell.strip() for cell in _CELLS.split(line.strip().removeprefix("|").removesuffix("|"))]
            if not header:
                header = cells
            elif set(line) - set("|-: "):
                name = cells[header.index("estimator") if "estimator" in header[: len(cells)] else 0].strip("`")
                columns = zip_longest(header, cells, fillvalue="")
                listed += [(f"{heading}, {name}, {column}", cell) for column, cell in columns]
            continue
        elif scenario := _SCENARIO.fullmatch(line):
            listed += [(f"{heading}, {name}", value) for name, value in scenario.groupdict().items()]
        elif line.startswith(("Not ranked", "Not used")):
            listed.append((f"{heading}, {line.partition(',')[0].lower()}", line))
        header = []
    found, counts = dict[str, str](), Counter[str]()
    for place, value in listed:
        counts[place] += 1
        found[place if counts[place] == 1 else f"{place} ({counts[place]})"] = value
    return found
