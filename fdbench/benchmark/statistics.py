"""From score rows to rankings: normalised scores, interquartile means with intervals, and biases of parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.store import DIVERGED, FAILED, OK, SKIPPED
from fdbench.errors import FdbenchError
from fdbench.metrics import Metric, metrics
from fdbench.regression import FloatArray
from fdbench.scenario import TRACKS
from fdbench.statistics import drawn_rows, percentile_interval

if TYPE_CHECKING:
    import pandas as pd

RESAMPLES = 2000
SEED = 20240
LEVEL = 0.95
ROUNDING = 1e-9
EVERY = "all"  # estimators of a scenario
FIRST_PLANT = "feed_drive"
RUN = ["scenario", "seed"]

# Share of null's loss up to which the oracle's is rounding error.
SMALLEST_REACH = 1e-6


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A value with its 95 % interval; the bounds are NaN where there are too few seeds for one."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether 0 lies outside by more than rounding errors; without bounds nothing is excluded."""
        return self.low > ROUNDING or self.high < -ROUNDING


@dataclass(frozen=True, kw_only=True)
class Standing:
    """One line of a ranking.

    Attributes
    ----------
    rank : int or None
        Shared where the paired difference to the first of the rank is not significant; None for null and oracle, and
        for what was ok nowhere.
    estimator : str
    score : Interval
        Interquartile mean of the normalised scores.
    scenarios, of_scenarios : int
        Scenarios in which the estimator has a score of this track, and all that have one.
    failures : int
        Failed and diverged runs.
    """

    rank: int | None
    estimator: str
    score: Interval
    scenarios: int
    of_scenarios: int
    failures: int


@dataclass(frozen=True, kw_only=True)
class Trouble:
    """Runs of a scenario that failed, diverged or were skipped for one reason; ``estimators`` may be ``all``."""

    scenario: str
    estimators: str
    seeds: str
    status: str
    reason: str


def interquartile_mean(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weighted mean of the middle half of the weight, along the last axis.

    A value on the edge of the middle half counts by the part of its weight that lies inside.

    Parameters
    ----------
    values, weights : (..., n) arrays
        Of the same shape; weights above 0.

    Examples
    --------
    >>> interquartile_mean(np.array([9.0, 1.0, 2.0, -50.0]), np.ones(4))  # the mean of 1 and 2
    array(1.5)
    >>> interquartile_mean(np.array([1.0, 2.0, 4.0, 5.0, 90.0]), np.ones(5))  # (0.75 * 2 + 4 + 0.75 * 5) / 2.5
    array(3.7)
    """
    order = np.argsort(values, axis=-1, kind="stable")
    ordered = np.take_along_axis(values, order, axis=-1)
    share = np.take_along_axis(weights, order, axis=-1)
    share = share / share.sum(axis=-1, keepdims=True)
    above = np.cumsum(share, axis=-1)
    inside = np.clip(np.minimum(above, 0.75) - np.maximum(above - share, 0.25), 0.0, None)
    return np.asarray((inside * ordered).sum(axis=-1) / inside.sum(axis=-1))


def loss(metric: type[Metric], value: float) -> float:
    """Return the distance of a value to the metric's ideal; beyond the ideal no gain is left, and the loss is 0."""
    return max(0.0, metric.ideal - value if metric.bigger_is_better else value - metric.ideal)


def rankings(scores: "pd.DataFrame") -> list[tuple[str, str]]:
    """Return the track and the kind of plant of each ranking that is not empty, in the order they are shown."""
    plants = sorted(scores["plant"].unique(), key=lambda name: (name != FIRST_PLANT, name))
    return [(track, str(plant)) for track in TRACKS for plant in plants if not run_scores(scores, track, plant).empty]


def run_scores(scores: "pd.DataFrame", track: str, plant: str | None = None) -> "pd.DataFrame":
    r"""Return the score of each run in a track: a row per scenario and seed, a column per estimator.

    .. math:: s = \frac{1}{M} \sum_{i=1}^{M} \mathrm{clip}\!\left(
              \frac{1}{D_i} \log_{10} \frac{\bar\ell_{i,null}}{\ell_i}, -1, 1 \right)

    with the `loss` :math:`\ell` of each primary metric, the geometric mean of null's losses over the scenario's seeds
    and the metric's ``decades`` D: each tenfold smaller error is worth 1 / D more. A metric counts where it is
    `usable`; a run counts where null and oracle both ran well. A failed or diverged run has each metric's worst value.
    A run that is skipped, or claims nothing, is NaN. An estimator that never claims anything of the track has no
    column, nor has one that lacks runs; see `unranked`. With ``plant``, only scenarios of this kind count.

    Raises
    ------
    FdbenchError
        If there are no rows of null or oracle.
    """
    import pandas as pd

    if plant is not None:
        scores = scores[scores["plant"] == plant]
    for reference in (NULL, ORACLE):
        if not (scores["estimator"] == reference).any():
            raise FdbenchError(f"scores: no rows of '{reference}', which every score is measured against.")
    rows = _primary_rows(scores, track)
    runs, lacking = _ranked_runs(rows)
    rows = rows[pd.MultiIndex.from_frame(rows[RUN]).isin(runs) & ~rows["estimator"].isin(lacking)]
    wide = _losses(rows).dropna(subset=[NULL, ORACLE])
    null = usable(rows).reindex(_without_seed(wide)).to_numpy()
    wide, null = wide[np.isfinite(null)], null[np.isfinite(null)]
    with np.errstate(divide="ignore"):
        ratios = np.log10(null[:, None]) - np.log10(wide)
    decades = np.array([metrics.get(name).decades for name in wide.index.get_level_values("metric")])
    result: pd.DataFrame = ratios.div(decades, axis=0).clip(-1.0, 1.0).groupby(RUN).mean().sort_index()
    good = set(rows.loc[rows["status"] == OK, "estimator"])
    never_good = set(scores["estimator"]) - set(scores.loc[scores["status"] == OK, "estimator"])
    ranked = [name for name in sorted(result.columns) if name in good | never_good and result[name].notna().any()]
    return result[ranked]


def _losses(rows: "pd.DataFrame") -> "pd.DataFrame":
    """Return the loss of each run in each metric: rows scenario, seed and metric, columns estimators."""
    classes = {name: metrics.get(name) for name in rows["metric"].unique()}
    losses = [
        np.nan if status == SKIPPED else loss(classes[name], value if status == OK else classes[name].worst)
        for name, value, status in zip(rows["metric"], rows["value"], rows["status"], strict=True)
    ]
    wide: pd.DataFrame = rows.assign(loss=losses).pivot(index=[*RUN, "metric"], columns="estimator", values="loss")
    good = rows[rows["status"] == OK].pivot(index=[*RUN, "metric"], columns="estimator", values="value").notna()
    for reference in (NULL, ORACLE):
        is_good = good.reindex(index=wide.index, columns=[reference], fill_value=False)[reference]
        wide[reference] = wide[reference].where(is_good) if reference in wide else np.nan
    return wide


def _without_seed(wide: "pd.DataFrame") -> "pd.MultiIndex":
    """Return the scenario and the metric of each row."""
    import pandas as pd

    return pd.MultiIndex.from_arrays([wide.index.get_level_values(name) for name in ("scenario", "metric")])


def usable(rows: "pd.DataFrame") -> "pd.Series":
    """Return the geometric mean of null's losses by scenario and metric, of those metrics that a score can rest on.

    They are those in which the oracle has no loss but rounding errors, so that none can stand above it, and null has
    one in every seed.
    """
    wide = _losses(rows).dropna(subset=[NULL, ORACLE])
    reachable = wide[ORACLE] <= SMALLEST_REACH * wide[NULL]
    fit = (reachable & (wide[NULL] > 0.0)).groupby(["scenario", "metric"]).all()
    with np.errstate(divide="ignore"):
        means: pd.Series = np.exp(np.log(wide[NULL]).groupby(["scenario", "metric"]).mean())
    return means[fit]


def unused(scores: "pd.DataFrame", track: str, plant: str) -> list[tuple[str, str]]:
    """Return scenario and metric of what a ranking leaves out, as even the oracle has a loss or null has none."""
    rows = _primary_rows(scores[scores["plant"] == plant], track)
    known = _without_seed(_losses(rows).dropna(subset=[NULL, ORACLE])).unique()
    counted = usable(rows).index
    return sorted((str(scenario), str(metric)) for scenario, metric in known if (scenario, metric) not in counted)


def _primary_rows(scores: "pd.DataFrame", track: str) -> "pd.DataFrame":
    classes = {name: metrics.get(name) for name in scores["metric"].unique()}
    return scores[[classes[name].track == track and classes[name].primary for name in scores["metric"]]]


def _ranked_runs(rows: "pd.DataFrame") -> tuple["pd.MultiIndex", dict[str, int]]:
    """Return the runs, scenario and seed, that a ranking is over, and the estimators that lack some, with how many.

    A run counts if more than half as many estimators were run on it as on the one with the most. So a trial on few
    scenarios or seeds, or on others, leaves the ranking of the others as it is.
    """
    import pandas as pd

    done = rows.drop_duplicates([*RUN, "estimator"])
    is_reference = done["estimator"].isin([NULL, ORACLE])
    counts = done[is_reference if is_reference.all() else ~is_reference].groupby(RUN).size()
    runs = pd.MultiIndex.from_tuples(counts.index[2 * counts > counts.max()], names=RUN)
    inside = done[pd.MultiIndex.from_frame(done[RUN]).isin(runs)]
    present = inside["estimator"].value_counts()
    lacking = {
        str(name): len(runs) - int(present.get(name, 0)) for name in done.loc[~is_reference, "estimator"].unique()
    }
    return runs, {name: number for name, number in sorted(lacking.items()) if number}


def unranked(scores: "pd.DataFrame", track: str, plant: str) -> list[str]:
    """Return the estimators that claim something of a track but lack runs of its ranking, with how many in words."""
    rows = _primary_rows(scores[scores["plant"] == plant], track)
    runs, lacking = _ranked_runs(rows)
    claiming = set(rows.loc[rows["status"] != SKIPPED, "estimator"])
    return [f"{name} ({number} of {len(runs)})" for name, number in lacking.items() if name in claiming]


def bootstrap(values: "pd.DataFrame") -> dict[str, tuple[float, FloatArray]]:
    """Return the interquartile mean of each column and its bootstrap distribution (RESAMPLES,).

    Seeds are drawn with replacement within each scenario, the same for all columns, so that differences are paired;
    each scenario has the same weight. The generator is its own, with a fixed seed.
    """
    scenario = values.index.get_level_values("scenario").to_numpy()
    _, place, seeds = np.unique(scenario, return_inverse=True, return_counts=True)
    weights = 1.0 / seeds[place]
    drawn = drawn_rows(scenario, RESAMPLES, SEED)
    spread = np.broadcast_to(weights, drawn.shape)
    columns = {str(name): values[name].to_numpy(dtype=np.float64) for name in values}
    return {
        name: (float(interquartile_mean(column, weights)), interquartile_mean(column[drawn], spread))
        for name, column in columns.items()
    }


def _interval(value: float, resampled: FloatArray, known: bool) -> Interval:
    """Return the 95 % percentile interval of a bootstrap; without bounds if it is not known."""
    low, high = percentile_interval(resampled) if known else (np.nan, np.nan)
    return Interval(value=value, low=float(low), high=float(high))


def standings(scores: "pd.DataFrame", track: str, plant: str | None = None) -> list[Standing]:
    """Return the ranking of a track, best score first and the same ones by name; null and oracle have no rank.

    With ``plant``, that of the scenarios of this kind of plant, and of the estimators that apply to one of them. A run
    that an estimator skips counts as 0, the score of null. Going down from the best score, an estimator shares
    the rank of the one before unless the interval of its paired difference to the first of that rank excludes 0. With
    one seed per scenario no interval is known, and all share.
    """
    values = run_scores(scores, track, plant)
    if values.empty:
        return []
    known = bool(values.groupby("scenario").size().max() > 1)
    distributions = bootstrap(values.fillna(0.0))
    statuses = run_statuses(scores).set_index(["estimator", *RUN])["status"]
    covered = values.notna().groupby("scenario").any()
    good = set(scores.loc[scores["status"] == OK, "estimator"])
    lines: list[Standing] = []
    first, rank, n_ranked = "", 0, 0
    for name in sorted(distributions, key=lambda column: (-round(distributions[column][0] / ROUNDING), column)):
        value, resampled = distributions[name]
        is_ranked = name not in (NULL, ORACLE) and name in good
        if is_ranked:
            n_ranked += 1
            best, best_resampled = distributions[first or name]
            difference = _interval(best - value, best_resampled - resampled, known)
            if not first or difference.excludes_zero:
                first, rank = name, n_ranked
        lines.append(
            Standing(
                rank=rank if is_ranked else None,
                estimator=name,
                score=_interval(value, resampled, known),
                scenarios=int(covered[name].sum()),
                of_scenarios=len(covered),
                failures=int(statuses[name].reindex(values.index).isin([FAILED, DIVERGED]).sum()),
            )
        )
    return lines


def run_statuses(scores: "pd.DataFrame") -> "pd.DataFrame":
    """Return ``scenario, estimator, seed, status, message``, a row for each run.

    A run is failed if one of its metrics is; it is diverged or skipped if all of them are.
    """
    order = {FAILED: 0, OK: 1, DIVERGED: 2, SKIPPED: 3}
    rows = scores.assign(order=scores["status"].map(order)).sort_values("order", kind="stable")
    rows = rows.groupby(["scenario", "estimator", "seed"], as_index=False).first()
    rows.loc[rows["status"] == OK, "message"] = ""
    return rows[["scenario", "estimator", "seed", "status", "message"]]


def troubles(statuses: "pd.DataFrame") -> list[Trouble]:
    """Return the runs that are not ok, those with the same reason in one line; see `run_statuses`."""
    everyone = statuses.groupby("scenario")["estimator"].nunique()
    found = []
    for (scenario, status, reason), group in statuses[statuses["status"] != OK].groupby(
        ["scenario", "status", "message"]
    ):
        names = sorted(group["estimator"].unique())
        seeds = sorted(int(seed) for seed in group["seed"].unique())
        found.append(
            Trouble(
                scenario=str(scenario),
                estimators=EVERY if len(names) == everyone[str(scenario)] else ", ".join(names),
                seeds=seeds_text(seeds),
                status=str(status),
                reason=str(reason),
            )
        )
    return found


def seeds_text(seeds: Sequence[int]) -> str:
    """Return ascending seeds in words.

    >>> seeds_text([0, 1, 2]), seeds_text([0, 1]), seeds_text([0, 2, 3])
    ('0 to 2', '0, 1', '0, 2, 3')
    """
    if len(seeds) > 2 and seeds[-1] - seeds[0] == len(seeds) - 1:
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(str(seed) for seed in seeds)


def seed_means(scores: "pd.DataFrame") -> "pd.DataFrame":
    """Return the mean of each metric over the good seeds: rows scenario and metric, columns estimators."""
    good = scores[scores["status"] == OK]
    return good.pivot_table(index=["scenario", "metric"], columns="estimator", values="value", aggfunc="mean")


def parameter_bias(parameters: "pd.DataFrame") -> "pd.DataFrame":
    r"""Return the bias of each parameter over seeds, with its 95 % interval.

    .. math:: b = \overline{\hat\beta - \beta}, \quad b \pm t_{0.975, n-1}\, \frac{s}{\sqrt n}

    Returns
    -------
    DataFrame
        ``scenario, estimator, parameter, truth, bias, low, high, standard_deviation, n_seeds``; bounds and standard
        deviation s are NaN for one seed. Parameters without truth or estimate are left out.
    """
    from scipy.special import stdtrit

    known = parameters.dropna(subset=["estimate", "truth"])
    errors = known.assign(error=known["estimate"] - known["truth"])
    groups = errors.groupby(["scenario", "estimator", "parameter"], sort=False)
    result = groups.agg(
        truth=("truth", "mean"),
        bias=("error", "mean"),
        standard_deviation=("error", "std"),
        n_seeds=("error", "size"),
    ).reset_index()
    n = result["n_seeds"].to_numpy(dtype=np.float64)
    quantile = np.where(n > 1.0, stdtrit(np.maximum(n - 1.0, 1.0), 0.5 + 0.5 * LEVEL), np.nan)
    half = quantile * result["standard_deviation"] / np.sqrt(n)
    return result.assign(low=result["bias"] - half, high=result["bias"] + half)
