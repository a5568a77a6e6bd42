"""Shared checks of plug-ins, for the project's own tests and for everybody else's."""

import ast
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fdbench.files import parsed
from fdbench.registry import Registry

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
    from fdbench.errors import UnknownName, did_you_mean

    if plugin.endswith(".toml") or plugin.removeprefix("fdbench/") in scenario_ids():
        from fdbench.checks.check_scenario import check_scenario

        return check_scenario(plugin)
    every = kinds(sandbox)
    for registry, run in every:
        if plugin in registry.names():
            return run(plugin)
    names = [*(name for registry, _ in every for name in registry.names()), *scenario_ids()]
    raise UnknownName(f"unknown plug-in '{plugin}'.{did_you_mean(plugin, names)}")


def kinds(sandbox: "Sandbox") -> list[tuple[Registry[Any], Callable[[str], list[str]]]]:
    """Return the registry of each kind of plug-in and the function that checks one by its name.

    A name of several kinds is that of the first.
    """
    from fdbench.checks.check_diagnoser import check_diagnoser
    from fdbench.checks.check_effect import check_effect
    from fdbench.checks.check_estimator import check_estimator
    from fdbench.checks.check_metric import check_metric
    from fdbench.checks.check_motion import check_motion
    from fdbench.checks.check_plant import check_plant
    from fdbench.checks.check_task import check_task
    from fdbench.effects import effects
    from fdbench.envs.tasks import tasks
    from fdbench.estimator import estimators
    from fdbench.metrics import metrics
    from fdbench.motions import motions
    from fdbench.plants import plants
    from fdbench.trials.diagnoser import diagnosers

    return [
        (estimators, lambda name: check_estimator(name, sandbox)),
        (effects, lambda name: check_effect(effects.get(name))),
        (metrics, lambda name: check_metric(metrics.get(name))),
        (plants, lambda name: check_plant(plants.get(name))),
        (motions, lambda name: check_motion(motions.get(name))),
        (tasks, lambda name: check_task(tasks.get(name))),
        (diagnosers, lambda name: check_diagnoser(diagnosers.get(name))),
    ]


def declare(plugin: str, sandbox: "Sandbox") -> str:
    """Return the name of a plug-in in a Python file, which a worker imports; anything else as it is.

    A file whose class derives from another base than those of estimators and effects is imported here: no worker has
    what it needs.

    Raises
    ------
    PluginError
        If the file cannot be imported or holds no plug-in.
    """
    from fdbench.effects import effects
    from fdbench.errors import PluginError
    from fdbench.estimator import estimators
    from fdbench.registry import lasting, owner
    from fdbench.sandbox import Misbehaved, Source, own_files

    if not plugin.endswith(".py"):
        return plugin
    path = lasting(Path(plugin))
    every = [registry for registry, _ in kinds(sandbox)]
    if owner(Path(plugin), every) is not None:
        return path.stem
    bases = _bases(path)
    for registry in every:
        if registry not in (estimators, effects) and registry.base.__name__ in bases:
            return registry.add_file(plugin)
    try:
        worker = sandbox.worker(Source(name=path.stem, own=own_files(path), digest="", file=path))
        kind = worker.load(("estimator", "effect")).kind
    except Misbehaved as error:
        raise PluginError(f"{plugin}{str(error).removeprefix(path.name)}") from error
    return estimators.declare(plugin) if kind == "estimator" else effects.add_file(plugin)


def _bases(file: Path) -> set[str]:
    """Return the names of the classes that those of a file derive from; of one that is not Python, none."""
    classes = [node for node in ast.walk(parsed(file)) if isinstance(node, ast.ClassDef)]
    return {base.id for each in classes for base in each.bases if isinstance(base, ast.Name)}
