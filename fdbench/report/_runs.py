"""How the runs of a page of results went: failures, speed, provenance."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fdbench.benchmark.statistics import Trouble, troubles
from fdbench.benchmark.store import FAILED, OK, PROVENANCE, SKIPPED
from fdbench.report._figures import style_of
from fdbench.report._page import breakable, folded, paragraph, table
from fdbench.report._templates import Html, part
from fdbench.units import time_text
from fdbench.wording import public_text, unit_text

if TYPE_CHECKING:
    import pandas as pd

SPEED = "microseconds_per_sample"
SHORT_DIGEST = 12


def troubles_of(scores: "pd.DataFrame", statuses: "pd.DataFrame") -> Iterator[Html]:
    """Yield the runs that failed or were skipped, with their reasons."""
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


def speed(scores: "pd.DataFrame") -> Iterator[Html]:
    """Yield the time of a fit for each sample."""
    good = scores[(scores["metric"] == SPEED) & (scores["status"] == OK)]
    if good.empty:
        yield paragraph("No run has a time.")
        return
    medians = good.pivot_table(index="scenario", columns="estimator", values="value", aggfunc="median")
    rows = [
        [str(scenario), *("–" if math.isnan(value) else with_micro(time_text(value, "us")) for value in values)]
        for scenario, values in zip(medians.index, medians.to_numpy(), strict=True)
    ]
    header = ["scenario", *(part("named", breakable(str(name)), style_of(str(name))) for name in medians)]
    yield paragraph("Time of a fit for each sample, compilation apart: median over the seeds.")
    yield table(header, rows, "l" + "r" * len(medians.columns))


def with_micro(time: str) -> str:
    """Return a time with its unit as it is printed."""
    return time.replace(" us", f" {unit_text('us')}")


def provenance(scores: "pd.DataFrame") -> Iterator[Html]:
    """Yield what the results come from."""
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
