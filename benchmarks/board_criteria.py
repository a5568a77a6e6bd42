"""How well a board tells estimators apart: `python benchmarks/board_criteria.py RESULTS`.

Of a folder of results: whether any row is above the oracle, whether each scenario is in a ranking, in how many rankings
of one scenario the three best are alike, how far three families are apart on the shaker trials, and how many runs are
skipped.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.statistics import rankings, run_scores, run_statuses, standings
from fdbench.benchmark.store import SKIPPED, Store
from fdbench.scenario import TRACKS

ALIKE = 0.01
FAMILIES = ("pl_lssvm", "krls_t", "least_squares")
SHAKER = "Shaker"


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


def listed(names: list[str]) -> str:
    return f": {', '.join(names)}" if names else ""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    for line in report(parser.parse_args().results):
        print(line)
