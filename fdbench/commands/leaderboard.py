"""``fdbench leaderboard``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._options import DEFAULT_OUT, existing, file_to_write
from fdbench.commands._say import say
from fdbench.files import write_text


def leaderboard(
    folder: Annotated[Path, typer.Argument(help="Folder of results.")] = DEFAULT_OUT,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit with 1 if the file would change.")
    ] = False,
    output: Annotated[Path, typer.Option("-o", "--output", callback=file_to_write, help="File to write.")] = Path(
        "leaderboard.md"
    ),
) -> None:
    """Write leaderboard.md from a folder of results."""
    from fdbench.benchmark import leaderboard as rankings
    from fdbench.benchmark.store import Store
    from fdbench.trials.board import board, published

    text = rankings.leaderboard(Store(existing(folder, "scores.parquet"))) + board(published())
    if not check:
        write_text(output, text)
        return
    difference = rankings.difference(text, output)
    if difference:
        say(difference)
        raise typer.Exit(1)
