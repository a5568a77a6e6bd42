"""``fdbench check``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.checks.plugin_files import add_effects
from fdbench.commands._options import PLUGINS, SCENARIO, Effects, MemoryLimit, TimeLimit, names_of
from fdbench.commands._say import say
from fdbench.errors import FdbenchError, PluginError


def check(
    plugin: Annotated[
        str,
        typer.Argument(
            autocompletion=names_of(SCENARIO, *PLUGINS), help="Name of a plug-in or scenario; or the file of one."
        ),
    ],
    effect: Effects = None,
    time_limit: TimeLimit = 300.0,
    memory_limit: MemoryLimit = 4096.0,
) -> None:
    """Check an estimator, effect, scenario or other plug-in, such as your own file; exit with 1 where a check fails."""
    from contextlib import closing

    from fdbench.checks import check_declared, declare
    from fdbench.registry import fault
    from fdbench.sandbox import Sandbox, WorkerLimits

    add_effects(effect)
    with closing(Sandbox(WorkerLimits(time_s=time_limit, memory_MB=memory_limit))) as sandbox:
        name = declare(plugin, sandbox)
        try:
            lines = check_declared(name, sandbox)
        except (Exception, SystemExit) as error:
            if isinstance(error, FdbenchError) and not isinstance(error, PluginError):
                raise
            text = str(error) if isinstance(error, PluginError) else f"{name}: {fault(error, Path(plugin).resolve())}"
            say(f"fdbench: {text}", is_aside=True)
            raise typer.Exit(1) from error
    say("\n".join(lines))
