"""Text on the terminal."""

import shlex
from pathlib import Path

import typer

from fdbench.errors import printable


def say(text: str, *, is_aside: bool = False) -> None:
    """Print lines on standard output, or, aside, on standard error; names of files and columns write no escapes."""
    typer.echo(printable(text, in_lines=True), err=is_aside)


def typed(path: Path) -> str:
    """Return a path as it is typed in a shell, where a dash begins an option.

    >>> typed(Path("my log.csv")), typed(Path("-x.csv"))
    ("'my log.csv'", './-x.csv')
    """
    return shlex.quote(f"./{path}" if str(path).startswith("-") else str(path))
