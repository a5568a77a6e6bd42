"""``fdbench reproduce``."""

from typing import Annotated

import typer

from fdbench.commands._json import echo_json
from fdbench.commands._options import Json


def reproduce(
    paper: Annotated[str | None, typer.Argument(help="Name of a paper, such as mcpherson; default: all.")] = None,
    json_: Json = False,
) -> None:
    """Show each paper's figures beside ours; exit with 1 where a figure is outside its tolerance."""
    from fdbench.reproduce import run as run_reproduction

    rows = run_reproduction(paper)
    if json_:
        echo_json([row.as_dict() for row in rows])
    else:
        from fdbench.reproduce._table import show

        show(rows)
    if not all(row.ok for row in rows):
        raise typer.Exit(1)
