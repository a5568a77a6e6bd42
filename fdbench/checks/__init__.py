"""Shared checks of plug-ins, for the project's own tests and for everybody else's."""

from pathlib import Path


def check(plugin: str) -> list[str]:
    """Run the checks that fit a plug-in: a name, a Python file of an estimator or effect, or a scenario.

    Raises
    ------
    FdbenchError
        If there is no such plug-in, or a check fails.
    """
    from fdbench.catalogue import scenario_ids
    from fdbench.effects import effects
    from fdbench.errors import PluginError, UnknownName, did_you_mean
    from fdbench.estimator import estimators

    if plugin.endswith(".toml") or plugin.removeprefix("fdbench/") in scenario_ids():
        from fdbench.checks.check_scenario import check_scenario

        return check_scenario(plugin)
    if plugin.endswith(".py"):
        try:
            name = estimators.add_file(plugin)
        except PluginError as first:
            if not Path(plugin).is_file() or "exactly one" not in str(first):
                raise
            name = effects.add_file(plugin)
    else:
        name = plugin
    if name in estimators.names():
        from fdbench.checks.check_estimator import check_estimator

        return check_estimator(name)
    if name in effects.names():
        from fdbench.checks.check_effect import check_effect

        return check_effect(effects.get(name))
    names = [*estimators.names(), *effects.names(), *scenario_ids()]
    raise UnknownName(f"unknown plug-in '{plugin}'.{did_you_mean(plugin, names)}")
