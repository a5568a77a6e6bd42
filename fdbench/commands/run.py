"""``fdbench run``."""

import os
from pathlib import Path
from typing import Annotated

import typer

from fdbench.benchmark.suite import SEEDS, Suite
from fdbench.commands._options import DEFAULT_OUT, SCENARIO, Effects, Jobs, MemoryLimit, Scheduler, TimeLimit, names_of
from fdbench.commands._say import say
from fdbench.errors import FdbenchError


def results_folder(path: Path) -> Path:
    """Return a folder to write in, which need not exist yet."""
    nearest = next(parent for parent in (path, *path.absolute().parents) if parent.exists())
    if not nearest.is_dir():
        raise FdbenchError(f"{path}: cannot be made: {nearest} is a file, not a folder.")
    if not os.access(nearest, os.W_OK):
        raise FdbenchError(f"{path}: cannot be written: permission denied.")
    return path


def run(
    suite: Annotated[
        Suite, typer.Option(help="Scenarios to run, unless --scenario names some: a selection, or all.")
    ] = Suite.QUICK,
    scenario: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID|FILE",
            autocompletion=names_of(SCENARIO),
            help="Id or TOML file of a scenario; may be repeated.",
        ),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|FILE",
            autocompletion=names_of("estimator"),
            help="Name or Python file of an estimator, with arguments as in 'krls_t[budget=20|50,mode=UI]'; may be "
            "repeated. Default: all installed ones. null and oracle, which scores are measured against, always run.",
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=1, help="Number of seeds, each another machine with other noise; quick: 3, full: 10."),
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
    jobs: Jobs = None,
    scheduler: Scheduler = "",
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

    from fdbench import api
    from fdbench.benchmark import console
    from fdbench.benchmark.store import SKIPPED, Store

    screen = Console()
    with console.progress(screen) as shown:
        result = api.run(
            scenario or suite,
            estimator,
            seeds or SEEDS[suite],
            out,
            effects=effect or (),
            jobs=jobs,
            scheduler=scheduler,
            report=not no_report,
            sealed=sealed,
            nonce=nonce,
            first_seed=first_seed,
            keep_estimates=keep_estimates,
            time_limit_s=time_limit,
            memory_limit_MB=memory_limit,
            progress=shown,
        )
    summary, scores = result.summary, result.scores()
    screen.print(console.ranking_table(scores))
    trouble = console.trouble_table(scores)
    if trouble is not None:
        screen.print(trouble)
    if traceback:
        say(console.tracebacks_text(Store(out), summary.keys), is_aside=True)
    counts = ", ".join(f"{count} {status}" for status, count in summary.statuses.items())
    reasons = f" Why runs were skipped: {out}/leaderboard.md." if summary.statuses[SKIPPED] else ""
    say(f"{summary.computed} runs done, {summary.reused} kept from before ({counts}).{reasons}")
    if summary.others:
        say(f"The files hold {summary.others} other {'run' if summary.others == 1 else 'runs'} of this folder too.")
    if summary.stale:
        say(console.stale_text(summary.stale))
    say(f"Written: {', '.join(f'{out}/{name}' for name in ('scores.parquet', *result.written))}")
    if result.unchanged:
        say(f"As before: {', '.join(f'{out}/{name}' for name in result.unchanged)}")
    if text := console.nothing_good_text(scores):
        say(text)
        raise typer.Exit(1)
