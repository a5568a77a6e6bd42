"""JSON on standard output."""

import typer

from fdbench.json_text import json_text


def echo_json(value: object) -> None:
    """Print a value as JSON on standard output."""
    typer.echo(json_text(value))
