"""A comparison as a table for the terminal, as a document for programs, and as a comment for a pull request."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from fdbench.benchmark.compare import EVEN, GAIN, LOSS, MISSING, NEW, NOT_JUDGED, VERDICTS, ComparedRow, Comparison
from fdbench.benchmark.job import SPEED
from fdbench.benchmark.leaderboard import shown_unit, value_text
from fdbench.metrics import metrics
from fdbench.wording import markdown_text, public_text

if TYPE_CHECKING:
    from rich.console import Group

HEADER = ("verdict", "scenario", "estimator", "metric", "base → new", "change", "p")
# Lines of one table in a comment, whose length is limited.
MOST_LINES = 50
MOST_METRICS = 3
# Ratio from which on a change is no longer given in per cent.
LARGE = 10.0


def document(comparison: Comparison) -> dict[str, Any]:
    """Return everything in types that JSON has."""
    return {
        "verdict": LOSS if comparison.of(LOSS) else "good",
        "compared": comparison.compared,
        "counts": {verdict: len(comparison.of(verdict)) for verdict in VERDICTS},
        "other_records": list(comparison.other_records),
        "base": dict(comparison.base),
        "new": dict(comparison.new),
        "rows": [asdict(row) for row in comparison.rows],
    }


def summary(comparison: Comparison) -> str:
    """Return the outcome in one line."""
    judged = comparison.of(LOSS, GAIN, EVEN)
    paired = sum(row.paired for row in judged)
    return (
        f"Losses: {len(comparison.of(LOSS))}, gains: {len(comparison.of(GAIN))}; "
        f"{len(judged)} rows compared, {paired} of them on the same records."
    )


def notes(comparison: Comparison) -> Iterator[str]:
    """Yield what else a reader has to know."""
    if comparison.other_records:
        yield (
            f"Same seeds, other records: {', '.join(comparison.other_records)}. The simulation has changed; "
            "these are compared as other seeds are."
        )
    missing = len(comparison.of(MISSING))
    if missing:
        yield f"{missing} rows are missing in the new results."
    for reason in sorted({row.reason for row in comparison.of(NOT_JUDGED)} - {"speed"}):
        rows = [row for row in comparison.of(NOT_JUDGED) if row.reason == reason]
        yield f"Not judged: {', '.join(sorted({f'{row.scenario} {row.estimator}' for row in rows}))}: {reason}."
    ratios = speed_ratios(comparison)
    if ratios:
        times = ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items())
        yield f"Time of a fit, new over base, not judged: {times}."


def speed_ratios(comparison: Comparison) -> dict[str, float]:
    """Return the times that were not judged, by estimator: geometric mean over the scenarios of new over base."""
    logarithms: dict[str, list[float]] = {}
    for row in comparison.of(NOT_JUDGED):
        if row.base and row.new and metrics.get(row.metric).track == SPEED:
            logarithms.setdefault(row.estimator, []).append(math.log(row.new / row.base))
    return {name: math.exp(sum(values) / len(values)) for name, values in sorted(logarithms.items())}


def changes(comparison: Comparison) -> list[list[str]]:
    """Return the cells of all rows that are not even, under `HEADER`."""
    return list(_lines(comparison.of(LOSS, GAIN, NEW, MISSING)))


def terminal(comparison: Comparison) -> "Group":
    """Return the rows that are not even as a table, the notes, and the outcome."""
    from rich import box
    from rich.console import Group
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("verdict", "scenario, estimator, metric", *HEADER[-3:]):
        table.add_column(column, justify="right" if column in ("change", "p") else "left", overflow="fold")
    for verdict, *names, values, change, p_value in changes(comparison):
        style = "red" if verdict == LOSS else None
        table.add_row(verdict, escape(" ".join(names)), escape(values), change, p_value, style=style)
    return Group(*([table] if table.row_count else []), *map(escape, notes(comparison)), summary(comparison))


def markdown(comparison: Comparison) -> str:
    """Return the outcome, the losses, the notes, and folded away the other changes and where the two sides are from."""
    lines = [f"### fdbench: {summary(comparison)}", ""]
    lines += _table(HEADER, list(_lines(comparison.of(LOSS, MISSING))))
    lines += [f"- {note}" for note in notes(comparison)]
    others = list(_lines(comparison.of(GAIN, NEW)))
    if others:
        lines += _folded("Gains and new rows", _table(HEADER, others))
    sides = comparison.base, comparison.new
    origin = [[name, *(markdown_text(side[name]) for side in sides)] for name in comparison.base]
    lines += _folded("Provenance", _table(("", "base", "new"), origin))
    return "\n".join(lines) + "\n"


def _folded(title: str, lines: Sequence[str]) -> list[str]:
    return ["", f"<details><summary>{title}</summary>", "", *lines, "</details>"]


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    if not rows:
        return []
    lines = [header, ["---"] * len(header), *rows[:MOST_LINES]]
    text = [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |" for cells in lines]
    more = len(rows) - MOST_LINES
    return [*text, "", *([f"... and {more} more.", ""] if more > 0 else [])]


def _lines(rows: Sequence[ComparedRow]) -> Iterator[list[str]]:
    """Yield the cells of each row; rows of an estimator with the same reason in place of numbers are one."""
    merged: dict[tuple[str, ...], list[ComparedRow]] = {}
    for row in rows:
        own = (row.metric,) if row.base is not None else ()
        merged.setdefault((row.verdict, row.scenario, row.estimator, row.reason, *own), []).append(row)
    for (verdict, scenario, estimator, *_), group in merged.items():
        names = [row.metric for row in group]
        metric = ", ".join(names) if len(names) <= MOST_METRICS else f"{len(names)} metrics"
        yield [verdict, scenario, estimator, metric, *_numbers(group[0])]


def _numbers(row: ComparedRow) -> tuple[str, str, str]:
    if row.base is None or row.new is None:
        return public_text(row.reason), "", ""
    ratio = row.new / row.base if row.base else math.nan
    change = "" if math.isnan(ratio) else f"{ratio - 1.0:+.1%}" if 0.0 < ratio < LARGE else f"× {ratio:.3g}"
    values = " → ".join(value_text(value, row.unit, 0.0) for value in (row.base, row.new))
    values = f"{values} {shown_unit(row.unit)}".rstrip()
    p_value = "" if row.p_value is None else f"{row.p_value:.1g}"
    return values, change, p_value
