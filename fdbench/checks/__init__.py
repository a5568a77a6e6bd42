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
    from fdbench.catalogue import scenario_ids
    from fdbench.effects import effects
    from fdbench.errors import UnknownName, did_you_mean
    from fdbench.estimator import estimators
    from fdbench.sandbox import Sandbox, WorkerLimits

    if plugin.endswith(".toml") or plugin.removeprefix("fdbench/") in scenario_ids():
        from fdbench.checks.check_scenario import check_scenario

        return check_scenario(plugin)
    with closing(Sandbox(limits or WorkerLimits())) as sandbox:
        name = _declared(plugin, sandbox) if plugin.endswith(".py") else plugin
        if name in estimators.names():
            from fdbench.checks.check_estimator import check_estimator

            return check_estimator(name, sandbox)
    if name in effects.names():
        from fdbench.checks.check_effect import check_effect

        return check_effect(effects.get(name))
    names = [*estimators.names(), *effects.names(), *scenario_ids()]
    raise UnknownName(f"unknown plug-in '{plugin}'.{did_you_mean(plugin, names)}")


def _declared(file: str, sandbox: "Sandbox") -> str:
    """Return the name of a plug-in in a file, which a worker imports; only an effect is imported here after that."""
    from fdbench.effects import effects
    from fdbench.errors import PluginError
    from fdbench.estimator import estimators
    from fdbench.registry import owner
    from fdbench.sandbox import Misbehaved, Source

    path = Path(file).resolve()
    if owner(Path(file), (estimators, effects)) is not None:
        return path.stem
    try:
        worker = sandbox.worker(Source(name=path.stem, own=(path,), digest="", file=path))
        kind = worker.load(("estimator", "effect")).kind
    except Misbehaved as error:
        text = str(error).removeprefix("PluginError: ").replace(str(path), file)
        raise PluginError(text if file in text else f"{file}: {text}") from error
    return estimators.declare(file) if kind == "estimator" else effects.add_file(file)
