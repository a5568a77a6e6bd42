"""Whether stored results come out again: a sample of the runs is made anew, from the digests and the nonce alone."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from fdbench.benchmark import oracle
from fdbench.benchmark.provenance import code_digest, estimator_digest
from fdbench.benchmark.run import MEMORY_LIMIT_MB, TIME_LIMIT_S, run
from fdbench.benchmark.seal import Seal, read_seal
from fdbench.benchmark.selection import NULL, arguments_of, sources_of
from fdbench.benchmark.statistics import run_statuses
from fdbench.benchmark.store import OK, SKIPPED, KeptRun, RunKey, Store
from fdbench.benchmark.variant import arguments, registered
from fdbench.errors import FdbenchError, UnknownName, raise_all
from fdbench.estimator import estimators
from fdbench.metrics import metrics
from fdbench.sandbox import own_files
from fdbench.scenario import load_scenario

if TYPE_CHECKING:
    import pandas as pd

# Largest relative difference that the printed digits do not show.
SAME = 5e-4

RUN = "the run"


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A score, or the status of a metric or of ``RUN``, that came out otherwise; None where there is none now."""

    key: RunKey
    metric: str
    stored: float | str
    now: float | str | None


@dataclass(frozen=True, kw_only=True)
class Verification:
    """What repeating a sample has shown.

    Attributes
    ----------
    runs, scores : int
        How many were made again and compared.
    largest : float
        Largest relative difference of a score.
    differences : tuple of Difference
        Scores that differ by more than ``SAME``, and statuses that are others.
    changed : tuple of str
        What is another thing now than when the results were made: code, scenarios, estimators.
    """

    runs: int
    scores: int
    largest: float
    differences: tuple[Difference, ...]
    changed: tuple[str, ...]

    @property
    def is_same(self) -> bool:
        """Whether everything came out again."""
        return not self.differences and not self.changed


def verify(
    folder: str | Path,
    n_runs: int = 20,
    *,
    scenarios: Sequence[str | Path] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Verification:
    """Repeat a sample of the runs of a folder, which is drawn anew at each call.

    Runs that failed or diverged belong to it, and have to do so again, within the same limits; those that were skipped
    do not. An estimator that is neither installed nor registered is looked for where it was, by its digest.

    Parameters
    ----------
    folder : path
        Results.
    n_runs : int
    scenarios : sequence of path
        Files of scenarios that are not of fdbench.
    progress : callable, optional
        Told how many runs are done, and of how many.

    Raises
    ------
    UnknownName
        If the file of an estimator is not there any more, or has changed; the message says which to give.
    FdbenchError
        If the folder holds no results.
    """
    store = Store(folder)
    scores = store.scores()
    sources = {load_scenario(source).id: source for source in scenarios}
    statuses = run_statuses(scores)
    statuses = statuses[statuses["status"] != SKIPPED]
    raise_all(_missing_estimators(store, statuses, scores, sources), UnknownName)
    pairs = statuses[~statuses["estimator"].isin([NULL, oracle.NAME])] if len(statuses) > n_runs else statuses
    chosen = pairs.sample(min(n_runs, len(pairs)), random_state=np.random.default_rng())
    timeless = scores[scores["metric"].map(lambda name: metrics.get(name).track != "speed")]
    seal = read_seal(Path(folder))
    changed = {"the code"} if code_digest() not in set(scores["code_digest"]) else set()
    changed |= set() if seal is None else set(_sealed_otherwise(seal, scores))
    differences, largest, compared = list[Difference](), 0.0, 0
    with TemporaryDirectory() as place:
        for done, row in enumerate(chosen.itertuples(index=False)):
            if progress is not None:
                progress(done, len(chosen))
            key = RunKey(str(row.scenario), str(row.estimator), int(str(row.seed)))
            stored = timeless[(timeless[list(RunKey._fields)] == list(key)).all(axis="columns")]
            again = _again(key, stored.iloc[0], sources, Path(place))
            for name in ("scenario", "estimator"):
                if again.provenance[f"{name}_digest"] != stored[f"{name}_digest"].iloc[0]:
                    changed.add(f"{name} {getattr(key, name)}")
            compared += len(stored)
            if again.status != row.status:
                now = f"{again.status} ({again.message})" if again.message else again.status
                differences.append(Difference(key=key, metric=RUN, stored=str(row.status), now=now))
                continue
            own, furthest = _differences(key, stored, again)
            differences, largest = [*differences, *own], max(largest, furthest)
    return Verification(
        runs=len(chosen),
        scores=compared,
        largest=largest,
        differences=tuple(differences),
        changed=tuple(sorted(changed)),
    )


def _again(key: RunKey, stored: Any, sources: Mapping[str, str | Path], place: Path) -> KeptRun:
    """Make a run again, within the limits of one of its rows."""
    limits = {"time_limit_s": TIME_LIMIT_S, "memory_limit_MB": MEMORY_LIMIT_MB}
    for name in limits:
        try:
            limits[name] = float(stored[name] or limits[name])
        except ValueError as error:
            raise FdbenchError(f"scores: {name} is '{stored[name]}', expected a number.") from error
    source, nonce = sources.get(key.scenario, key.scenario), str(stored["nonce"])
    run([source], [key.estimator], 1, place, nonce=nonce, first_seed=key.seed, **limits)  # type: ignore[arg-type]
    again = Store(place).read_run(key)
    if again is None:
        raise FdbenchError(f"{key.scenario}, {key.estimator}, seed {key.seed}: no such run could be made.")
    return again


def _differences(key: RunKey, stored: "pd.DataFrame", again: KeptRun) -> tuple[list[Difference], float]:
    """Return where the metrics of a run differ from the stored ones, and the largest relative difference of a score."""
    found, largest = list[Difference](), 0.0
    scores = {score.metric: score for score in again.scores}
    for row in stored.itertuples(index=False):
        metric, status, now = str(row.metric), str(row.status), scores.get(str(row.metric))
        if now is None or now.value is None or status != OK:
            if now is None or now.status != status:
                found.append(Difference(key=key, metric=metric, stored=status, now=None if now is None else now.status))
            continue
        value = float(str(row.value))
        difference = abs(now.value - value) / max(abs(now.value), abs(value), 1e-12)
        largest = max(largest, difference if math.isfinite(difference) else math.inf)
        if not difference <= SAME:
            found.append(Difference(key=key, metric=metric, stored=value, now=now.value))
    return found, largest


def _missing_estimators(
    store: Store, statuses: "pd.DataFrame", scores: "pd.DataFrame", sources: Mapping[str, str | Path]
) -> Iterator[str]:
    """Register the estimators that came from files by these, and yield which file is wanting."""
    known = {oracle.NAME, *estimators.names()}
    for name, own in statuses.groupby(statuses["estimator"].map(registered)):
        if name in known:
            continue
        key = RunKey(*own[list(RunKey._fields)].iloc[0])
        kept = store.read_run(key)
        file = Path("" if kept is None else kept.provenance.get("estimator_file", ""))
        wanted = f"Give the file as it was then: --estimator {name}.py."
        if file.name != f"{name}.py":
            yield f"{name}: no estimator of this name is installed, and its runs do not tell its file. {wanted}"
        elif not file.is_file():
            yield f"{name}: its file is not at {file} any more. {wanted}"
        else:
            stored = scores[(scores[list(RunKey._fields)] == list(key)).all(axis="columns")]["estimator_digest"].iloc[0]
            given = arguments_of(key.estimator, load_scenario(sources.get(key.scenario, key.scenario)))
            if estimator_digest(own_files(file), given) != stored:
                yield f"{name}: {file}, or a file that it uses, has changed since these results were made. {wanted}"
            else:
                estimators.declare(str(file))


def _sealed_otherwise(seal: Seal, scores: "pd.DataFrame") -> Iterator[str]:
    """Yield what is another thing in a seal than in the rows, or than it is now."""
    scenarios = dict(zip(scores["scenario"], scores["scenario_digest"], strict=True))
    if (
        set(scores["nonce"]) != {seal.nonce}
        or set(scores["code_digest"]) != {seal.code_digest}
        or any(seal.scenarios.get(name) != digest for name, digest in scenarios.items())
        or not set(scores["estimator"]) <= {oracle.NAME, *seal.estimators}
    ):
        yield "the seal"
    here = [name for name in seal.estimators if registered(name) in estimators.names()]
    sources = sources_of(here)
    for name in here:
        if estimator_digest(sources[registered(name)], arguments(name)) != seal.estimators[name]:
            yield f"estimator {name}"
