"""``fdbench report``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._options import Html, existing


def report(
    source: Annotated[Path, typer.Argument(help="Folder of results, or JSON file of `fdbench diagnose --json`.")],
    output: Html = Path("report.html"),
) -> None:
    """Write a page of results, or of the answer of a diagnosis: one HTML file that needs no network."""
    if source.is_file() or source.suffix == ".json":
        from fdbench.report.answer import write_answer

        write_answer(source, output)
    else:
        from fdbench.report import write_report

        write_report(existing(source, "scores.parquet"), output)
