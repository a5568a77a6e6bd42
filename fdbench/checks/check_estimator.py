"""Shared checks of estimators: what every plug-in must hold, whoever wrote it."""

import dataclasses
import pickle
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from fdbench.benchmark.provenance import estimator_source
from fdbench.benchmark.validate import check_estimate, plant_parameters
from fdbench.catalogue import scenario_ids
from fdbench.checks._report import run_checks
from fdbench.errors import FdbenchError, PluginError
from fdbench.estimator import Context, Estimate, Estimator, OnlineEstimator, Sample, estimators, samples
from fdbench.record import Record
from fdbench.regression import Regression
from fdbench.sandbox import Limits, Misbehaved, Sandbox
from fdbench.scenario import Scenario, load_scenario

SHORT_S = 8.0
ARRAYS = ("disturbance_N", "disturbance_variance_N2", "output", "output_variance")


@dataclass(frozen=True, eq=False)
class Case:
    """One estimator on the first scenario to which it applies."""

    cls: type[Estimator]
    context: Context
    record: Record
    regression: Regression

    def fit(self) -> Estimate:
        """Run a new instance."""
        return self.cls().fit(self.context, self.record)


def simulated() -> Iterator[Scenario]:
    """Yield simulated scenarios, a usual one first."""
    for name in sorted(scenario_ids(), key=lambda item: (item != "ShakerConstant-v0", item)):
        scenario = load_scenario(name)
        if scenario.timing is not None:
            yield scenario


def cases(cls: type[Estimator]) -> Iterator[tuple[Scenario, Context]]:
    """Yield simulated scenarios to which the estimator applies."""
    for scenario in simulated():
        context = scenario.context()
        if cls().skip(context) is None:
            yield scenario, context


def shortened(scenario: Scenario) -> Scenario:
    """Return the scenario with at most `SHORT_S` seconds, if that is a shorter one that runs."""
    if scenario.timing is None or scenario.timing.duration_s <= SHORT_S:
        return scenario
    short = dataclasses.replace(scenario, timing=dataclasses.replace(scenario.timing, duration_s=SHORT_S))
    try:
        short.observe(0)
    except FdbenchError:
        return scenario
    return short


def prepare(cls: type[Estimator]) -> Case:
    """Return the case that the checks run on.

    Raises
    ------
    PluginError
        If the estimator applies to no simulated scenario.
    """
    for scenario, context in cases(cls):
        record, _truth = shortened(scenario).observe(0)
        return Case(cls, context, record, context.regression(record))
    raise PluginError(f"{cls.name}: skip() declines every simulated scenario; nothing can be checked.")


def equal(a: Estimate, b: Estimate, tolerance: float = 0.0) -> bool:
    """Return whether two estimates agree in every part, to a relative tolerance of each part's largest value."""
    if dict(a.parameters).keys() != dict(b.parameters).keys():
        return False
    pairs: list[tuple[Any, Any]] = [(a.parameters[name], b.parameters[name]) for name in a.parameters]
    pairs += [(getattr(a, name), getattr(b, name)) for name in (*ARRAYS, "covariance")]
    for x, y in pairs:
        if (x is None) != (y is None):
            return False
        if x is None:
            continue
        x, y = np.asarray(x), np.asarray(y)
        if x.shape != y.shape or not np.all(np.abs(x - y) <= tolerance * (np.max(np.abs(y)) if y.size else 0.0)):
            return False
    return True


def has_defaults(case: Case) -> None:
    """Construct it without arguments."""
    case.cls()


def has_docstring(case: Case) -> None:
    """Class with a docstring of its own."""
    if not (case.cls.__doc__ or "").strip() or case.cls.__doc__ == case.cls.__base__.__doc__:
        raise PluginError("the class has no docstring; say in it what is estimated, by which equation, and the source.")


def returns_estimate(case: Case) -> None:
    """Expect an Estimate with finite numbers and one value for each row."""
    check_estimate(case.fit(), case.regression, plant_parameters(case.context))


def is_deterministic(case: Case) -> None:
    """Expect the same bits from the same record."""
    if not equal(case.fit(), case.fit()):
        raise PluginError("two runs on the same record differ; draw random numbers from a generator with a fixed seed.")


def fits_again(case: Case) -> None:
    """One instance fitted twice gives the same bits: nothing of the first record is left."""
    estimator = case.cls()
    first = estimator.fit(case.context, case.record)
    if not equal(first, estimator.fit(case.context, case.record)):
        raise PluginError("the second fit of the same instance differs from the first: state is left over.")


def leaves_global_random_state(case: Case) -> None:
    """Numpy's global random state is as before."""
    before = pickle.dumps(np.random.get_state())  # noqa: NPY002
    case.fit()
    if pickle.dumps(np.random.get_state()) != before:  # noqa: NPY002
        raise PluginError("numpy's global random state was used; use numpy.random.default_rng(seed).")


def can_be_pickled(case: Case) -> None:
    """Instances travel to other processes."""
    try:
        copy = pickle.loads(pickle.dumps(case.cls()))
    except Exception as error:
        raise PluginError(f"an instance cannot be pickled: {error!r}.") from error
    if not equal(copy.fit(case.context, case.record), case.fit()):
        raise PluginError("a pickled copy estimates something else than the original.")


def streams_as_it_fits(case: Case) -> None:
    """Expect the same from ``update`` as from ``fit``."""
    if not issubclass(case.cls, OnlineEstimator):
        return
    estimator = case.cls()
    estimator.start(case.context)
    for sample in samples(case.regression):
        estimator.update(sample)
    if not equal(estimator.estimate(), case.fit(), 1e-9):
        raise PluginError("start, update and estimate over a record give something else than fit.")


def refuses_update_before_start(case: Case) -> None:
    """Expect a refusal where ``update`` comes before ``start``."""
    if not issubclass(case.cls, OnlineEstimator):
        return
    regression = case.regression
    sample: Sample = samples(regression)[0]
    try:
        case.cls().update(sample)
    except FdbenchError:
        return
    except Exception as error:
        raise PluginError(f"update() before start() raised {error!r}; raise a PluginError that says so.") from error
    raise PluginError("update() before start() was accepted.")


CHECKS: tuple[Callable[[Case], None], ...] = (
    has_defaults,
    returns_estimate,
    is_deterministic,
    fits_again,
    leaves_global_random_state,
    can_be_pickled,
    streams_as_it_fits,
    refuses_update_before_start,
    has_docstring,
)


def try_first(name: str) -> None:
    """Fit once in a process of its own, so that one that crashes, hangs or exits does not take the checks with it.

    Raises
    ------
    PluginError
        If it does, or fails.
    """
    source, place = estimator_source(name), ""
    with closing(Sandbox(Limits())) as sandbox:
        try:
            worker = sandbox.worker(source)
            worker.load(source)
            for scenario in simulated():
                if worker.begin(name, {}, scenario.context()) is None:
                    place = f"{returns_estimate.__name__}: "
                    worker.fit(shortened(scenario).observe(0)[0])
                    return
        except Misbehaved as error:
            raise PluginError(f"{name}: {place}{str(error).removeprefix('PluginError: ')}") from error


def check_estimator(name: str) -> list[str]:
    """Run the checks on a registered estimator, up to the first that fails, and return a line for each.

    Raises
    ------
    PluginError
        If a check fails that the plug-in does not list in ``expected_failures``, or passes although it does.
    """
    try_first(name)
    cls = estimators.get(name)
    case = prepare(cls)
    return run_checks(name, [(check.__name__, partial(check, case)) for check in CHECKS], cls, first_only=True)
