"""Rows as tables for the terminal."""

import math
from collections.abc import Sequence
from itertools import groupby

from fdbench.reproduce._row import Row

MARK = {True: "yes", False: "[red]NO[/]"}


def shown(row: Row) -> str:
    """Return our figure to a hundredth of its tolerance: what is beyond differs between processors.

    >>> shown(Row(paper="A", item="b", paper_value=None, value=3e-13, target=0.0, tolerance=0.02, kind="must"))
    '0'
    """
    if not (row.tolerance > 0.0 and math.isfinite(row.value)):
        return f"{row.value:.4g}"
    step = 10.0 ** math.floor(math.log10(row.tolerance) - 2.0)
    return f"{round(row.value / step) * step:.6g}"


def show(rows: Sequence[Row]) -> None:
    """Print one table for each paper."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    screen = Console()
    for paper, group in groupby(rows, key=lambda row: row.paper):
        table = Table(title=paper)
        for column in ("figure", "paper", "ours", "target", "tolerance", "kind", "holds", "note"):
            table.add_column(column, justify="left" if column in ("figure", "kind", "note") else "right")
        for row in group:
            printed = "" if row.paper_value is None else f"{row.paper_value:.6g}"
            numbers = (printed, shown(row), f"{row.target:.6g}", f"{row.tolerance:.2g}")
            holds = "-" if row.kind == "not reproducible" else MARK[row.ok]
            table.add_row(escape(row.item), *numbers, row.kind, holds, escape(row.reason))
        screen.print(table)
    failed = [row for row in rows if not row.ok]
    screen.print(f"{len(rows)} figures, {len(failed)} outside their tolerance.")
