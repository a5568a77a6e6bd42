"""The page of benchmark results: who wins where, then each scenario, failures, speed, provenance."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fdbench.benchmark.leaderboard import (
    NEGLIGIBLE,
    check_mergeable,
    fixed,
    number_text,
    seeds_of,
    shown_unit,
    value_text,
)
from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.statistics import (
    LEVEL,
    loss,
    parameter_bias,
    rankings,
    run_scores,
    run_statuses,
    seed_means,
)
from fdbench.benchmark.store import OK, STATUSES, Store
from fdbench.errors import FdbenchError
from fdbench.metrics import metrics
from fdbench.report import _runs as runs
from fdbench.report._bars import dots
from fdbench.report._page import Block, Folded, Grid, Section, breakable, note, paragraph, slug, table, write_page
from fdbench.report._ranking import all_rankings, ranking_tables, winners
from fdbench.report._scenario import pictures
from fdbench.report._series import CROWDED, points_of_a_series
from fdbench.report._templates import Html, part
from fdbench.scenario import TRACKS, Scenario, load_scenario
from fdbench.units import unit_of
from fdbench.wording import quantity, unit_text

if TYPE_CHECKING:
    import pandas as pd


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
    statuses = run_statuses(scores)
    found = all_rankings(scores)
    lead = [_counts(scores, statuses), part("winners", list(winners(found)))]
    sections = [
        Section("Ranking", list(ranking_tables(scores, found))),
        Section("Scenarios", list(_scenarios(store, scores, parameters))),
        Section("Failed and skipped runs", list(runs.troubles_of(scores, statuses))),
        Section("Speed", list(runs.speed(scores))),
        Section("Provenance", list(runs.provenance(scores))),
    ]
    write_page(output, "fdbench: benchmark results", lead, sections)


def _counts(scores: "pd.DataFrame", statuses: "pd.DataFrame") -> Html:
    counts = statuses["status"].value_counts()
    by_status = ", ".join(f"{counts[status]} {status}" for status in STATUSES if status in counts)
    return note(
        f"{_counted(scores['estimator'].nunique(), 'estimator')} on "
        f"{_counted(scores['scenario'].nunique(), 'scenario')}; {_counted(len(statuses), 'run')}: {by_status}. "
        f"Suite version {scores['fdbench_version'].iloc[0]}."
    )


def _scenarios(store: Store, scores: "pd.DataFrame", parameters: "pd.DataFrame") -> Iterator[Block]:
    """Yield a part for each scenario, folded, with its winners beside its name."""
    means, biases = seed_means(scores), parameter_bias(parameters)
    n_pictured = _n_pictured(run_statuses(scores))
    n_points, is_crowded = points_of_a_series(n_pictured), n_pictured > CROWDED
    ordered = _orders(scores)
    yield part("filter", "scenarios", "details[data-name]")
    for key, own in scores.groupby("scenario"):
        name, digest, seed = str(key), str(own["scenario_digest"].iloc[0]), int(own["seed"].min())
        scenario = _known_scenario(name, digest)
        order = ordered.get(name, {})
        names = sorted(str(estimator) for estimator in own["estimator"].unique())
        ranked = {track: list(dict.fromkeys([*order.get(track, ()), *names])) for track in TRACKS}
        blocks: list[Block] = [] if scenario is None else [paragraph(scenario.title), note(scenario.source)]
        blocks.append(note(f"{seeds_of(own)}; pictures of seed {seed}."))
        blocks += _metric_tables(means[means.index.get_level_values("scenario") == name].droplevel("scenario"))
        blocks += pictures(store, name, seed, scenario, ranked, n_points, is_crowded)
        blocks += _biases(biases[biases["scenario"] == name])
        identifier = f"scenario-{slug(name)}"
        best = [(track, *_winner(values)) for track, values in order.items()]
        yield Folded(part("scenario", name, identifier, best), blocks, identifier=identifier, name=name)


def _known_scenario(name: str, digest: str) -> Scenario | None:
    """Return the scenario that results belong to, or None if it is not installed or has changed since."""
    try:
        scenario = load_scenario(name)
    except FdbenchError:
        return None
    return scenario if scenario.content_digest == digest else None


def _winner(values: Mapping[str, str]) -> tuple[str, str]:
    """Return the first name and its score; no name where it is no better than the data sheet."""
    name, score = next(iter(values.items()))
    return (name, score) if float(score) > 0.0 else ("", score)


def _orders(scores: "pd.DataFrame") -> dict[str, dict[str, dict[str, str]]]:
    """Return by scenario and track the scores of the estimators, best first; null and oracle, and skips, left out."""
    found: dict[str, dict[str, dict[str, str]]] = {}
    for track, plant in rankings(scores):
        means = run_scores(scores, track, plant).groupby("scenario").mean()
        for scenario, values in means.drop(columns=[NULL, ORACLE], errors="ignore").iterrows():
            best = values.dropna().sort_values(ascending=False)
            if len(best):
                own = found.setdefault(str(scenario), {})
                own[track] = {str(name): fixed(value) for name, value in best.items()}
    return found


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
            for name, text in ((name, runs.with_micro(value_text(v, metric.unit, scale))) for name, v in values.items())
        ]
        arrow = "↑" if metric.bigger_is_better else "↓"
        title = f"{metric_name} {arrow}{' *' if metric.primary else ''}"
        rows.append([breakable(title), metric.track, unit_text(shown_unit(metric.unit)), *cells])
    if rows:
        rows.sort(key=lambda row: TRACKS.index(row[1]))
        yield table(["metric", "track", "unit", *map(breakable, names)], rows, "lll" + "r" * len(names))
        yield note(
            "Means over the seeds that went well. ↓: smaller is better, ↑: bigger is better, *: counts in the score. "
            "Bold: nearest to ideal."
        )


def _biases(biases: "pd.DataFrame") -> Iterator[Block]:
    own = biases[~biases["estimator"].isin([NULL, ORACLE])]
    figures = []
    for key, group in own.groupby("parameter", sort=False):
        group = group.sort_values("bias", key=abs)
        parameter, truth = str(key), float(group["truth"].iloc[0])
        is_zero = abs(truth) <= NEGLIGIBLE * group["bias"].abs().max()
        factor, unit = (1.0, unit_text(unit_of(parameter))) if is_zero else (100.0 / abs(truth), "%")
        values = [float(value) for value in factor * group["bias"].to_numpy()]
        bounds = [(float(low), float(high)) for low, high in factor * group[["low", "high"]].to_numpy()]
        names = [str(name) for name in group["estimator"]]
        text, own_unit = quantity(parameter)
        shown = "0" if is_zero else number_text(truth, truth)
        title = f"{text}, truth {shown} {unit_text(own_unit)}".rstrip()
        texts = [f"{number_text(value, 0.0)} {unit}".rstrip() for value in values]
        figures.append(dots(title, names, values, bounds, texts=texts))
    if figures:
        yield note(
            f"Bias of each parameter: mean error over the seeds with its {LEVEL:.0%} t interval, in per cent of the "
            "true value where that is not 0; the smallest first."
        )
        yield Grid(figures)


def _counted(number: int, noun: str) -> str:
    """Return a number with its noun.

    >>> _counted(1, "seed"), _counted(3, "seed")
    ('1 seed', '3 seeds')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
