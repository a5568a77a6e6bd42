"""``fdbench run``."""

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._options import DEFAULT_OUT, Effects, MemoryLimit, TimeLimit
from fdbench.commands._plugins import add_effects, distinct
from fdbench.errors import FdbenchError


class Suite(StrEnum):
    """Selections of scenarios: two of drawn machines, and the published trials that these were made of."""

    QUICK = "quick"
    FULL = "full"
    PUBLISHED = "published"


SEEDS = {Suite.QUICK: 3, Suite.FULL: 10, Suite.PUBLISHED: 3}


def results_folder(path: Path) -> Path:
    """Return a folder to write in, which need not exist yet."""
    nearest = next(parent for parent in (path, *path.absolute().parents) if parent.exists())
    if not nearest.is_dir():
        raise FdbenchError(f"{path}: cannot be made: {nearest} is a file, not a folder.")
    if not os.access(nearest, os.W_OK):
        raise FdbenchError(f"{path}: cannot be written: permission denied.")
    return path


def in_suite(suite: Suite) -> list[str]:
    """Return the ids of a suite; of several versions the newest counts, the others are published trials."""
    from fdbench.catalogue import newest_ids, scenario_ids
    from fdbench.scenario import load_scenario

    newest = newest_ids()
    if suite is Suite.PUBLISHED:
        return [name for name in scenario_ids() if name not in newest]
    return [name for name in newest if suite in load_scenario(name).suites]


def run(
    suite: Annotated[
        Suite, typer.Option(help="Scenarios to run, unless --scenario names some: a selection, or all.")
    ] = Suite.QUICK,
    scenario: Annotated[
        list[str] | None, typer.Option(metavar="ID|FILE", help="Id or TOML file of a scenario; may be repeated.")
    ] = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Name or Python file of an estimator; may be repeated. Default: all installed ones. null and oracle, "
            "which scores are measured against, always run.",
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=1, help="Number of seeds, that is of repeats with other noise; quick: 3, full: 10."),
    ] = None,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed; the others follow it.")] = 0,
    sealed: Annotated[
        bool,
        typer.Option("--sealed", help="Draw secret seeds after the digests of all estimators are written down."),
    ] = False,
    nonce: Annotated[
        str, typer.Option(metavar="HEX", help="Repeat the seeds of a sealed run: the nonce of its leaderboard.")
    ] = "",
    effect: Effects = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: one for each core.")] = None,
    out: Annotated[
        Path,
        typer.Option(callback=results_folder, help="Folder of results; what it holds and still applies is kept."),
    ] = DEFAULT_OUT,
    keep_estimates: Annotated[
        bool, typer.Option("--keep-estimates", help="Keep records and estimates of every seed, not of the first alone.")
    ] = False,
    no_report: Annotated[
        bool, typer.Option("--no-report", help="Leave out report.html; one of an earlier run stays as it is.")
    ] = False,
    time_limit: TimeLimit = 300.0,
    memory_limit: MemoryLimit = 4096.0,
    traceback: Annotated[
        bool, typer.Option("--traceback", help="Print the calls that led to each failure of an estimator.")
    ] = False,
) -> None:
    """Run estimators on scenarios, score and rank them; what is finished and has not changed is not run again.

    Exits with 1 if no run of the selection went well, null and oracle apart.
    """
    from rich.console import Console

    from fdbench.benchmark import console, leaderboard
    from fdbench.benchmark.run import run as run_benchmark
    from fdbench.benchmark.run import select
    from fdbench.benchmark.store import SKIPPED, Store
    from fdbench.commands._written import write_changed
    from fdbench.report import write_report
    from fdbench.trials.board import board, published

    add_effects(effect)
    chosen = scenario or in_suite(suite)
    names = [*select(distinct(estimator))] if estimator else None
    screen = Console()
    with console.progress(screen) as shown:
        summary = run_benchmark(
            chosen,
            names,
            seeds or SEEDS[suite],
            out,
            sealed=sealed,
            nonce=nonce,
            first_seed=first_seed,
            jobs=jobs or os.cpu_count() or 1,
            keep_estimates=keep_estimates,
            time_limit_s=time_limit,
            memory_limit_MB=memory_limit,
            progress=shown,
        )
    store = Store(out)

    def write_leaderboard(file: Path) -> None:
        file.write_text(leaderboard.leaderboard(store) + board(published()), encoding="utf-8")

    def write_page(file: Path) -> None:
        write_report(out, file)

    makers = {"leaderboard.md": write_leaderboard, **({} if no_report else {"report.html": write_page})}
    written = write_changed(out, makers)
    scores = store.scores(summary.keys)
    screen.print(console.ranking_table(scores))
    trouble = console.trouble_table(scores)
    if trouble is not None:
        screen.print(trouble)
    if traceback:
        typer.echo(console.tracebacks_text(store, summary.keys), err=True)
    counts = ", ".join(f"{count} {status}" for status, count in summary.statuses.items())
    reasons = f" Why runs were skipped: {out}/leaderboard.md." if summary.statuses[SKIPPED] else ""
    typer.echo(f"{summary.computed} runs done, {summary.reused} kept from before ({counts}).{reasons}")
    if summary.others:
        typer.echo(
            f"The files hold {summary.others} other {'run' if summary.others == 1 else 'runs'} of this folder too."
        )
    if summary.stale:
        typer.echo(console.stale_text(summary.stale))
    typer.echo(f"Written: {', '.join(f'{out}/{name}' for name in ('scores.parquet', *written))}")
    unchanged = [f"{out}/{name}" for name in makers if name not in written]
    if unchanged:
        typer.echo(f"As before: {', '.join(unchanged)}")
    if text := console.nothing_good_text(scores):
        typer.echo(text)
        raise typer.Exit(1)
