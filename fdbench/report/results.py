"""The page of benchmark results: rankings, pictures of each scenario, failures, speed, provenance."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fdbench.benchmark.leaderboard import (
    NEGLIGIBLE,
    SCORE,
    check_mergeable,
    interval_text,
    number_text,
    seeds_of,
    shown_unit,
    unranked_text,
    value_text,
)
from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.run import NULL
from fdbench.benchmark.statistics import (
    LEVEL,
    Standing,
    Trouble,
    loss,
    parameter_bias,
    rankings,
    run_scores,
    run_statuses,
    seed_means,
    standings,
    troubles,
)
from fdbench.benchmark.store import FAILED, OK, PROVENANCE, SKIPPED, STATUSES, Store
from fdbench.metrics import metrics
from fdbench.report._figures import Style, dots, labelled, legend, named, styles_of
from fdbench.report._page import Block, Figure, Grid, Section, breakable, folded, note, paragraph, table, write_page
from fdbench.report._scenario import known_scenario, pictures
from fdbench.report._series import points_of_a_series
from fdbench.report._templates import Html, part
from fdbench.scenario import TRACKS
from fdbench.units import time_text, unit_of
from fdbench.wording import public_text, quantity, unit_text

if TYPE_CHECKING:
    import pandas as pd

SPEED = "microseconds_per_sample"
SHORT_DIGEST = 12


def write_report(folder: Path, output: Path) -> None:
    """Write the results of a folder as one HTML file that works offline.

    Raises
    ------
    FdbenchError
        If there are no results, if they do not belong together, or if the file cannot be written.
    """
    store = Store(folder)
    scores, parameters = store.scores(), store.parameters()
    check_mergeable(scores)
    styles = styles_of(sorted(scores["estimator"].unique()))
    statuses = run_statuses(scores)
    sections = [
        Section("Ranking", _ranking(scores, styles)),
        Section("Scenarios", _scenarios(store, scores, parameters, styles)),
        Section("Failed and skipped runs", list(_troubles(scores, statuses))),
        Section("Speed", list(_speed(scores, styles))),
        Section("Provenance", list(_provenance(scores))),
    ]
    write_page(output, "fdbench: benchmark results", _lead(scores, statuses, styles), sections)


def _lead(scores: "pd.DataFrame", statuses: "pd.DataFrame", styles: Mapping[str, Style]) -> list[Html]:
    counts = statuses["status"].value_counts()
    by_status = ", ".join(f"{counts[status]} {status}" for status in STATUSES if status in counts)
    return [
        paragraph(
            f"{_counted(scores['estimator'].nunique(), 'estimator')} on "
            f"{_counted(scores['scenario'].nunique(), 'scenario')}; {_counted(len(statuses), 'run')}: {by_status}. "
            f"Suite version {scores['fdbench_version'].iloc[0]}."
        ),
        legend(styles),
    ]


# ---- ranking ----


def _ranking(scores: "pd.DataFrame", styles: Mapping[str, Style]) -> list[Block]:
    tracks: dict[str, list[Block]] = {}
    for track, plant in rankings(scores):
        tracks.setdefault(track, []).append(Section(plant, list(_standings(scores, track, plant, styles))))
    return [paragraph(SCORE), *(Section(f"Track: {track}", sections) for track, sections in tracks.items())]


def ranking_figure(ranking: Sequence[Standing], styles: Mapping[str, Style]) -> Figure:
    """Return the score of each estimator with its interval."""
    return dots(
        f"Score with {LEVEL:.0%} interval",
        [line.estimator for line in ranking],
        np.array([line.score.value for line in ranking]),
        np.array([(line.score.low, line.score.high) for line in ranking]),
        styles,
        "score (1: knows the truth, 0: has learnt nothing)",
    )


def _standings(scores: "pd.DataFrame", track: str, plant: str, styles: Mapping[str, Style]) -> Iterator[Block]:
    ranking = standings(scores, track, plant)
    names = [line.estimator for line in ranking]
    yield ranking_figure(ranking, styles)
    yield table(
        ["rank", "estimator", "score", f"{LEVEL:.0%} interval", "scenarios", "failures"],
        [
            [
                "" if line.rank is None else str(line.rank),
                named(line.estimator, styles[line.estimator]),
                f"{line.score.value:.3f}",
                interval_text(line.score),
                f"{line.scenarios} of {line.of_scenarios}",
                part("bad", line.failures) if line.failures else "0",
            ]
            for line in ranking
        ],
        "rlrrrr",
    )
    if text := unranked_text(scores, track, plant):
        yield note(text)
    by_scenario = run_scores(scores, track, plant).groupby("scenario").mean()[names]
    rows = [
        [str(scenario), *("–" if math.isnan(value) else f"{value:.3f}" for value in values)]
        for scenario, values in zip(by_scenario.index, by_scenario.to_numpy(), strict=True)
    ]
    yield folded("Mean score by scenario", table(["scenario", *names], rows, "l" + "r" * len(names)))


# ---- scenarios ----


def _scenarios(
    store: Store, scores: "pd.DataFrame", parameters: "pd.DataFrame", styles: Mapping[str, Style]
) -> list[Section]:
    means, biases = seed_means(scores), parameter_bias(parameters)
    n_points = points_of_a_series(_n_pictured(run_statuses(scores)))
    sections = []
    for key, own in scores.groupby("scenario"):
        name, digest, seed = str(key), str(own["scenario_digest"].iloc[0]), int(own["seed"].min())
        scenario = known_scenario(name, digest)
        lead = [] if scenario is None else [paragraph(scenario.title), note(scenario.source)]
        blocks: list[Block] = [*lead, note(f"{seeds_of(own)}; pictures of seed {seed}.")]
        blocks += _metric_tables(means[means.index.get_level_values("scenario") == name].droplevel("scenario"))
        blocks += pictures(store, name, seed, scenario, styles, n_points)
        blocks += _biases(biases[biases["scenario"] == name], styles)
        sections.append(Section(name, blocks))
    return sections


def _n_pictured(statuses: "pd.DataFrame") -> int:
    """Return the number of runs whose estimate is kept and shown, those of the first seed that went well."""
    first = statuses["seed"] == statuses.groupby("scenario")["seed"].transform("min")
    return int((first & (statuses["status"] == OK)).sum())


def _metric_tables(means: "pd.DataFrame") -> Iterator[Html]:
    """Yield one table for all metrics but speed; the best value of each row, references apart, in bold."""
    present = means.dropna(axis="columns", how="all")
    names = sorted((str(name) for name in present), key=lambda name: (name in (NULL, ORACLE), name))
    rows = []
    for metric_name in (str(name) for name in present.index):
        metric = metrics.get(metric_name)
        if metric.track not in TRACKS:
            continue
        values = dict(zip(names, present.loc[metric_name, names].to_numpy(dtype=np.float64).tolist(), strict=True))
        losses = {name: loss(metric, v) for name, v in values.items() if not math.isnan(v)}
        best = min((value for name, value in losses.items() if name not in (NULL, ORACLE)), default=math.nan)
        scale = values.get(NULL, math.nan)
        cells = [
            part("strong", text) if losses.get(name) == best and name not in (NULL, ORACLE) else text
            for name, text in ((name, _with_micro(value_text(v, metric.unit, scale))) for name, v in values.items())
        ]
        arrow = "↑" if metric.bigger_is_better else "↓"
        title = f"{metric_name} {arrow}{' *' if metric.primary else ''}"
        rows.append([breakable(title), metric.track, unit_text(shown_unit(metric.unit)), *cells])
    if rows:
        rows.sort(key=lambda row: TRACKS.index(row[1]))
        yield table(["metric", "track", "unit", *names], rows, "lll" + "r" * len(names))
        yield note(
            "Means over the seeds that went well. ↓: smaller is better, ↑: bigger is better, *: counts in the score. "
            "Bold: nearest to ideal."
        )


def _biases(biases: "pd.DataFrame", styles: Mapping[str, Style]) -> Iterator[Block]:
    own = biases[~biases["estimator"].isin([NULL, ORACLE])]
    figures, rows = [], []
    for key, group in own.groupby("parameter", sort=False):
        group = group.sort_values("estimator")
        parameter, truth = str(key), float(group["truth"].iloc[0])
        is_zero = abs(truth) <= NEGLIGIBLE * group["bias"].abs().max()
        factor, unit = (1.0, unit_text(unit_of(parameter))) if is_zero else (100.0 / abs(truth), "%")
        values = factor * group["bias"].to_numpy()
        bounds = factor * group[["low", "high"]].to_numpy()
        names = [str(name) for name in group["estimator"]]
        text, own_unit = quantity(parameter)
        shown = "0" if is_zero else number_text(truth, truth)
        title = f"{text}, truth {shown} {unit_text(own_unit)}".rstrip()
        figures.append(dots(title, names, values, bounds, styles, labelled("bias", unit)))
        rows += [
            [parameter, shown, name, number_text(value, 0.0), _bounds_text(*pair), unit]
            for name, value, pair in zip(names, values, bounds, strict=True)
        ]
    if figures:
        yield Section(
            "Parameters: bias over the seeds",
            [
                note(f"Mean error with its {LEVEL:.0%} t interval, in per cent of the true value where that is not 0."),
                Grid(figures),
                folded(
                    "Numbers",
                    table(["parameter", "truth", "estimator", "bias", f"{LEVEL:.0%} interval", "in"], rows, "lrlrrl"),
                ),
            ],
        )


def _bounds_text(low: float, high: float) -> str:
    return "–" if math.isnan(low) else f"{number_text(low, 0.0)} to {number_text(high, 0.0)}"


# ---- failures, speed, provenance ----


def _troubles(scores: "pd.DataFrame", statuses: "pd.DataFrame") -> Iterator[Html]:
    every = sorted(scores["scenario"].unique())
    merged: dict[tuple[str, str, str, str], list[Trouble]] = {}
    for line in troubles(statuses):
        seeds = "" if line.status == SKIPPED else line.seeds
        merged.setdefault((line.status, line.reason, line.estimators, seeds), []).append(line)
    rows = [
        [
            status if status == SKIPPED else part("bad", status),
            part("reason", public_text(reason)),
            estimators,
            _names_text([line.scenario for line in lines], every),
            max((line.seeds for line in lines), key=len),
        ]
        for (status, reason, estimators, _), lines in merged.items()
    ]
    rows.sort(key=lambda row: (SKIPPED in row[0], row))
    if rows:
        yield table(["status", "reason", "estimators", "scenarios", "seeds"], rows, "lllll")
    else:
        yield paragraph("None: every run went well.")
    yield from _metric_troubles(scores)


def _metric_troubles(scores: "pd.DataFrame") -> Iterator[Html]:
    """Yield the metrics that runs have no value of although they have an estimate."""
    runs = ["scenario", "estimator", "seed"]
    every = sorted(scores["scenario"].unique())
    estimated = set(scores.loc[scores["status"] == OK, runs].itertuples(index=False, name=None))
    bad = scores[scores["status"] != OK]
    has_estimate = [run in estimated for run in bad[runs].itertuples(index=False, name=None)]
    missing = bad[np.array(has_estimate, dtype=bool)]
    rows = [
        [
            part("bad", status) if status == FAILED else str(status),
            str(metric),
            part("reason", public_text(str(reason))),
            ", ".join(sorted(group["estimator"].unique())),
            _names_text(sorted(group["scenario"].unique()), every),
        ]
        for (status, metric, reason), group in missing.groupby(["status", "metric", "message"])
    ]
    if rows:
        header = ["status", "metric", "reason", "estimators", "scenarios"]
        yield folded("Metrics without a value in runs that have an estimate", table(header, rows, "lllll"))


def _speed(scores: "pd.DataFrame", styles: Mapping[str, Style]) -> Iterator[Html]:
    good = scores[(scores["metric"] == SPEED) & (scores["status"] == OK)]
    if good.empty:
        yield paragraph("No run has a time.")
        return
    medians = good.pivot_table(index="scenario", columns="estimator", values="value", aggfunc="median")
    rows = [
        [str(scenario), *("–" if math.isnan(value) else _with_micro(time_text(value, "us")) for value in values)]
        for scenario, values in zip(medians.index, medians.to_numpy(), strict=True)
    ]
    header = ["scenario", *(named(str(name), styles[str(name)]) for name in medians)]
    yield paragraph("Time of a fit for each sample, compilation apart: median over the seeds.")
    yield table(header, rows, "l" + "r" * len(medians.columns))


def _with_micro(time: str) -> str:
    return time.replace(" us", f" {unit_text('us')}")


def _provenance(scores: "pd.DataFrame") -> Iterator[Html]:
    digests = ("scenario_digest", "estimator_digest")
    rows = [
        [name.replace("_", " "), *(part("code", value) for value in [", ".join(sorted(scores[name].unique())) or "–"])]
        for name in PROVENANCE
        if name not in (*digests, "utc")
    ]
    first, last = scores["utc"].min(), scores["utc"].max()
    rows.append(["time of the runs (UTC)", part("code", first if first == last else f"{first} to {last}")])
    rows.append(["seeds", _seeds_text(sorted(int(seed) for seed in scores["seed"].unique()))])
    yield table(["what", "value"], rows, "ll")
    scenarios = scores.groupby("scenario").agg(digest=("scenario_digest", "first"), seeds=("seed", "nunique"))
    yield table(
        ["scenario", "seeds", "digest"],
        [[str(line.Index), str(line.seeds), part("code", str(line.digest))] for line in scenarios.itertuples()],
        "lrl",
    )
    estimators = scores.groupby(["estimator", "estimator_digest"])
    yield folded(
        "Digests of the estimators with their arguments",
        table(
            ["estimator", "digest", "scenarios"],
            [
                [str(name), part("code", str(digest)[:SHORT_DIGEST]), ", ".join(sorted(group["scenario"].unique()))]
                for (name, digest), group in estimators
            ],
            "lll",
        ),
    )


def _names_text(names: Sequence[str], every: Sequence[str]) -> str:
    """Return names, or those that are missing where they are fewer.

    >>> _names_text(["a"], ["a", "b", "c"]), _names_text(["a", "b"], ["a", "b", "c"]), _names_text(["a"], ["a"])
    ('a', 'all but c', 'a')
    """
    missing = [name for name in every if name not in names]
    if len(missing) >= len(names) or len(every) == 1:
        return ", ".join(names)
    return f"all but {', '.join(missing)}" if missing else "all"


def _seeds_text(seeds: Sequence[int]) -> str:
    """Return seeds in words.

    >>> _seeds_text([0, 1, 2]), _seeds_text([0]), _seeds_text([0, 5])
    ('0 to 2', '0', '0, 5')
    """
    if len(seeds) > 1 and seeds[-1] - seeds[0] == len(seeds) - 1:
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(str(seed) for seed in seeds)


def _counted(number: int, noun: str) -> str:
    """Return a number with its noun.

    >>> _counted(1, "seed"), _counted(3, "seed")
    ('1 seed', '3 seeds')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
