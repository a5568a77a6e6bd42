"""Shared checks of plants: what every nominal system must hold, on the first scenario that has it."""

import dataclasses
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from fdbench.catalogue import scenario_ids
from fdbench.checks._report import NotApplicable, run_checks
from fdbench.checks.check_estimator import shortened
from fdbench.errors import FdbenchError, PluginError, raise_all
from fdbench.plants import Plant
from fdbench.record import Record
from fdbench.scenario import Scenario, load_scenario


@dataclass(frozen=True, eq=False)
class CheckedPlant:
    """A plant as a scenario has it."""

    cls: type[Plant]
    scenario: Scenario | None

    @cached_property
    def record(self) -> Record:
        """A record of it."""
        return self.known().observe(0)[0]

    def known(self) -> Scenario:
        """Return the scenario."""
        if self.scenario is None:
            raise NotApplicable("no simulated scenario has it")
        return self.scenario


def prepare(cls: type[Plant]) -> CheckedPlant:
    """Return the case that the checks run on."""
    for name in scenario_ids():
        scenario = load_scenario(name)
        if scenario.timing is not None and type(scenario.plant) is cls:
            return CheckedPlant(cls, shortened(scenario))
    return CheckedPlant(cls, None)


def is_frozen_and_documented(case: CheckedPlant) -> None:
    """Require a final frozen dataclass with a docstring."""
    frozen = dataclasses.is_dataclass(case.cls) and case.cls.__dataclass_params__.frozen
    if not (frozen and getattr(case.cls, "__final__", False) and case.cls.__doc__):
        raise PluginError("the class must be @final, a @dataclass(frozen=True, kw_only=True), and have a docstring.")


def offers_the_models_it_names(case: CheckedPlant) -> None:
    """Require the scenario's model, finite on a record, and a refusal of a name that is none."""
    scenario = case.known()
    plant, model = scenario.plant, scenario.estimation.model
    if model not in plant.models():
        raise PluginError(f"the scenario asks for the model {model}, offered are {', '.join(plant.models())}.")
    found = plant.linear_model(model).regression(case.record)
    misses = []
    if not (np.isfinite(found.regressors).all() and np.isfinite(found.target).all()):
        misses.append(f"the regression {model} is not finite on its own record.")
    if found.regressors.shape != (len(found.target), len(found.names)):
        misses.append(f"the regression {model} has {found.regressors.shape} regressors for its names and target.")
    with suppress(FdbenchError):
        plant.linear_model("no_such_model")
        misses.append("a model that is none is accepted.")
    raise_all(misses)


def knows_its_parameters(case: CheckedPlant) -> None:
    """Require finite parameters from the nominal values."""
    scenario = case.known()
    period_s = scenario.setup.timing.sampling_time_s
    model = scenario.plant.linear_model(scenario.estimation.model)
    found: Mapping[str, float] = model.nominal_parameters(period_s)
    if not all(np.isfinite(value) for value in found.values()):
        raise PluginError(f"nominal parameters are not finite: {dict(found)}.")
    if found:
        model.physical_parameters(found, period_s)


def is_the_same_again(case: CheckedPlant) -> None:
    """Require the same record from the same seed, bit for bit."""
    again = case.known().observe(0)[0]
    if any(not np.array_equal(case.record[name], again[name], equal_nan=True) for name in case.record):
        raise PluginError("the same seed gives another record.")


CHECKS: tuple[Callable[[CheckedPlant], None], ...] = (
    is_frozen_and_documented,
    offers_the_models_it_names,
    knows_its_parameters,
    is_the_same_again,
)


def check_plant(cls: type[Plant]) -> list[str]:
    """Run all checks on a plant and return a line for each.

    Raises
    ------
    PluginError
        If a check fails.
    """
    case = prepare(cls)
    return run_checks(cls.name, [(check.__name__, partial(check, case)) for check in CHECKS])
