"""``fdbench verify``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.checks.plugin_files import add_effects, distinct
from fdbench.commands._options import DEFAULT_OUT, Effects, existing
from fdbench.commands._say import say

MOST_FIGURES = 20  # that are printed one by one


def verify(
    folder: Annotated[Path, typer.Argument(help="Folder of results.")] = DEFAULT_OUT,
    runs: Annotated[int, typer.Option(min=1, help="How many runs to make again, drawn at random.")] = 20,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE", help="Python file of an estimator that is neither installed nor still where it was."
        ),
    ] = None,
    scenario: Annotated[
        list[str] | None, typer.Option(metavar="FILE", help="TOML file of a scenario that is not of fdbench.")
    ] = None,
    effect: Effects = None,
    leaderboard: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Leaderboard whose figures have to be those of the folder; default: leaderboard.md in it, where there "
            "is one.",
        ),
    ] = None,
) -> None:
    """Hold a leaderboard against the stored runs, make a sample of these again, and say whether all is the same.

    Exits with 1 if it is not.
    """
    from rich.console import Console

    from fdbench.benchmark.verify import verify as repeat
    from fdbench.estimator import estimators

    existing(folder, "scores.parquet")
    add_effects(effect)
    for file in distinct(estimator or []):
        estimators.declare(file)
    is_printed = _is_printed(folder, leaderboard)
    screen = Console(stderr=True)
    with screen.status("repeating runs") as status:
        found = repeat(
            folder,
            runs,
            scenarios=scenario or (),
            progress=lambda done, total: status.update(f"repeating runs, {done} of {total}"),
        )
    for line in found.differences:
        where = f"{line.key.scenario}, {line.key.estimator}, seed {line.key.seed}"
        stored = f"{line.stored:.6g}" if isinstance(line.stored, float) else line.stored
        say(f"{where}: {line.metric} was {stored}, is {'missing' if line.now is None else line.now}")
    for name in found.changed:
        say(f"{name} has changed since these results were made")
    word = "the same" if found.is_same else "not the same"
    say(
        f"{found.runs} runs made again, {found.scores} scores: {word}; largest relative difference {found.largest:.1e}."
    )
    if not (found.is_same and is_printed):
        raise typer.Exit(1)


def _is_printed(folder: Path, file: Path | None) -> bool:
    """Say whether a leaderboard prints what the results give, or how not; without one there is nothing to say."""
    from fdbench.benchmark import leaderboard as rankings
    from fdbench.benchmark.store import Store
    from fdbench.benchmark.verify_leaderboard import printed_otherwise
    from fdbench.trials.board import board, published

    if file is None:
        file = folder / "leaderboard.md"
        if not file.exists():
            return True
    found = printed_otherwise(file, rankings.leaderboard(Store(folder)) + board(published()))
    for text in found[:MOST_FIGURES]:
        say(f"{file}: {text}")
    if len(found) > MOST_FIGURES:
        say(f"{file}: and {len(found) - MOST_FIGURES} more")
    if not found:
        say(f"{file} prints what these results give.")
    return not found
