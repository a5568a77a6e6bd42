"""What the terminal shows: progress while jobs run, then the rankings."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from fdbench.benchmark.leaderboard import MOST_NAMED, check_mergeable, interval_text
from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.run import Progress
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.statistics import EVERY, LEVEL, rankings, run_statuses, standings, troubles
from fdbench.benchmark.store import OK, SKIPPED, RunKey, Store
from fdbench.errors import brief, printable
from fdbench.units import time_text

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console, Group
    from rich.table import Table


@contextmanager
def progress(screen: "Console") -> Iterator[Callable[[Progress], None]]:
    """Yield a callback that draws a bar on a terminal, and prints a line for each finished job elsewhere."""
    if not screen.is_terminal:
        yield lambda progress: screen.print(_line(progress), soft_wrap=True) if progress.runs else None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    with Bar(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as bar:
        job = bar.add_task("running", total=None)

        def show(progress: Progress) -> None:
            text = f"{progress.runs[0].scenario} seed {progress.runs[0].seed}" if progress.runs else "running"
            bar.update(job, completed=progress.done, total=progress.total, description=text)

        yield show


def _line(progress: Progress) -> str:
    first = progress.runs[0]
    bad = sorted({run.status for run in progress.runs} - {OK, SKIPPED})
    return f"{progress.done}/{progress.total} {first.scenario} seed {first.seed}{': ' + ', '.join(bad) if bad else ''}"


def ranking_table(scores: "pd.DataFrame") -> "Table | str":
    """Return the rankings of all tracks and kinds of plant, with the median time of a run."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    check_mergeable(scores)
    ranked = rankings(scores)
    if not ranked:
        return "No ranking: no scenario has a run that can be scored."
    runs = scores.drop_duplicates(["scenario", "estimator", "seed"])
    times_s = runs.groupby(["plant", "estimator"])["seconds"].median()
    title = "Score: 1 knows the truth, 0 has learnt nothing (null)"
    table = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for column in ("estimator", "rank", "score", f"{LEVEL:.0%} interval", "covers", "failed", "time"):
        table.add_column(column, justify="left" if column == "estimator" else "right", overflow="fold")
    for track, plant in ranked:
        table.add_row(f"[bold]{track}: {plant}[/]")
        for line in standings(scores, track, plant):
            time_s = times_s[plant, line.estimator]
            table.add_row(
                escape(line.estimator),
                "" if line.rank is None else str(line.rank),
                f"{line.score.value:.3f}",
                interval_text(line.score),
                f"{line.scenarios}/{line.of_scenarios}",
                f"[red]{line.failures}[/]" if line.failures else "0",
                "" if math.isnan(time_s) else time_text(time_s),
            )
        table.add_section()
    return table


def trouble_table(scores: "pd.DataFrame") -> "Group | None":
    """Return the runs that failed or diverged and the scenarios that were skipped, with their reasons.

    Estimators that do not apply to a scenario are left to the leaderboard. None if nothing else went wrong.
    """
    from rich.console import Group
    from rich.markup import escape
    from rich.table import Table

    statuses = run_statuses(scores)
    table = Table(title="Failed runs")
    for column in ("status", "scenario", "estimators", "seeds", "reason"):
        table.add_column(column)
    found = troubles(statuses)
    for line in found:
        if line.status != SKIPPED:
            reason = escape(brief(printable(line.reason)))
            table.add_row(line.status, line.scenario, escape(line.estimators), line.seeds, reason)
    parts: list[Table | str] = [table] if table.row_count else []
    absent = {line.scenario: line.reason for line in found if line.status == SKIPPED and line.estimators == EVERY}
    parts += [f"{scenario} was skipped. {escape(brief(printable(reason)))}" for scenario, reason in absent.items()]
    return Group(*parts) if parts else None


def nothing_good_text(scores: "pd.DataFrame") -> str:
    """Return what is said where no run went well, or an empty text; null and oracle count only where they are alone."""
    statuses = run_statuses(scores)
    others = statuses[~statuses["estimator"].isin([NULL, ORACLE])]
    counts = (statuses if others.empty else others)["status"].value_counts()
    if OK in counts:
        return ""
    apart = "" if others.empty else ", null and oracle apart"
    return f"No run went well{apart}: {', '.join(f'{count} {status}' for status, count in counts.items())}."


def tracebacks_text(store: Store, keys: Iterable[RunKey]) -> str:
    """Return the calls that led to failures of estimators, each once, with the first run in which they were met."""
    met = dict[tuple[str, str], str]()
    for key in sorted(keys):
        run = store.read_run(key)
        if run is not None and run.traceback:
            met.setdefault((run.estimator, run.traceback), f"{run.estimator} on {run.scenario}, seed {run.seed}:")
    return "\n".join(f"{place}\n{calls}" for (_, calls), place in met.items()) or "No run has calls to show."


def stale_text(stale: Sequence[RunKey]) -> str:
    """Return what is said of runs that are left out of the tables.

    >>> print(stale_text([RunKey("S-v0", "x", 0), RunKey("S-v0", "x", 1)]))
    Left out: 2 earlier runs of x on S-v0, as their scenario, their estimator or the code has changed since. Run them
    again to have them back.
    """
    of = " on ".join(_names_or_count({getattr(key, kind) for key in stale}, kind) for kind in ("estimator", "scenario"))
    runs = "1 earlier run" if len(stale) == 1 else f"{len(stale)} earlier runs"
    reason = "as their scenario, their estimator or the code has changed since"
    return f"Left out: {runs} of {of}, {reason}. Run them again to have them back."


def _names_or_count(names: set[str], kind: str) -> str:
    return ", ".join(sorted(names)) if len(names) <= MOST_NAMED else f"{len(names)} {kind}s"
