"""Shared checks of estimators: what every plug-in must hold, whoever wrote it."""

import dataclasses
import secrets
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from fdbench.benchmark.provenance import estimator_source
from fdbench.benchmark.validate import check_estimate, plant_parameters
from fdbench.catalogue import scenario_ids
from fdbench.checks._report import NotApplicable, run_checks
from fdbench.errors import FdbenchError, PluginError
from fdbench.estimator import Context, Estimate
from fdbench.record import Record
from fdbench.regression import Regression
from fdbench.sandbox import Declaration, Misbehaved, Sandbox, Source, Worker
from fdbench.sandbox.claims import ARRAYS
from fdbench.scenario import Scenario, load_scenario

SHORT_S = 8.0

# Of a covariance of unit variances, what rounding in double precision may leave of symmetry and below zero.
ROUNDING = 1e-8


@dataclass(frozen=True, eq=False)
class CheckedEstimator:
    """One estimator, held by a worker, on the first scenario to which it applies."""

    sandbox: Sandbox
    source: Source
    declaration: Declaration
    context: Context
    record: Record
    regression: Regression

    def begun(self) -> Worker:
        """Return the worker with a new instance."""
        worker = self.sandbox.worker(self.source)
        worker.load()
        worker.begin({}, self.context)
        return worker

    def fit(self) -> Estimate:
        """Run a new instance."""
        return self.begun().fit(self.record).estimate

    @cached_property
    def first(self) -> Estimate:
        """The first estimate."""
        return self.fit()


def simulated() -> Iterator[Scenario]:
    """Yield simulated scenarios, a usual one first."""
    for name in sorted(scenario_ids(), key=lambda item: (item != "ShakerConstant-v0", item)):
        scenario = load_scenario(name)
        if scenario.timing is not None:
            yield scenario


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


def prepare(name: str, sandbox: Sandbox) -> CheckedEstimator:
    """Return the case that the checks run on.

    Raises
    ------
    PluginError
        If the estimator cannot be made, or applies to no simulated scenario.
    """
    source = estimator_source(name)
    try:
        worker = sandbox.worker(source)
        declaration = worker.load()
        for scenario in simulated():
            context = scenario.context()
            if worker.begin({}, context) is None:
                record, _truth = shortened(scenario).observe(0)
                return CheckedEstimator(sandbox, source, declaration, context, record, context.regression(record))
    except Misbehaved as error:
        raise PluginError(f"{name}: {str(error).removeprefix('PluginError: ')}") from error
    raise PluginError(f"{name}: it declines every simulated scenario; nothing can be checked.")


def equal(a: Estimate, b: Estimate, tolerance: float = 0.0) -> bool:
    """Return whether two estimates agree in every part, to a relative tolerance of each part's largest value."""
    if dict(a.parameters).keys() != dict(b.parameters).keys():
        return False
    pairs: list[tuple[Any, Any]] = [(a.parameters[name], b.parameters[name]) for name in a.parameters]
    pairs += [(getattr(a, name), getattr(b, name)) for name in ARRAYS]
    for x, y in pairs:
        if (x is None) != (y is None):
            return False
        if x is None:
            continue
        x, y = np.asarray(x), np.asarray(y)
        if x.shape != y.shape:
            return False
        # What is not finite is another check's finding.
        differ = (x != y) & ~(np.isnan(x) & np.isnan(y))
        if np.any(differ) and not np.all(np.abs(x - y)[differ] <= tolerance * np.max(np.abs(y))):
            return False
    return True


def has_defaults(case: CheckedEstimator) -> None:
    """Construct it without arguments."""
    case.begun()


def has_docstring(case: CheckedEstimator) -> None:
    """Class with a docstring of its own."""
    if not case.declaration.has_docstring:
        raise PluginError("the class has no docstring; say in it what is estimated, by which equation, and the source.")


def has_right_examples(case: CheckedEstimator) -> None:
    """Expect right examples in the docstring: at least one of an installed estimator, any number in a file."""
    if case.source.file is None and not case.declaration.has_example:
        raise PluginError("the docstring has no worked example ('>>> '); show one whose result is known.")
    wrong = case.begun().wrong_examples()
    if wrong:
        raise PluginError(f"an example in the docstring is wrong: {wrong}")


def returns_estimate(case: CheckedEstimator) -> None:
    """Expect an Estimate with finite numbers and one value for each row."""
    check_estimate(case.first, case.regression, plant_parameters(case.context))


def has_a_possible_covariance(case: CheckedEstimator) -> None:
    """Expect a covariance that is symmetric and positive semidefinite."""
    if case.first.covariance is None:
        return
    covariance, names = np.asarray(case.first.covariance), list(case.first.parameters)
    if covariance.size and covariance.shape != (len(names), len(names)):
        raise NotApplicable("it has another shape than the parameters")
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scaled = covariance / np.outer(*2 * [np.where(deviations > 0.0, deviations, 1.0)])
    asymmetry = np.abs(scaled - scaled.T)
    if asymmetry.size and asymmetry.max() > ROUNDING:
        i, j = np.unravel_index(int(asymmetry.argmax()), asymmetry.shape)
        raise PluginError(
            f"covariance is not symmetric: {covariance[i, j]:g} of {names[i]} and {names[j]}, {covariance[j, i]:g} of "
            f"{names[j]} and {names[i]}."
        )
    lowest = float(np.linalg.eigvalsh(scaled)[0]) if scaled.size else 0.0
    if lowest < -ROUNDING * len(names):
        raise PluginError(
            f"covariance is not positive semidefinite: scaled to unit variances it has the eigenvalue {lowest:.3g}, so "
            "that a sum of parameters would have a negative variance."
        )


def is_deterministic(case: CheckedEstimator) -> None:
    """Expect the same bits from the same record."""
    if not (equal(case.first, case.fit()) and equal(case.first, case.fit())):
        raise PluginError("two runs on the same record differ; draw random numbers from a generator with a fixed seed.")


def fits_again(case: CheckedEstimator) -> None:
    """One instance fitted twice gives the same bits: nothing of the first record is left."""
    worker = case.begun()
    first = worker.fit(case.record).estimate
    if not equal(first, worker.fit(case.record).estimate):
        raise PluginError("the second fit of the same instance differs from the first: state is left over.")


def leaves_global_random_state(case: CheckedEstimator) -> None:
    """Numpy's global generator is neither seeded nor drawn from."""
    worker = case.begun()
    before = worker.random_state(secrets.randbits(32))
    worker.fit(case.record)
    if worker.random_state() != before:
        raise PluginError(
            "fit seeds NumPy's global generator or draws from it; use numpy.random.default_rng(seed) instead."
        )


def can_be_pickled(case: CheckedEstimator) -> None:
    """Instances travel to other processes."""
    worker = case.begun()
    try:
        worker.copy()
    except Misbehaved as error:
        raise PluginError(f"an instance cannot be pickled: {error}.") from error
    if not equal(worker.fit(case.record).estimate, case.first):
        raise PluginError("a pickled copy estimates something else than the original.")


def streams_as_it_fits(case: CheckedEstimator) -> None:
    """Expect the same from ``update`` as from ``fit``."""
    if not case.declaration.is_online:
        return
    if not equal(case.begun().fit(case.record, is_streamed=True).estimate, case.first, 1e-9):
        raise PluginError("start, update and estimate over a record give something else than fit.")


def refuses_update_before_start(case: CheckedEstimator) -> None:
    """Expect a refusal where ``update`` comes before ``start``."""
    if not case.declaration.is_online:
        return
    try:
        is_refused = case.begun().refuses_update(case.record)
    except Misbehaved as error:
        raise PluginError(f"update() before start(): {error}; raise a PluginError that says so.") from error
    if not is_refused:
        raise PluginError("update() before start() was accepted.")


CHECKS: tuple[Callable[[CheckedEstimator], None], ...] = (
    has_defaults,
    returns_estimate,
    has_a_possible_covariance,
    is_deterministic,
    fits_again,
    leaves_global_random_state,
    can_be_pickled,
    streams_as_it_fits,
    refuses_update_before_start,
    has_right_examples,
    has_docstring,
)


def check_estimator(name: str, sandbox: Sandbox) -> list[str]:
    """Run the checks on a registered estimator, up to one in which it crashes, and return a line for each.

    It is imported, made and fitted in a worker alone, so that one that crashes, hangs or exits does not take the checks
    with it.

    Parameters
    ----------
    name : str
    sandbox : Sandbox
        Whose worker it gets.

    Raises
    ------
    PluginError
        If a check fails that the plug-in does not list in ``expected_failures``, or passes although it does.
    """
    case = prepare(name, sandbox)
    checks = [(check.__name__, partial(check, case)) for check in CHECKS]
    return run_checks(name, checks, case.declaration.expected_failures)
