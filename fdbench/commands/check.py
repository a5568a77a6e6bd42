"""``fdbench check``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._options import Effects
from fdbench.commands._plugins import add_effects
from fdbench.errors import FdbenchError, PluginError


def check(
    plugin: Annotated[str, typer.Argument(help="Name of an estimator, effect or scenario, or its file.")],
    effect: Effects = None,
) -> None:
    """Check an estimator, effect or scenario, such as your own file; exit with 1 where a check fails."""
    from fdbench.checks import check as run_checks
    from fdbench.effects import effects
    from fdbench.estimator import estimators
    from fdbench.registry import add_file, fault

    add_effects(effect)
    name = add_file(plugin, (estimators, effects)) if plugin.endswith(".py") else plugin
    try:
        lines = run_checks(name)
    except (Exception, SystemExit) as error:
        if isinstance(error, FdbenchError) and not isinstance(error, PluginError):
            raise
        text = str(error) if isinstance(error, PluginError) else f"{name}: {fault(error, Path(plugin).resolve())}"
        typer.echo(f"fdbench: {text}", err=True)
        raise typer.Exit(1) from error
    typer.echo("\n".join(lines))
