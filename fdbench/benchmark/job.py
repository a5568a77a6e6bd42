"""One job: a scenario and seed is simulated once, and its record is shared by the estimators."""

import inspect
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fdbench.benchmark import oracle
from fdbench.benchmark.provenance import SIMULATION, digest
from fdbench.benchmark.store import DIVERGED, FAILED, OK, SKIPPED, Key, ParameterValue, Run, Score, Store
from fdbench.benchmark.validate import check_estimate, plant_parameters
from fdbench.errors import FdbenchError, MissingData, PluginError, SimulationDiverged, did_you_mean
from fdbench.estimator import Context, Estimate, Estimator, estimators
from fdbench.metrics import Outcome, metrics
from fdbench.metrics._parameters import signed_errors
from fdbench.nonce import derived_seed
from fdbench.record import FloatArray, Record
from fdbench.regression import Regression
from fdbench.scenario import Scenario, Truth, load_scenario

SPEED = "speed"

REGISTRIES = (*SIMULATION, estimators)

# In this process: the digest of each plug-in file as it was loaded, and the estimators that have run. The first run
# of an estimator compiles, which is no part of its time.
_loaded: dict[str, str] = {}
_compiled: set[str] = set()


@dataclass(frozen=True, kw_only=True)
class Choice:
    """An estimator, the arguments that a scenario has for it, and the digest of both."""

    name: str
    arguments: Mapping[str, Any]
    digest: str


@dataclass(frozen=True, kw_only=True)
class Job:
    """What one process does at a time.

    Attributes
    ----------
    source, scenario : str
        Id or path of the scenario, and its id.
    seed : int
    choices : tuple of Choice
        Estimators that are run on the record.
    keep : bool
        Whether record and estimates are kept.
    provenance : mapping of str to str
    folder : Path
        Where the results go.
    plugins : tuple
        Plug-in files to be registered first, with the number of their registry in ``REGISTRIES``.
    """

    source: str
    scenario: str
    seed: int
    choices: tuple[Choice, ...]
    keep: bool
    provenance: Mapping[str, str]
    folder: Path = Path()
    plugins: tuple[tuple[int, Path], ...] = ()

    @property
    def runs(self) -> list[Key]:
        """Scenario, estimator and seed of each run."""
        return [Key(self.scenario, choice.name, self.seed) for choice in self.choices]


class _Skip(FdbenchError):
    """An estimator does not apply to a scenario."""


def construct(name: str, arguments: Mapping[str, Any]) -> Estimator:
    """Return an estimator.

    Raises
    ------
    PluginError
        If it has no such argument; the message names the nearest one.
    """
    cls = estimators.get(name)
    allowed = inspect.signature(cls).parameters
    for argument in arguments:
        if argument not in allowed:
            raise PluginError(f"{name} has no argument '{argument}'.{did_you_mean(argument, allowed)}")
    return cls(**arguments)


def not_made_for(estimator: type[Estimator], model: str) -> str | None:
    """Return that an estimator is for other models than this one, or None."""
    models = estimator.made_for
    return None if models is None or model in models else f"made for other models: {', '.join(models)}"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trial:
    """A record with all that its estimators share."""

    scenario: Scenario
    context: Context
    record: Record
    truth: Truth
    regression: Regression
    command: Record | None


def do(job: Job) -> list[Run]:
    """Simulate, run the estimators one after another, and write each run as soon as it is finished."""
    for number, file in job.plugins:
        _load(number, file)
    store, scenario = Store(job.folder), load_scenario(job.source)
    trial: _Trial | None = None
    try:
        trial = _observe(scenario, derived_seed(job.provenance.get("nonce", ""), scenario.id, job.seed))
        status, message = OK, ""
    except (Exception, SystemExit) as error:  # noqa: BLE001
        status, message = describe(error)
    if trial is not None and job.keep:
        store.write_record(scenario.id, job.seed, trial.record)
    runs = []
    for choice, key in zip(job.choices, job.runs, strict=True):
        utc = datetime.now(UTC).isoformat(timespec="milliseconds")
        origin = {**job.provenance, "estimator_digest": choice.digest, "utc": utc}
        store.forget_estimate(key)
        if trial is None:
            result = _without_scores(key, scenario, status, message, origin)
        else:
            result = _attempt(key, choice, trial, origin, store if job.keep else None)
        store.write_run(result)
        runs.append(result)
    return runs


def _observe(scenario: Scenario, seed: int) -> _Trial:
    record, truth = scenario.observe(seed)
    context = scenario.context()
    return _Trial(
        scenario=scenario,
        context=context,
        record=record,
        truth=truth,
        regression=context.regression(record),
        command=scenario.command(),
    )


def _attempt(key: Key, choice: Choice, trial: _Trial, origin: Mapping[str, str], store: Store | None) -> Run:
    try:
        estimate, response, seconds = _estimate(choice, trial)
        check_estimate(estimate, trial.regression, plant_parameters(trial.context))
        outcome = Outcome(
            scenario=trial.scenario,
            record=trial.record,
            regression=trial.regression,
            truth=trial.truth,
            estimate=estimate,
            seconds=seconds,
            response=response,
        )
        parameters = tuple(_parameter_values(outcome))
    except (Exception, SystemExit) as error:  # noqa: BLE001
        return _without_scores(key, trial.scenario, *describe(error), origin)
    if store is not None:
        store.write_estimate(key, trial.regression, estimate)
    scores = tuple(_score(name, outcome) for name in metric_names(trial.scenario, key.estimator))
    failed = next((score for score in scores if score.status == FAILED), None)
    return Run(
        **key._asdict(),
        plant=trial.scenario.plant.name,
        status=failed.status if failed else OK,
        message=f"{failed.metric}: {failed.message}" if failed else "",
        seconds=seconds,
        provenance=origin,
        scores=scores,
        parameters=parameters,
    )


def _estimate(choice: Choice, trial: _Trial) -> tuple[Estimate, FloatArray | None, float]:
    if choice.name == oracle.NAME:
        start = time.perf_counter()
        return oracle.oracle(trial.regression, trial.truth), trial.truth.response, time.perf_counter() - start
    estimator = construct(choice.name, choice.arguments)
    reason = not_made_for(type(estimator), trial.context.model) or estimator.skip(trial.context)
    if reason is not None and not isinstance(reason, str):
        raise PluginError(f"skip() returned {reason!r}; a reason as text, or None, is expected.")
    if reason is not None:
        raise _Skip(reason)
    if choice.digest not in _compiled:
        construct(choice.name, choice.arguments).fit(trial.context, _handed_over(trial.record))
        _compiled.add(choice.digest)
    record = _handed_over(trial.record)
    start = time.perf_counter()
    estimate = estimator.fit(trial.context, record)
    seconds = time.perf_counter() - start
    response = None if trial.command is None else estimator.predict(trial.context, estimate, trial.command)
    return estimate, response, seconds


def _handed_over(record: Record) -> Record:
    """Return a copy of its own for an estimator, without scenario and seed, of which the truth could be simulated."""
    return Record(record.columns)


def _load(number: int, file: Path) -> None:
    """Register a plug-in file in this process, unless it has been and is the same still."""
    content = digest([file.read_bytes()])
    if _loaded.get(str(file)) != content:
        REGISTRIES[number].add_file(file)
        _loaded[str(file)] = content


def _parameter_values(outcome: Outcome) -> list[ParameterValue]:
    return [
        ParameterValue(
            parameter=row.name,
            estimate=_finite(row.estimate),
            standard_error=_finite(row.standard_error),
            truth=_finite(row.truth),
        )
        for row in signed_errors(outcome)
    ]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def metric_names(scenario: Scenario, estimator: str) -> list[str]:
    """Return the metrics of the scenario's tracks and of speed, which the oracle has none of."""
    tracks = (*scenario.estimation.tracks, *(() if estimator == oracle.NAME else (SPEED,)))
    return [name for name in metrics.names() if metrics.get(name).track in tracks]


def _score(name: str, outcome: Outcome) -> Score:
    metric = metrics.get(name)()
    try:
        reason = metric.skip(outcome)
        if reason is not None:
            return Score(metric=name, unit=metric.unit, status=SKIPPED, message=reason)
        value = float(metric.score(outcome))
    except (Exception, SystemExit) as error:  # noqa: BLE001
        return Score(metric=name, unit=metric.unit, status=FAILED, message=describe(error)[1])
    if not math.isfinite(value):
        return Score(metric=name, unit=metric.unit, status=FAILED, message=f"the metric is {value}, not finite")
    return Score(metric=name, unit=metric.unit, value=value)


def _without_scores(key: Key, scenario: Scenario, status: str, message: str, origin: Mapping[str, str]) -> Run:
    """Return a run that has no estimate: every metric of the scenario gets a row with the reason."""
    scores = tuple(
        Score(metric=name, unit=metrics.get(name).unit, status=status, message=message)
        for name in metric_names(scenario, key.estimator)
    )
    return Run(
        **key._asdict(),
        plant=scenario.plant.name,
        status=status,
        message=message,
        seconds=None,
        provenance=origin,
        scores=scores,
    )


def describe(error: BaseException) -> tuple[str, str]:
    """Return status and reason, in one line, of a run that ended with an error.

    >>> describe(ValueError("not  this"))
    ('failed', 'ValueError: not this')
    """
    text = " ".join(str(error).split())
    if isinstance(error, _Skip | MissingData):
        return SKIPPED, text
    if isinstance(error, SimulationDiverged):
        return DIVERGED, text
    return FAILED, f"{type(error).__name__}: {text}" if text else type(error).__name__
