"""How well a board tells estimators apart, and how far it is from what can be known.

    python benchmarks/board_criteria.py RESULTS

Of a folder of results: whether any row is above the oracle, whether each scenario is in a ranking, in how many rankings
of one scenario the three best are alike, how far three families are apart on the shaker trials, and how many runs are
skipped. Then, for each family of scenarios and track, the best row with its share of the ceiling and, where the noise
sets a bound to the parameters, its efficiency beside it; and in which rankings of one scenario a row of the five papers
is ahead of all others. The records of velocity loops are simulated again for the efficiency.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.statistics import rankings, run_scores, run_statuses, standings
from fdbench.benchmark.store import OK, SKIPPED, Store
from fdbench.nonce import derived_seed
from fdbench.scenario import TRACKS, load_scenario
from fdbench.statistics import drawn_rows, percentile_interval

ALIKE = 0.01
FAMILIES = ("pl_lssvm", "krls_t", "least_squares")
SHAKER = "Shaker"
# Rows that the five papers have; all others are ours.
PUBLISHED = {
    "frequency_least_squares",
    "hybrid_rls",
    "kalman",
    "kalman_central",
    "kalman_consensus",
    "kalman_distributed",
    "kalman_parallel",
    "kalman_weighted",
    "krls_t",
    "least_squares",
    "linear_regression",
    "lr_nfb",
    "physics_model",
    "pl_lssvm",
    "slr_nfb",
}
RESAMPLES = 2000
# Families of scenarios by how their ids begin; an id belongs to the longest.
SCENARIOS = (
    SHAKER,
    "ShakerControl",
    "Milling",
    "MillingAir",
    "LinearMotorAxis",
    "LinearMotorCogging",
    "BallScrewAxis",
    "DriveCurrent",
    "EMPS",
    "SlotMilling",
    "SensorNetwork",
    "Spindle",
    "SpindleTestbed",
    "ServoStaircase",
    "ServoSpiral",
)


def by_scenario(scores: pd.DataFrame) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Yield scenario, track and the scores of its ranking, where there is one."""
    for scenario, own in scores.groupby("scenario", sort=True):
        for track, _ in rankings(own):
            found = {one.estimator: one.score.value for one in standings(own, track)}
            if found:
                yield str(scenario), track, found


def report(folder: Path) -> Iterator[str]:
    """Yield the lines to be printed."""
    scores = Store(folder).scores()
    rounding = 1e-12
    ranked = list(by_scenario(scores))
    above = [f"{name} ({track})" for name, track, found in ranked if max(found.values()) > found[ORACLE] + rounding]
    yield f"{len(ranked)} rankings of one scenario and track; a row above the oracle in {len(above)}{listed(above)}"
    alike = []
    for name, track, found in ranked:
        best = sorted((value for row, value in found.items() if row not in (NULL, ORACLE)), reverse=True)[:3]
        if len(best) == 3 and best[0] - best[2] < ALIKE:
            alike.append(f"{name} ({track})")
    yield f"the three best within {ALIKE} in {len(alike)}{listed(alike)}"
    inside = {scenario for track, plant in rankings(scores) for scenario, _ in run_scores(scores, track, plant).index}
    outside = sorted({*scores.scenario} - inside)
    yield f"scenarios in no ranking: {len(outside)}{listed(outside)}"
    shaken = scores[scores.scenario.str.startswith(SHAKER)]
    for track in TRACKS:
        own = {one.estimator: one.score for one in standings(shaken, track)} if len(shaken) else {}
        words = [
            f"{name} {own[name].value:.3f} ({own[name].low:.3f} to {own[name].high:.3f})"
            for name in FAMILIES
            if name in own
        ]
        if words:
            yield f"shaker trials, {track}: {', '.join(words)}"
    statuses = run_statuses(scores)
    skipped = int((statuses.status == SKIPPED).sum())
    yield f"{len(statuses)} runs, of which {skipped} skipped ({skipped / len(statuses):.0%})"


def published_ahead(scores: pd.DataFrame) -> Iterator[str]:
    """Yield the rankings of one scenario in which a published row is ahead, with the interval of the difference."""
    ahead, beyond = 0, 0
    for scenario, own in scores.groupby("scenario", sort=True):
        for track, plant in rankings(own):
            runs = run_scores(own, track, plant).drop(columns=[NULL, ORACLE], errors="ignore").dropna(axis=1)
            ours = [name for name in runs if name not in PUBLISHED]
            if not ours:
                continue
            best = runs[ours].mean().idxmax()
            for name in runs.columns.difference(ours):
                lead = runs[name].to_numpy() - runs[best].to_numpy()
                if lead.mean() > 0.0:
                    low, high = percentile_interval(lead[drawn_rows(np.zeros(len(lead)), RESAMPLES)].mean(axis=1))
                    ahead, beyond = ahead + 1, beyond + (low > 0.0)
                    yield f"{scenario} ({track}): {name} ahead of {best} by {lead.mean():.3f} ({low:.3f} to {high:.3f})"
    yield f"published rows ahead of all others: {ahead}, beyond chance {beyond}"


def best_rows(folder: Path) -> Iterator[str]:
    """Yield a table: the best row of each family and track, its share of the ceiling and of the bound."""
    scores, parameters = Store(folder).scores(), Store(folder).parameters()
    family = scores.scenario.map(lambda name: max((one for one in SCENARIOS if name.startswith(one)), key=len))
    yield "| scenarios | track | best row | share of the ceiling | efficiency beside the bound |"
    yield "| --- | --- | --- | --- | --- |"
    for name in SCENARIOS:
        own = scores[family == name]
        for track in TRACKS:
            best = next((one for one in standings(own, track) if one.rank), None) if len(own) else None
            if best is not None:
                words = [name, track, f"`{best.estimator}`", share(best.score.value, best.score.low, best.score.high)]
                bound = efficiency(own, parameters, best.estimator) if track == "parameters" else ""
                yield f"| {' | '.join([*words, bound])} |"


def efficiency(scores: pd.DataFrame, parameters: pd.DataFrame, estimator: str) -> str:
    """Return the sum of bounds over that of squared errors of the parameters, with its interval, or nothing."""
    own = scores[(scores.estimator == estimator) & (scores.metric == "parameter_error") & (scores.status == OK)]
    stated = parameters[parameters.estimator == estimator].set_index(["scenario", "seed", "parameter"]).standard_error
    bounds = np.array([squared_bound(run, stated) for run in own.itertuples()])
    if not np.isfinite(bounds).all():
        return ""
    errors = own.value.to_numpy() ** 2
    drawn = drawn_rows(own.scenario.to_numpy(), RESAMPLES)
    return share(
        bounds.sum() / errors.sum(), *percentile_interval(bounds[drawn].sum(axis=1) / errors[drawn].sum(axis=1))
    )


def squared_bound(run: Any, stated: pd.Series) -> float:
    """Return the bound of a run's squared `parameter_error`; NaN where none is known.

    In a velocity loop it is that of Cramér and Rao for who knows force and friction exactly, and no data sheet; in slot
    milling the variance that the row states, which is the bound of its own model.
    """
    scenario, seed = load_scenario(run.scenario), derived_seed(run.nonce, run.scenario, run.seed)
    sigma = scenario.drawn(seed).reality.noise.equation_velocity_m_per_s
    if not (sigma > 0.0 or run.plant == "slot_milling"):
        return math.nan
    record, truth = scenario.observe(seed)
    regression = scenario.context().regression(record)
    names, regressors = regression.names, regression.regressors
    if sigma > 0.0:
        variance = sigma**2 * np.diag(np.linalg.inv(regressors.T @ regressors))
    else:
        variance = np.array([stated[run.scenario, run.seed, name] ** 2 for name in names])
    square = np.mean(regressors**2, axis=0)
    true = np.array([truth.parameters[name] for name in names])
    return float(1e4 * (square @ variance) / (square @ true**2))


def share(value: float, low: float, high: float) -> str:
    return f"{value:.2f}" if math.isnan(low) else f"{value:.2f} ({low:.2f} to {high:.2f})"


def listed(names: list[str]) -> str:
    return f": {', '.join(names)}" if names else ""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    folder = parser.parse_args().results
    for line in (*report(folder), *published_ahead(Store(folder).scores()), *best_rows(folder)):
        print(line)
