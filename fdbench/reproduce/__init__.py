"""The published figures beside ours: one paper, one file."""

import importlib
import pkgutil

from fdbench.errors import UnknownName, did_you_mean
from fdbench.reproduce._row import Row, rows_of


def papers() -> list[str]:
    """Return the names of the papers, the files of this package."""
    return sorted(item.name for item in pkgutil.iter_modules(__path__) if not item.name.startswith("_"))


def run(paper: str | None = None) -> list[Row]:
    """Return the rows of one paper, or of all; what raises is a failed row and ends its part of the paper alone.

    Raises
    ------
    UnknownName
        If there is no such paper; the message gives the nearest one.
    """
    if paper is not None and paper not in papers():
        raise UnknownName(f"unknown paper '{paper}'.{did_you_mean(paper, papers())}")
    found: list[Row] = []
    for name in [paper] if paper else papers():
        module = importlib.import_module(f"{__name__}.{name}")
        found += rows_of(module.PAPER, module.parts())
    return found
