"""One job: a scenario and seed is simulated once, and its record is shared by the estimators.

Estimators run in processes of their own (`fdbench.sandbox`); the truth stays in this one.
"""

import math
import pickle
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from fdbench.benchmark import oracle
from fdbench.benchmark.provenance import SIMULATION, digest
from fdbench.benchmark.store import (
    DIVERGED,
    FAILED,
    LARGEST,
    OK,
    SKIPPED,
    KeptRun,
    ParameterValue,
    RunKey,
    Score,
    Store,
)
from fdbench.benchmark.validate import check_estimate, check_response, plant_parameters
from fdbench.errors import FdbenchError, MissingData, PluginError, SimulationDiverged
from fdbench.estimator import Context
from fdbench.metrics import Outcome, metrics
from fdbench.metrics._parameters import signed_errors
from fdbench.nonce import derived_seed
from fdbench.record import FloatArray, Record
from fdbench.regression import Regression
from fdbench.sandbox import FitResult, Misbehaved, Sandbox, Source, Worker, WorkerLimits
from fdbench.scenario import Scenario, Truth, load_scenario

SPEED = "speed"

# The digest of each plug-in file of a simulation as it was loaded in this process.
_loaded: dict[str, str] = {}


class _Kept(threading.local):
    """The sandbox of each thread, which outlives a job, and what it was made for."""

    sandbox: Sandbox | None = None
    made_for: tuple[object, ...] = ()


_kept = _Kept()


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The name of a row, its estimator's arguments, the digest of estimator and arguments, and where the estimator is.

    The oracle is nowhere: it is no plug-in. Of a file, the path that it had where the run was begun is kept with it.
    """

    name: str
    arguments: Mapping[str, Any]
    digest: str
    source: Source | None = None
    file: str = ""


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
        Plug-in files of the simulation, with the number of their registry in ``SIMULATION``.
    is_apart : bool
        Whether they are to be registered first, as this is another process.
    limits : WorkerLimits
        Of each estimator.
    """

    source: str
    scenario: str
    seed: int
    choices: tuple[Choice, ...]
    keep: bool
    provenance: Mapping[str, str]
    folder: Path = Path()
    plugins: tuple[tuple[int, Path], ...] = ()
    is_apart: bool = False
    limits: WorkerLimits = field(default_factory=WorkerLimits)

    @property
    def runs(self) -> list[RunKey]:
        """Scenario, estimator and seed of each run."""
        return [RunKey(self.scenario, choice.name, self.seed) for choice in self.choices]


class _Skip(FdbenchError):
    """An estimator does not apply to a scenario."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trial:
    """A record with all that its estimators share."""

    scenario: Scenario
    context: Context
    record: Record
    truth: Truth
    regression: Regression
    command: Record | None

    @cached_property
    def pickled_context(self) -> bytes:
        """The context, as it is handed to every estimator."""
        return pickle.dumps(self.context)


def do(job: Job) -> list[KeptRun]:
    """Simulate, run the estimators one after another, and write each run as soon as it is finished."""
    if job.is_apart:
        for number, file in job.plugins:
            load_plugin(number, file)
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
        origin = {**job.provenance, "estimator_digest": choice.digest, "estimator_file": choice.file, "utc": utc}
        store.forget_estimate(key)
        if trial is None:
            result = _without_scores(key, scenario, status, message, origin)
        else:
            result = _attempt(key, choice, trial, origin, store if job.keep else None, job)
        store.write_run(result)
        runs.append(result)
    return runs


def _observe(scenario: Scenario, seed: int) -> _Trial:
    record, truth = scenario.observe(seed)
    context = scenario.context()
    regression, command = context.regression(record), scenario.command()
    return _Trial(
        scenario=scenario, context=context, record=record, truth=truth, regression=regression, command=command
    )


def _attempt(
    key: RunKey, choice: Choice, trial: _Trial, origin: Mapping[str, str], store: Store | None, job: Job
) -> KeptRun:
    try:
        fit, response = _estimate(choice, trial, job)
        outcome = Outcome(
            scenario=trial.scenario,
            record=trial.record,
            regression=trial.regression,
            truth=trial.truth,
            estimate=fit.estimate,
            seconds=fit.seconds,
            response=response,
        )
        parameters = tuple(_parameter_values(outcome))
    except (Exception, SystemExit) as error:  # noqa: BLE001
        calls = error.traceback if isinstance(error, Misbehaved) else ""
        return _without_scores(key, trial.scenario, *describe(error), origin, calls)
    if store is not None:
        store.write_estimate(key, trial.regression, fit.estimate)
    scores = tuple(_score(name, outcome) for name in metric_names(trial.scenario, key.estimator))
    failed = next((score for score in scores if score.status == FAILED), None)
    return KeptRun(
        **key._asdict(),
        plant=trial.scenario.plant.name,
        status=failed.status if failed else OK,
        message=f"{failed.metric}: {failed.message}" if failed else "",
        seconds=fit.seconds,
        peak_memory_MB=fit.peak_memory_MB,
        provenance=origin,
        scores=scores,
        parameters=parameters,
    )


def _estimate(choice: Choice, trial: _Trial, job: Job) -> tuple[FitResult, FloatArray | None]:
    """Return what a fit came to, and the response that it predicts."""
    if choice.source is None:
        start = time.perf_counter()
        estimate = oracle.oracle(trial.regression, trial.truth)
        seconds = time.perf_counter() - start
        return FitResult(estimate=estimate, seconds=seconds, peak_memory_MB=None), trial.truth.response
    own = sandbox(job.limits, job.plugins)
    worker = own.worker(choice.source)
    worker.load()
    reason = worker.begin(choice.arguments, trial.pickled_context)
    if reason is not None:
        raise _Skip(reason)
    if choice.digest not in worker.compiled:
        # The first fit compiles, which is no part of its time.
        worker.fit(trial.record)
        worker.compiled.add(choice.digest)
        worker.begin(choice.arguments, trial.pickled_context)
    fit = worker.fit(trial.record)
    with _located(worker, "fit"):
        check_estimate(fit.estimate, trial.regression, plant_parameters(trial.context))
    response = None if trial.command is None else worker.predict(trial.command)
    if response is not None and trial.truth.response is not None:
        with _located(worker, "predict"):
            check_response(response, trial.truth.response)
    return fit, response


@contextmanager
def _located(worker: Worker, method: str) -> Iterator[None]:
    """Say of a claim that cannot be used where the method begins that made it."""
    try:
        yield
    except PluginError as error:
        raise Misbehaved(worker.located(method, describe(error)[1])) from error


def sandbox(limits: WorkerLimits, plugins: tuple[tuple[int, Path], ...] = ()) -> Sandbox:
    """Return the sandbox of this thread, which is kept for further jobs with the same limits and plug-ins."""
    files = tuple((SIMULATION[number].kind, file) for number, file in plugins if SIMULATION[number].kind != "metric")
    made_for = (limits, files, digest(file.read_bytes() for _, file in files))
    if _kept.sandbox is None or _kept.made_for != made_for:
        if _kept.sandbox is not None:
            _kept.sandbox.close()
        _kept.sandbox, _kept.made_for = Sandbox(limits, files), made_for
    return _kept.sandbox


def load_plugin(number: int, file: Path) -> None:
    """Register a plug-in file in this process, unless it has been and is the same still."""
    content = digest([file.read_bytes()])
    if _loaded.get(str(file)) != content:
        SIMULATION[number].add_file(file)
        _loaded[str(file)] = content


def forget_plugins() -> None:
    """Let this process know no plug-in file of the simulation any more, for jobs of another run."""
    for registry in SIMULATION:
        registry.forget_files()
    _loaded.clear()


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
    if not abs(value) <= LARGEST:
        return Score(metric=name, unit=metric.unit, status=FAILED, message=f"the metric is {value}, beyond {LARGEST:g}")
    return Score(metric=name, unit=metric.unit, value=value)


def _without_scores(
    key: RunKey, scenario: Scenario, status: str, message: str, origin: Mapping[str, str], calls: str = ""
) -> KeptRun:
    """Return a run that has no estimate: every metric of the scenario gets a row with the reason."""
    scores = tuple(
        Score(metric=name, unit=metrics.get(name).unit, status=status, message=message)
        for name in metric_names(scenario, key.estimator)
    )
    return KeptRun(
        **key._asdict(),
        plant=scenario.plant.name,
        status=status,
        message=message,
        seconds=None,
        provenance=origin,
        scores=scores,
        traceback=calls,
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
    if isinstance(error, Misbehaved):
        return FAILED, text
    return FAILED, f"{type(error).__name__}: {text}" if text else type(error).__name__
