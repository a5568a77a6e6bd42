"""Shared checks of scenarios: what every scenario file must hold before it is released."""

import dataclasses
import re
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from fdbench.checks._report import run_checks
from fdbench.errors import FdbenchError, PluginError, raise_all
from fdbench.estimator import checked_argument
from fdbench.record import Record
from fdbench.scenario import Scenario, Truth, load_scenario

CONVERGENCE = 0.02


@dataclasses.dataclass(frozen=True)
class CheckedScenario:
    """A scenario under checks, which share what it gives at seed 0."""

    scenario: Scenario

    @cached_property
    def observed(self) -> tuple[Record, Truth]:
        """Record and truth at seed 0."""
        return self.scenario.observe(0)


def has_version(s: CheckedScenario) -> None:
    """Expect an id that ends in -vN."""
    scenario = s.scenario
    if not re.fullmatch(r"[A-Z][A-Za-z0-9]*-v\d+", scenario.id):
        raise PluginError(f"id '{scenario.id}': CamelCase and a version are expected, such as ShakerConstant-v0.")


def names_its_source(s: CheckedScenario) -> None:
    """Title and source say something."""
    if not s.scenario.title.strip() or not s.scenario.source.strip():
        raise PluginError("title and source must say what the scenario is and where its values come from.")


def hyperparameters_exist(s: CheckedScenario) -> None:
    """Hyperparameters are arguments of estimators that exist, of the type of their defaults."""
    misses = []
    for name, arguments in s.scenario.estimation.hyperparameters.items():
        for argument, value in arguments.items():
            try:
                checked_argument(name, argument, value)
            except FdbenchError as error:
                misses.append(f"hyperparameters: {error}")
    raise_all(misses)


def repeats_under_a_seed(s: CheckedScenario) -> None:
    """Expect the same bits from the same seed."""
    first, second = s.observed[0], s.scenario.observe(0)[0]
    raise_all(
        f"column {column} differs between two runs with the same seed."
        for column in first
        if not np.array_equal(first[column], second[column])
    )


def is_integrated_well(s: CheckedScenario) -> None:
    """Half the substep changes no column by more than 2 % of its spread, noise being the same."""
    timing = s.scenario.timing
    if timing is None:
        return
    finer = dataclasses.replace(timing, substeps=2 * timing.substeps)
    coarse, fine = s.observed[0], dataclasses.replace(s.scenario, timing=finer).observe(0)[0]
    misses = []
    for column in coarse:
        change = float(np.sqrt(np.mean((coarse[column] - fine[column]) ** 2)))
        spread = float(np.std(fine[column]))
        if spread > 0.0 and change > CONVERGENCE * spread:
            share = change / spread
            misses.append(
                f"{column} changes by {share:.1%} of its spread when substeps are doubled; use more substeps."
            )
    raise_all(misses)


def excites_what_it_scores(s: CheckedScenario) -> None:
    """Expect parameters that can be identified, and a disturbance where one is scored."""
    scenario, (record, truth) = s.scenario, s.observed
    Z = scenario.context().regression(record).regressors
    misses = []
    if "parameters" in scenario.estimation.tracks:
        size = np.linalg.norm(Z, axis=0)
        if np.min(size) == 0.0 or np.linalg.cond(Z / size) > 1e8:
            misses.append("the motion does not excite all parameters of the model: their regressors are dependent.")
    if "disturbance" in scenario.estimation.tracks and (truth.disturbance_N is None or not truth.disturbance_N.any()):
        misses.append("the disturbance track is scored, but there is no disturbance.")
    raise_all(misses)


CHECKS = (
    has_version,
    names_its_source,
    hyperparameters_exist,
    repeats_under_a_seed,
    is_integrated_well,
    excites_what_it_scores,
)


def check_scenario(name_or_path: str | Path) -> list[str]:
    """Run all checks on a scenario and return a line for each.

    Raises
    ------
    PluginError
        If a check fails.
    FdbenchError
        If the file cannot be read, or measured data are absent.
    """
    checked = CheckedScenario(load_scenario(name_or_path))
    if checked.scenario.measured is not None:
        checked.observed  # noqa: B018 - measured data that are absent are told before any check
    return run_checks(checked.scenario.id, [(check.__name__, partial(check, checked)) for check in CHECKS])
