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
    from fdbench.registry import fault

    add_effects(effect)
    name = _declared(plugin) if plugin.endswith(".py") else plugin
    try:
        lines = run_checks(name)
    except (Exception, SystemExit) as error:
        if isinstance(error, FdbenchError) and not isinstance(error, PluginError):
            raise
        text = str(error) if isinstance(error, PluginError) else f"{name}: {fault(error, Path(plugin).resolve())}"
        typer.echo(f"fdbench: {text}", err=True)
        raise typer.Exit(1) from error
    typer.echo("\n".join(lines))


def _declared(file: str) -> str:
    """Return the name of a plug-in in a file, which is imported in a process of its own first."""
    from contextlib import closing

    from fdbench.effects import effects
    from fdbench.estimator import estimators
    from fdbench.registry import owner
    from fdbench.sandbox import Limits, Misbehaved, Sandbox, Source

    path = Path(file).resolve()
    if owner(Path(file), (estimators, effects)) is not None:
        return path.stem
    source = Source(name=path.stem, own=(path,), group=str(path), digest="", file=path)
    with closing(Sandbox(Limits())) as sandbox:
        try:
            kind = sandbox.worker(source).load(source, ("estimator", "effect"))
        except Misbehaved as error:
            text = str(error).removeprefix("PluginError: ").replace(str(path), file)
            raise PluginError(text if file in text else f"{file}: {text}") from error
    return estimators.declare(file) if kind == "estimator" else effects.add_file(file)
