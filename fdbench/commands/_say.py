"""Text on the terminal."""

import typer

from fdbench.errors import printable


def say(text: str, *, is_aside: bool = False) -> None:
    """Print lines on standard output, or, aside, on standard error; names of files and columns write no escapes."""
    typer.echo(printable(text, in_lines=True), err=is_aside)
