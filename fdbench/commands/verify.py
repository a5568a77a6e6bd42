"""``fdbench verify``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.checks.plugin_files import add_effects
from fdbench.commands._options import DEFAULT_OUT, Effects, existing
from fdbench.commands._say import say


def verify(
    folder: Annotated[Path, typer.Argument(help="Folder of results.")] = DEFAULT_OUT,
    runs: Annotated[int, typer.Option(min=1, help="How many runs to make again, drawn at random.")] = 20,
    estimator: Annotated[
        list[str] | None, typer.Option(metavar="FILE", help="Python file of an estimator that is not installed.")
    ] = None,
    scenario: Annotated[
        list[str] | None, typer.Option(metavar="FILE", help="TOML file of a scenario that is not of fdbench.")
    ] = None,
    effect: Effects = None,
) -> None:
    """Make a sample of the stored runs again and say whether the scores are the same; exit with 1 if they are not."""
    from rich.console import Console

    from fdbench.benchmark.verify import verify as repeat
    from fdbench.estimator import estimators

    add_effects(effect)
    for file in estimator or []:
        estimators.declare(file)
    screen = Console(stderr=True)
    with screen.status("repeating runs") as status:
        found = repeat(
            existing(folder, "scores.parquet"),
            runs,
            scenarios=scenario or (),
            progress=lambda done, total: status.update(f"repeating runs, {done} of {total}"),
        )
    for line in found.differences:
        where = f"{line.key.scenario}, {line.key.estimator}, seed {line.key.seed}"
        say(f"{where}: {line.metric} was {line.stored:.6g}, is {'missing' if line.now is None else line.now}")
    for name in found.changed:
        say(f"{name} has changed since these results were made")
    word = "the same" if found.is_same else "not the same"
    say(
        f"{found.runs} runs made again, {found.scores} scores: {word}; largest relative difference {found.largest:.1e}."
    )
    if not found.is_same:
        raise typer.Exit(1)
