"""Shared checks of metrics: what every score must hold, on the first scenario to which it applies."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from fdbench.benchmark.oracle import oracle
from fdbench.checks._data_sheet import check_data_sheet
from fdbench.checks._report import NotApplicable, run_checks
from fdbench.checks.check_estimator import shortened, simulated
from fdbench.errors import PluginError, raise_all
from fdbench.metrics import Metric, Outcome
from fdbench.scenario import load_scenario
from fdbench.units import UNITS

TRACKS = ("parameters", "disturbance", "output", "speed")


@dataclass(frozen=True, eq=False)
class CheckedMetric:
    """A metric, and an outcome of the truth to which it applies; None without one."""

    cls: type[Metric]
    outcome: Outcome | None

    def score(self, outcome: Outcome | None = None) -> float:
        """Return the score of the truth, or of another outcome."""
        if self.outcome is None:
            raise NotApplicable("it skips what is known of the truth in every simulated scenario")
        return self.cls().score(outcome or self.outcome)


@lru_cache
def outcome_of(scenario_id: str) -> Outcome:
    """Return the truth of a scenario as an estimate, with variances that are made up."""
    scenario = shortened(load_scenario(scenario_id))
    record, truth = scenario.observe(0)
    regression = scenario.context().regression(record)
    estimate = oracle(regression, truth)
    n_rows = len(regression.target)
    claimed = dataclasses.replace(
        estimate,
        covariance=1e-6 * np.eye(len(regression.names)),
        disturbance_variance_N2=None if estimate.disturbance_N is None else np.full(n_rows, 1e-4),
        output_variance=None if estimate.output is None else np.full(n_rows, 1e-4),
    )
    return Outcome(
        scenario=scenario,
        record=record,
        regression=regression,
        truth=truth,
        estimate=claimed,
        seconds=0.1,
        response=truth.response,
    )


def prepare(cls: type[Metric]) -> CheckedMetric:
    """Return the case that the checks run on."""
    for scenario in simulated():
        outcome = outcome_of(scenario.id)
        if cls().skip(outcome) is None:
            return CheckedMetric(cls, outcome)
    return CheckedMetric(cls, None)


def says_what_it_is(case: CheckedMetric) -> None:
    """Require a unit, a track, and different values of a perfect estimate and of a failure."""
    cls = case.cls
    misses = []
    if cls.unit not in {"", *UNITS.values(), "%", "us", "mm"}:
        misses.append(f"unit '{cls.unit}' is none of fdbench/units.py.")
    if cls.track not in TRACKS:
        misses.append(f"track '{cls.track}' is none of {', '.join(TRACKS)}.")
    if not (math.isfinite(cls.worst) and math.isfinite(cls.ideal) and cls.worst != cls.ideal):
        misses.append(f"worst {cls.worst:g} and ideal {cls.ideal:g} must be finite and differ.")
    elif (cls.worst < cls.ideal) != cls.bigger_is_better:
        misses.append(f"worst {cls.worst:g} is better than ideal {cls.ideal:g}.")
    raise_all(misses)


def is_documented(case: CheckedMetric) -> None:
    """Require equation, worst value and a worked example, which is right, in the docstring."""
    check_data_sheet(case.cls, (".. math::", "``worst``", ">>> "))


def gives_a_number(case: CheckedMetric) -> None:
    """Require a finite score of the truth, the same twice and no worse than a failure."""
    found, again = case.score(), case.score()
    if not math.isfinite(found) or found != again:
        raise PluginError(f"the truth scores {found} and then {again}.")
    if found != case.cls.worst and (found < case.cls.worst) == case.cls.bigger_is_better:
        raise PluginError(f"the truth scores {found:g}, worse than a failure ({case.cls.worst:g}).")


def leaves_what_it_is_given(case: CheckedMetric) -> None:
    """Require record and estimate to be as they were."""
    case.score()
    if case.outcome is None:
        return
    estimate = case.outcome.estimate
    before = {name: np.array(values) for name, values in case.outcome.record.items()}
    own = None if estimate.output is None else estimate.output.copy()
    case.score()
    if any(not np.array_equal(case.outcome.record[name], values) for name, values in before.items()):
        raise PluginError("it changes the record.")
    if own is not None and estimate.output is not None and not np.array_equal(own, estimate.output):
        raise PluginError("it changes the estimate.")


def ranks_nothing_below_the_truth(case: CheckedMetric) -> None:
    """Require that an estimate of zeros scores no better than the truth."""
    truth = case.score()
    if case.outcome is None or case.cls.track == "speed":
        raise NotApplicable("an estimate of zeros is as fast")
    true = case.outcome.estimate
    zeros = dataclasses.replace(
        true,
        parameters=dict.fromkeys(true.parameters, 0.0),
        disturbance_N=None if true.disturbance_N is None else 0.0 * true.disturbance_N,
        output=None if true.output is None else 0.0 * true.output,
    )
    response = None if case.outcome.response is None else 0.0 * case.outcome.response
    found = case.score(dataclasses.replace(case.outcome, estimate=zeros, response=response))
    if found != truth and (found > truth) == case.cls.bigger_is_better:
        raise PluginError(f"zeros score {found:g}, better than the truth ({truth:g}).")


CHECKS: tuple[Callable[[CheckedMetric], None], ...] = (
    says_what_it_is,
    is_documented,
    gives_a_number,
    leaves_what_it_is_given,
    ranks_nothing_below_the_truth,
)


def check_metric(cls: type[Metric]) -> list[str]:
    """Run all checks on a metric and return a line for each.

    Raises
    ------
    PluginError
        If a check fails.
    """
    case = prepare(cls)
    return run_checks(cls.name, [(check.__name__, partial(check, case)) for check in CHECKS])
