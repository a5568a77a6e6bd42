"""Shared checks of plug-ins, for the project's own tests and for everybody else's."""

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fdbench.sandbox import Sandbox, WorkerLimits


def check(plugin: str, limits: "WorkerLimits | None" = None) -> list[str]:
    """Run the checks that fit a plug-in: a name, a Python file of an estimator or effect, or a scenario.

    Parameters
    ----------
    plugin : str
    limits : WorkerLimits, optional
        Of each fit of an estimator, which runs in a process of its own.

    Raises
    ------
    FdbenchError
        If there is no such plug-in, or a check fails.
    """
    from fdbench.sandbox import Sandbox, WorkerLimits

    with closing(Sandbox(limits or WorkerLimits())) as sandbox:
        return check_declared(declare(plugin, sandbox), sandbox)


def check_declared(plugin: str, sandbox: "Sandbox") -> list[str]:
    """Run the checks that fit a registered name, or a scenario; see `check`."""
    from fdbench.catalogue import scenario_ids
    from fdbench.effects import effects
    from fdbench.errors import UnknownName, did_you_mean
    from fdbench.estimator import estimators

    if plugin.endswith(".toml") or plugin.removeprefix("fdbench/") in scenario_ids():
        from fdbench.checks.check_scenario import check_scenario

        return check_scenario(plugin)
    if plugin in estimators.names():
        from fdbench.checks.check_estimator import check_estimator

        return check_estimator(plugin, sandbox)
    if plugin in effects.names():
        from fdbench.checks.check_effect import check_effect

        return check_effect(effects.get(plugin))
    names = [*estimators.names(), *effects.names(), *scenario_ids()]
    raise UnknownName(f"unknown plug-in '{plugin}'.{did_you_mean(plugin, names)}")


def declare(plugin: str, sandbox: "Sandbox") -> str:
    """Return the name of a plug-in in a Python file, which a worker imports; anything else as it is.

    Raises
    ------
    PluginError
        If the file cannot be imported or holds no plug-in.
    """
    from fdbench.effects import effects
    from fdbench.errors import PluginError
    from fdbench.estimator import estimators
    from fdbench.registry import owner
    from fdbench.sandbox import Misbehaved, Source

    if not plugin.endswith(".py"):
        return plugin
    path = Path(plugin).resolve()
    if owner(Path(plugin), (estimators, effects)) is not None:
        return path.stem
    try:
        worker = sandbox.worker(Source(name=path.stem, own=(path,), digest="", file=path))
        kind = worker.load(("estimator", "effect")).kind
    except Misbehaved as error:
        text = str(error).removeprefix("PluginError: ").replace(str(path), plugin)
        raise PluginError(text if plugin in text else f"{plugin}: {text}") from error
    return estimators.declare(plugin) if kind == "estimator" else effects.add_file(plugin)
