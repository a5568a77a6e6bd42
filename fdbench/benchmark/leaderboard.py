"""The text of leaderboard.md: a function of the stored rows alone, without dates, times or paths."""

import difflib
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.seal import Seal, read_seal
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.statistics import (
    LEVEL,
    RESAMPLES,
    Interval,
    Standing,
    Trouble,
    parameter_bias,
    rankings,
    run_statuses,
    seed_means,
    standings,
    troubles,
    unranked,
    unused,
)
from fdbench.benchmark.store import OK, SKIPPED, Store
from fdbench.errors import FdbenchError
from fdbench.files import VARIANT_NAME
from fdbench.metrics import metrics
from fdbench.scenario import TRACKS
from fdbench.units import TIMES, time_text, unit_of
from fdbench.wording import markdown_text, public_text

if TYPE_CHECKING:
    import pandas as pd

DECADES_TEXT = ", ".join(f"{m.decades:g} for {m.name}" for m in map(metrics.get, metrics.names()) if m.primary)

SCORE = f"""\
One ranking for each track and kind of plant, of the estimators that apply to one of its scenarios. Every seed is
another machine under another disturbance, drawn about a data sheet, which is all that an estimator is told. Score of a
run: mean over the primary metrics of the track (`*` below) of log10(error of null / error) / D, clipped to [-1, 1],
with D = {DECADES_TEXT}: each
tenfold smaller error is worth 1 / D more. `null` knows the data sheet and has learnt nothing beyond it; its error is
the geometric mean over the seeds, so that its score is about 0. `oracle` knows the truth and has the score 1. A failed
or diverged run has each metric's worst value, a skipped one scores 0. Tracks: `parameters` of the plant's model; the
`disturbance` force within the record; `output`, a free run from the command alone, in a motion that the estimator has
not seen, against the undisturbed response without noise. Score of an estimator: interquartile mean over its runs, each
scenario with the same weight; {LEVEL:.0%} interval by {RESAMPLES} bootstrap resamples of the seeds within scenarios.
Estimators share a rank where the interval of the paired difference to the first of that rank holds 0. What was ok
nowhere has no rank."""

NOTES = f"""\
Means over the seeds that went well. `↓`: smaller is better, `↑`: bigger is better, `*`: the score rests on it. Bias:
mean error over the seeds ± half of its {LEVEL:.0%} t interval, in per cent of the true value or, where that is 0, in
the parameter's unit."""


class Erratum(NamedTuple):
    """What was wrong with released scenarios or scores: found for a suite version, in ids of these patterns."""

    version: str
    text: str
    concerns: tuple[str, ...]


# Newest first.
ERRATA = (
    Erratum(
        "0.2.0",
        "in the disturbance track of BallScrewAxis-v1 nothing is to be learnt: the waves of its force are above what "
        "rows of 2 ms hold, and its mean passes for friction. In -v2 the tool is another one.",
        (r"BallScrewAxis-v1",),
    ),
    Erratum(
        "0.2.0",
        "in DriveCurrentClosed up to -v1 the gains in newtons are exact, so that the loop's equation tells the "
        "disturbance; in SlotMilling up to -v1 the force is read without noise and tells the parameters exactly. -v2 "
        "mends both. No estimator listed here used it.",
        (r"DriveCurrentClosed-v[01]", r"SlotMilling\w*-v[01]"),
    ),
    Erratum(
        "0.2.0",
        "in the velocity loops up to -v1 (Milling, Shaker) the position is read without noise, and the way of a sample "
        "tells the parameters exactly; from -v2 on it is read from a scale. No estimator listed here used it.",
        (r"(Milling|Shaker)\w*-v[01]",),
    ),
    Erratum(
        "0.2.0",
        "until then the machine of every seed was the nominal one, which estimators were told; scores were linear "
        "between null and oracle; output was in sample. The scenarios of that time are the published trials now.",
        (),
    ),
)

DIGITS = 3
# Scenarios that a line names one by one.
MOST_NAMED = 4
# Share of the null's value below which a number is rounding error and printed as 0.
NEGLIGIBLE = 1e-10


def leaderboard(store: Store) -> str:
    """Return the text of leaderboard.md for the results of a folder.

    Raises
    ------
    FdbenchError
        If there are none, they are of several versions of one thing (see `check_mergeable`), or a name is none.
    """
    scores = store.scores()
    check_mergeable(scores)
    parameters = store.parameters()
    for column in ("scenario", "estimator", "plant", "metric", "parameter"):
        table = parameters if column == "parameter" else scores
        if wrong := [name for name in table[column].unique() if not VARIANT_NAME.fullmatch(name)]:
            raise FdbenchError(f"{store.folder}: column {column} holds '{wrong[0]}', which is no name.")
    return "\n".join(_lines(scores, parameters, read_seal(store.folder))) + "\n"


def difference(text: str, path: str | Path) -> str:
    """Return how a file differs from the text it should have, as a unified diff; empty if it does not."""
    file = Path(path)
    present = file.read_text("utf-8", errors="replace") if file.is_file() else ""
    lines = difflib.unified_diff(present.splitlines(), text.splitlines(), str(path), "as generated", lineterm="", n=1)
    return "\n".join(lines)


def check_mergeable(scores: "pd.DataFrame") -> None:
    """Check that rows which are put into one table belong together.

    Raises
    ------
    FdbenchError
        If a scenario, or an estimator in a scenario, has rows of different digests, if rows are of different suite
        versions, or if a run is there twice.
    """
    for version in ("fdbench_version", "code_digest", "nonce"):
        found = sorted(scores[version].unique())
        if len(found) > 1:
            raise FdbenchError(f"scores: rows of different {version}: {', '.join(found)}. Run them all again.")
    for keys, column in ((["scenario"], "scenario_digest"), (["scenario", "estimator"], "estimator_digest")):
        for name, group in scores.groupby(keys):
            found = sorted(group[column].unique())
            if len(found) > 1:
                whose = ", estimator ".join(str(part) for part in name)
                short = ", ".join(text[:12] for text in found)
                raise FdbenchError(
                    f"scores: scenario {whose} has rows of different {column} ({short}), which are different things "
                    "under one name and must not be compared. Run them all again, or use a new folder."
                )
    twice = scores[scores.duplicated(["scenario", "estimator", "seed", "metric"])]
    if len(twice):
        row = twice.iloc[0]
        raise FdbenchError(f"scores: {row.scenario}, {row.estimator}, seed {row.seed}, {row.metric} is there twice.")


def _lines(scores: "pd.DataFrame", parameters: "pd.DataFrame", seal: Seal | None) -> Iterator[str]:
    yield "# Leaderboard"
    yield ""
    version = markdown_text(scores["fdbench_version"].iloc[0])
    yield f"Suite version {version}. Written by `fdbench leaderboard`, not to be edited."
    yield ""
    yield from _sealing(scores, seal)
    yield ""
    yield SCORE
    shown = ""
    for track, plant in rankings(scores):
        if track != shown:
            yield from ["", f"## Track: {track}"]
            shown = track
        yield from ["", f"### {track}: {plant}", ""]
        yield from _ranking(standings(scores, track, plant))
        for text in (unranked_text(scores, track, plant), unused_text(scores, track, plant)):
            yield from ["", text] if text else []
    yield ""
    yield "## Scenarios"
    yield ""
    yield NOTES
    means, biases, statuses = seed_means(scores), parameter_bias(parameters), run_statuses(scores)
    for scenario, own in scores.groupby("scenario"):
        yield ""
        yield f"### {scenario}"
        yield ""
        yield f"{seeds_of(own)}, digest `{own['scenario_digest'].iloc[0][:12]}`."
        if not (own["status"] == OK).any():
            yield "No run went well; see below."
        yield from _metric_table(means[means.index.get_level_values("scenario") == scenario].droplevel("scenario"))
        yield from _bias_table(biases[biases["scenario"] == scenario])
    found = troubles(statuses)
    yield from ["", "## Failed runs", ""]
    yield from _failures([trouble for trouble in found if trouble.status != SKIPPED])
    yield from ["", "## Skipped runs", ""]
    yield from _skips([trouble for trouble in found if trouble.status == SKIPPED], scores["scenario"].nunique())
    yield from ["", "## Errata", ""]
    yield from [f"- {erratum.version}: {erratum.text}" for erratum in ERRATA]


def _sealing(scores: "pd.DataFrame", seal: Seal | None) -> Iterator[str]:
    nonce = markdown_text(str(scores["nonce"].iloc[0]))
    if not nonce:
        yield "Seeds are public: an estimator can have been made for them. `fdbench run --sealed` draws secret ones."
        return
    yield f"Sealed: the seeds follow from the nonce `{nonce}`."
    if seal is None or seal.nonce != nonce:
        yield "They repeat those of another run; no digest was written down before the nonce was drawn."
        return
    yield f"It was drawn after these digests were written down, at commit `{seal.commit or 'unknown'}`, code"
    yield f"`{seal.code_digest[:12]}`; `fdbench verify` repeats a sample of the runs."
    yield ""
    yield from _table(["estimator", "digest"], [[f"`{n}`", f"`{d[:16]}`"] for n, d in seal.estimators.items()], "ll")


def _ranking(ranking: Sequence[Standing]) -> Iterator[str]:
    rows = [
        [
            "" if line.rank is None else str(line.rank),
            f"`{line.estimator}`",
            fixed(line.score.value),
            interval_text(line.score),
            f"{line.scenarios} of {line.of_scenarios}",
            str(line.failures),
        ]
        for line in ranking
    ]
    yield from _table(["rank", "estimator", "score", f"{LEVEL:.0%} interval", "scenarios", "failures"], rows, "rlrlrr")


def _metric_table(means: "pd.DataFrame") -> Iterator[str]:
    present = means.dropna(axis="columns", how="all")
    estimators = _references_last([str(name) for name in present])
    for track in TRACKS:
        rows = []
        for name in present.index:
            metric = metrics.get(str(name))
            if metric.track == track:
                values = [float(present.loc[name, estimator]) for estimator in estimators]
                scale = float(present.loc[name, NULL]) if NULL in present else math.nan
                title = f"{name} {'↑' if metric.bigger_is_better else '↓'}{' *' if metric.primary else ''}"
                cells = [value_text(value, metric.unit, scale) for value in values]
                rows.append([title, shown_unit(metric.unit), *cells])
        if rows:
            yield ""
            yield from _table([track, "unit", *estimators], rows, "ll" + "r" * len(estimators))


def _bias_table(biases: "pd.DataFrame") -> Iterator[str]:
    own = biases[~biases["estimator"].isin([NULL, ORACLE])]
    estimators = sorted(own["estimator"].unique())
    rows = []
    for name, group in own.groupby("parameter", sort=False):
        truth = float(group["truth"].iloc[0])
        scale = 100.0 / abs(truth) if truth else 1.0
        widths = group["high"] - group["low"]
        cells = {
            str(estimator): _bias(float(bias), float(width), scale)
            for estimator, bias, width in zip(group["estimator"], group["bias"], widths, strict=True)
        }
        unit = unit_of(str(name))
        rows.append(
            [str(name), number_text(truth, truth), "%" if truth else unit, *(cells.get(e, "–") for e in estimators)]
        )
    if rows:
        yield ""
        yield from _table(["bias", "truth", "in", *estimators], rows, "lrl" + "r" * len(estimators))


def _bias(bias: float, width: float, scale: float) -> str:
    half = "" if math.isnan(width) else f" ± {_percent(0.5 * width * scale)}"
    return _percent(bias * scale) + half


def _percent(value: float) -> str:
    return fixed(value, 2) if abs(value) < 1e4 else f"{value:.{DIGITS}g}"


def _failures(found: Sequence[Trouble]) -> Iterator[str]:
    rows = [
        [line.scenario, line.estimators, line.seeds, line.status, markdown_text(public_text(line.reason))]
        for line in found
    ]
    if rows:
        yield from _table(["scenario", "estimators", "seeds", "status", "reason"], rows, "lllll")
    else:
        yield "None."


def _skips(found: Sequence[Trouble], n_scenarios: int) -> Iterator[str]:
    """Yield a line for each reason and set of estimators; many scenarios are counted, and seeds left out."""
    scenarios: dict[tuple[str, str], list[str]] = {}
    for line in found:
        reason = markdown_text(public_text(line.reason))
        scenarios.setdefault((reason, line.estimators), []).append(line.scenario)
    rows = [
        [reason, names, ", ".join(where) if len(where) <= MOST_NAMED else f"{len(where)} of {n_scenarios}"]
        for (reason, names), where in sorted(scenarios.items())
    ]
    if rows:
        yield from _table(["reason", "estimators", "scenarios"], rows, "lll")
    else:
        yield "None."


def _references_last(names: Sequence[str]) -> list[str]:
    return sorted(names, key=lambda name: (name in (NULL, ORACLE), name))


def _table(header: Sequence[str], rows: Sequence[Sequence[str]], alignment: str) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield f"| {' | '.join('---:' if side == 'r' else '---' for side in alignment)} |"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"


def fixed(value: float, digits: int = DIGITS) -> str:
    """Return a number with digits behind the point, and no sign where they are all 0."""
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def interval_text(interval: Interval) -> str:
    """Return ``low to high``, or a dash where no interval is known."""
    return "–" if math.isnan(interval.low) else f"{fixed(interval.low)} to {fixed(interval.high)}"


def unranked_text(scores: "pd.DataFrame", track: str, plant: str) -> str:
    """Return a sentence on the estimators that lack runs of a ranking, or an empty text."""
    names = unranked(scores, track, plant)
    return f"Not ranked, as runs that the others have are missing: {', '.join(names)}." if names else ""


def unused_text(scores: "pd.DataFrame", track: str, plant: str) -> str:
    """Return a sentence on the metrics that a ranking does not rest on in some scenario, or an empty text."""
    found = unused(scores, track, plant)
    listed = ", ".join(f"{metric} in {scenario}" for scenario, metric in found)
    return f"Not used, as knowing the truth gains nothing on knowing the data sheet: {listed}." if found else ""


def seeds_of(own: "pd.DataFrame") -> str:
    """Return how many seeds the estimators of a scenario were run with."""
    counts = own.groupby("estimator")["seed"].nunique()
    few, many = int(counts.min()), int(counts.max())
    return f"{many} {'seed' if many == 1 else 'seeds'}" if few == many else f"{few} to {many} seeds"


def number_text(value: float, scale: float) -> str:
    """Return a number with three significant digits; 0 where it is rounding error beside ``scale``.

    >>> number_text(0.123456, 1.0), number_text(3e-17, 1.0), number_text(1234.5, 1.0), number_text(math.nan, 1.0)
    ('0.123', '0', '1230', '–')
    """
    if math.isnan(value):
        return "–"
    return "0" if abs(value) <= NEGLIGIBLE * abs(scale) else f"{float(f'{value:.{DIGITS}g}'):g}"


def value_text(value: float, unit: str, scale: float) -> str:
    """Return the value of a metric as `number_text`; a time has a unit of its own, and its column none.

    >>> value_text(2.54e-5, "s", 1.0), value_text(2.54, "%", 1.0), value_text(0.0, "s", 1.0)
    ('25.4 us', '2.54', '0')
    """
    text = number_text(value, scale)
    return time_text(value, unit) if unit in TIMES and text not in ("–", "0") else text


def shown_unit(unit: str) -> str:
    """Return the unit that stands beside values of `value_text`."""
    return "" if unit in TIMES else unit
