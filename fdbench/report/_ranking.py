"""The table of estimators and tracks: who wins where, by how much, and what failed."""

import base64
import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from fdbench.benchmark.leaderboard import SCORE, fixed, interval_text, unranked_text
from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.statistics import LEVEL, Standing, rankings, run_statuses, standings
from fdbench.benchmark.store import DIVERGED, FAILED
from fdbench.benchmark.variant import registered
from fdbench.metrics import metrics
from fdbench.report._figures import style_of
from fdbench.report._page import breakable, folded, note, slug
from fdbench.report._templates import Html, part
from fdbench.scenario import TRACKS

if TYPE_CHECKING:
    import pandas as pd

LOWEST = -1.0 / 3.0  # score at the left end of a bar; lower ones are cut off
MOST_NAMED = 2  # winners of one track

Rankings = Mapping[tuple[str, str], Sequence[Standing]]


def all_rankings(scores: "pd.DataFrame") -> Rankings:
    """Return the ranking of each track and kind of plant."""
    return {(track, plant): standings(scores, track, plant) for track, plant in rankings(scores)}


def winners(found: Rankings) -> Iterator[Html]:
    """Yield a sentence for each kind of plant: who wins in which track, and how near to the truth."""
    for plant in dict.fromkeys(plant for _, plant in found):
        sentences = []
        for track in TRACKS:
            first = [line for line in found.get((track, plant), ()) if line.rank == 1]
            if not first:
                continue
            best = first[0].score
            names: list[str] = [part("strong", line.estimator) for line in first]
            if math.isnan(best.low) or len(first) > MOST_NAMED:
                names = names[:1]
            also = f" and {len(first) - 1} more" if len(first) > MOST_NAMED and not math.isnan(best.low) else ""
            who = _listed(names) + also if best.value > 0.0 else "nobody"
            sentences.append(part("win", track, who, error_text(best.value, decades(track))))
        if sentences:
            yield part("wins", plant, Html(", ").join(sentences))


def _listed(names: Sequence[str]) -> Html:
    """Return names of equals."""
    return Html(" and ").join([Html(", ").join(names[:-1]), names[-1]] if len(names) > 1 else names)


def decades(track: str) -> float:
    """Return how many tenfold steps below the data sheet's error stand for a score of 1, in the mean of a track."""
    own = [metric.decades for metric in map(metrics.get, metrics.names()) if metric.track == track and metric.primary]
    return sum(own) / len(own)


def error_text(score: float, steps: float) -> str:
    """Return what a score means as an error beside that of the data sheet.

    >>> error_text(1.0, 3.0), error_text(0.5, 2.0), error_text(-0.1, 3.0), error_text(1e-3, 3.0)
    ('1/1000 of its error', '1/10 of its error', '2 times its error', 'its error')
    """
    ratio = 10.0 ** (steps * abs(score))
    words = f"{ratio:.2g}" if ratio < 100.0 else f"{float(f'{ratio:.2g}'):.0f}"
    if words == "1":
        return "its error"
    return f"1/{words} of its error" if score >= 0.0 else f"{words} times its error"


def ranking_tables(scores: "pd.DataFrame", found: Rankings) -> Iterator[Html]:
    """Yield the table of estimators and tracks, with what is needed to read it below."""
    tracks = [track for track in TRACKS if any(own == track for own, _ in found)]
    failed = run_statuses(scores)
    failed = failed[failed["status"].isin([FAILED, DIVERGED])]
    plant_of = dict(zip(scores["scenario"], scores["plant"], strict=True))
    counts = failed.groupby([failed["scenario"].map(plant_of), "estimator"]).size()
    groups = []
    for plant in dict.fromkeys(plant for _, plant in found):
        lines = {track: {line.estimator: line for line in found.get((track, plant), ())} for track in tracks}
        names = dict.fromkeys(name for own in lines.values() for name in own)
        rows = [
            {
                "name": name,
                "shown": breakable(name),
                "style": style_of(name),
                "id": f"rank-{slug(plant)}-{slug(registered(name))}{name.removeprefix(registered(name))}",
                "is_reference": name in (NULL, ORACLE),
                "cells": [_cell(lines[track].get(name), decades(track)) for track in tracks],
                "failures": int(counts.get((plant, name), 0)),
            }
            for name in sorted(names, key=lambda name: (name in (NULL, ORACLE), *_places(lines, name)))
        ]
        n_scenarios = max(line.of_scenarios for own in lines.values() for line in own.values())
        axes = [_axis(decades(track)) if lines[track] else [] for track in tracks]
        groups.append({"plant": plant, "scenarios": n_scenarios, "rows": rows, "axes": axes})
    yield part("ranking", tracks, groups, _download(found))
    yield note(
        "Bars are on a logarithmic axis of the error: from that of the data sheet, which is all that an estimator is "
        "told, towards the truth; to the left of it one is worse than not having measured. Fine lines: "
        f"{LEVEL:.0%} intervals; bold: nobody is better beyond chance; ×: runs that failed or diverged. null is the "
        "data sheet, oracle knows the truth."
    )
    if all(math.isnan(line.score.low) for ranking in found.values() for line in ranking):
        yield note("One seed: no interval is known, and what is first may be so by chance.")
    for track, plant in found:
        if text := unranked_text(scores, track, plant):
            yield note(f"{track}, {plant}: {text}")
    yield folded("How a score is made", note(SCORE))


def _places(lines: Mapping[str, Mapping[str, Standing]], name: str) -> list[float]:
    """Return what rows are sorted by: the first track first, and what is in none of its ranking behind."""
    return [-own[name].score.value if name in own else math.inf for own in lines.values()]


def _cell(line: Standing | None, steps: float) -> dict[str, object] | None:
    if line is None:
        return None
    low, value, high = (_place(score) for score in (line.score.low, line.score.value, line.score.high))
    zero = _place(0.0)
    covers = "" if line.scenarios == line.of_scenarios else f", {line.scenarios} of {line.of_scenarios} scenarios"
    interval = interval_text(line.score)
    return {
        "value": fixed(line.score.value),
        "bar": (min(zero, value), round(abs(value - zero), 2)),
        "interval": None if math.isnan(low) else (low, round(high - low, 2)),
        "is_below": line.score.value < 0.0,
        "is_best": line.rank == 1 and not math.isnan(low),
        "marks": [place for place, _ in _axis(steps)],
        "words": f"beside the data sheet {error_text(line.score.value, steps)}; score {interval}{covers}",
    }


def _place(score: float) -> float:
    """Return where a score stands, in per cent of the bar; NaN stays."""
    return round(100.0 * (max(score, LOWEST) - LOWEST) / (1.0 - LOWEST), 2)


def _axis(steps: float) -> list[tuple[float, str]]:
    """Return the places of tenfold steps below the data sheet's error."""
    return [(_place(step / steps), f"1/{10**step}" if step else "1") for step in range(math.floor(steps) + 1)]


def _download(found: Rankings) -> str:
    """Return all rankings as the address of a CSV file that lies in the page."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(
        ["plant", "track", "rank", "estimator", "score", "low", "high", "scenarios", "of_scenarios", "failures"]
    )
    for (track, plant), ranking in found.items():
        for line in ranking:
            numbers = ("" if math.isnan(value) else f"{value:.6g}" for value in vars(line.score).values())
            rest = (line.scenarios, line.of_scenarios, line.failures)
            writer.writerow([plant, track, line.rank or "", line.estimator, *numbers, *rest])
    return f"data:text/csv;base64,{base64.b64encode(file.getvalue().encode()).decode('ascii')}"
