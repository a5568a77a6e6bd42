"""Whether stored results come out again: a sample of the runs is made anew, from the digests and the nonce alone."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from fdbench.benchmark.provenance import code_digest
from fdbench.benchmark.run import run
from fdbench.benchmark.seal import read_seal
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.store import OK, RunKey, Store
from fdbench.errors import FdbenchError
from fdbench.metrics import metrics
from fdbench.scenario import load_scenario

if TYPE_CHECKING:
    import pandas as pd

# Largest relative difference that the printed digits do not show.
SAME = 5e-4


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A score that came out otherwise."""

    key: RunKey
    metric: str
    stored: float | None
    now: float | None


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
        Scores that differ by more than ``SAME``.
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
    FdbenchError
        If the folder holds no results, or an estimator is not installed: files given by path have to be registered.
    """
    scores = Store(folder).scores()
    good = scores[(scores["status"] == OK) & (scores["metric"].map(lambda name: metrics.get(name).track != "speed"))]
    pairs = good[["scenario", "estimator", "seed"]].drop_duplicates()
    pairs = pairs[~pairs["estimator"].isin([NULL, "oracle"])] if len(pairs) > n_runs else pairs
    chosen = pairs.sample(min(n_runs, len(pairs)), random_state=np.random.default_rng())
    sources = {load_scenario(source).id: source for source in scenarios}
    nonce = str(scores["nonce"].iloc[0])
    changed = {"the code"} if code_digest() not in set(scores["code_digest"]) else set()
    changed |= {"the seal"} if _is_sealed_otherwise(Path(folder), scores) else set()
    differences, largest, compared = list[Difference](), 0.0, 0
    with TemporaryDirectory() as place:
        for done, row in enumerate(chosen.itertuples(index=False)):
            if progress is not None:
                progress(done, len(chosen))
            key = RunKey(str(row.scenario), str(row.estimator), int(str(row.seed)))
            run([sources.get(key.scenario, key.scenario)], [key.estimator], 1, place, nonce=nonce, first_seed=key.seed)
            again = Store(place).read_run(key)
            if again is None:
                raise FdbenchError(f"{key.scenario}, {key.estimator}, seed {key.seed}: no such run could be made.")
            stored = good[(good[list(RunKey._fields)] == list(key)).all(axis="columns")]
            for name in ("scenario", "estimator"):
                if again.provenance[f"{name}_digest"] != stored[f"{name}_digest"].iloc[0]:
                    changed.add(f"{name} {getattr(key, name)}")
            values = {score.metric: score.value for score in again.scores}
            for metric, value in zip(stored["metric"], stored["value"], strict=True):
                now, compared = values.get(metric), compared + 1
                difference = math.inf if now is None else abs(now - value) / max(abs(now), abs(value), 1e-12)
                largest = max(largest, difference)
                if difference > SAME:
                    differences.append(Difference(key=key, metric=str(metric), stored=float(value), now=now))
    return Verification(
        runs=len(chosen),
        scores=compared,
        largest=largest,
        differences=tuple(differences),
        changed=tuple(sorted(changed)),
    )


def _is_sealed_otherwise(folder: Path, scores: "pd.DataFrame") -> bool:
    """Return whether a folder has a seal, and it is not that of its rows."""
    seal = read_seal(folder)
    if seal is None:
        return False
    scenarios = dict(zip(scores["scenario"], scores["scenario_digest"], strict=True))
    return (
        set(scores["nonce"]) != {seal.nonce}
        or set(scores["code_digest"]) != {seal.code_digest}
        or any(seal.scenarios.get(name) != digest for name, digest in scenarios.items())
    )
