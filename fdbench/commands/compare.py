"""``fdbench compare``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._json import echo_json
from fdbench.commands._options import Json, existing, file_to_write
from fdbench.files import write_text


def compare(
    base: Annotated[Path, typer.Argument(help="Folder of results to compare with.")],
    new: Annotated[Path, typer.Argument(help="Folder of results that must not be worse.")],
    json_: Json = False,
    markdown: Annotated[
        Path | None, typer.Option(callback=file_to_write, help="File for a summary in Markdown.")
    ] = None,
    allow_missing: Annotated[bool, typer.Option("--allow-missing", help="Accept that NEW lacks rows of BASE.")] = False,
    gate_speed: Annotated[
        bool, typer.Option("--gate-speed", help="Judge times too; both must be of one machine and one FDBENCH_RUN_ID.")
    ] = False,
) -> None:
    """Compare two folders of results; exit with 1 where NEW is worse by more than chance and by more than matters."""
    from rich.console import Console

    from fdbench import api
    from fdbench.benchmark import compare_text

    sides = [existing(folder, "scores.parquet") for folder in (base, new)]
    result = api.compare(*sides, allow_missing=allow_missing, gate_speed=gate_speed)
    found = result.comparison
    if markdown is not None:
        write_text(markdown, compare_text.markdown(found))
    if json_:
        echo_json(compare_text.document(found))
    else:
        Console().print(compare_text.terminal(found))
    if result.has_loss:
        raise typer.Exit(1)
