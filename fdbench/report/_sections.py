"""What the pages of a diagnosis and of its answer alone share: verdict, where the gap lies, causes, shrinkage."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fdbench.diagnosis.answer import judged_on
from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.report import diagnosis_text as words
from fdbench.report._figures import AFTER, BEFORE, SOFT, Style, bars, dots
from fdbench.report._page import Block, Figure, Grid, Html, Section, note, paragraph, table, tag
from fdbench.wording import percent, probability_text, public_text, quantity, si_text

PARTITIONS = {
    "motion": "Phase of motion",
    "frequency": "Frequency",
    "position": "Position",
    "velocity": "Velocity",
    "time": "Time",
    "channel": "Channel",
}


def lead(found: Diagnosis) -> Iterator[Html]:
    """Yield the verdict and what speaks against it."""
    for sentence in words.verdict(found):
        yield paragraph(tag("strong", sentence))
    doubts = list(words.doubts(found))
    if doubts:
        yield paragraph("Doubts:")
        yield tag("ul", *(tag("li", public_text(doubt)) for doubt in doubts))


def sections(found: Diagnosis) -> list[Section]:
    """Return where the gap lies, its causes, and how far it shrinks."""
    return [
        Section("Where the gap lies", list(_where(found.answer))),
        Section("Causes", list(_causes(found))),
        Section("How far the gap shrinks", list(_shrinkage(found.answer))),
    ]


def noise_floors(answer: Mapping[str, Any]) -> Html:
    """Return the table of the noise floor of each channel."""
    rows = [
        [
            quantity(name)[0],
            si_text(floor["value"], floor["unit"]),
            "measured from repeats" if floor["measured_from_repeats"] else "assumed from the quietest parts",
        ]
        for name, floor in answer["noise_floor"].items()
    ]
    return table(["channel", "noise floor", "origin"], rows, "lrl")


def _where(answer: Mapping[str, Any]) -> Iterator[Block]:
    yield note(
        "Shares of the mean squared gap of the re-calibrated model beyond the noise floor, all channels together, each "
        "in units of its floor. What the noise alone would give is set apart, so the shares of a figure add up to 1."
    )
    if "ci95" in answer["where"]:
        yield note("Thin lines: 95 % of resampled stretches of time.")
    figures = []
    for key, title in PARTITIONS.items():
        cells = words.cells_of(answer, key)
        if any(share > 0.0 for _, share in cells):
            names, shares = [name for name, _ in cells], [share for _, share in cells]
            figures.append(bars(title, names, shares, "share", bounds=_bounds(answer["where"], key)))
    yield Grid(figures) if figures else paragraph("Nothing is beyond the noise.")


def _bounds(where: Mapping[str, Any], key: str) -> list[list[float]]:
    """Return the intervals of the cells of a partition; none where the answer has none, as older ones."""
    cells = where[key]
    found = (
        [where.get("ci95", {}).get(key, {}).get(name) for name in cells]
        if isinstance(cells, Mapping)
        else [cell.get("ci95") for cell in cells]
    )
    return [] if None in found else found


def _causes(found: Diagnosis) -> Iterator[Block]:
    answer = found.answer
    causes = answer["causes"]
    names = [*(cause["effect"] for cause in causes), "something unknown", "no gap"]
    chances = [cause["probability"] for cause in causes]
    chances += [answer["unknown_probability"], answer["no_gap_probability"]]
    yield bars("Probability", names, chances, "probability", "Several effects may be present at once.")
    size = words.sizes(answer)[1]
    noise = min(1.0, 1.0 / size) if size > 0.0 else 1.0
    added = [cause for cause in causes if not words.is_parametric(cause)]
    yield bars(
        "What the mean squared gap consists of",
        [*(cause["effect"] for cause in added), "not explained", "noise"],
        [*(cause["share"] for cause in added), words.unexplained(answer), noise],
        "share of the mean squared gap after re-calibration",
        f"Judged on {judged_on(answer)}. What effects share is split by the mean over all orders.",
    )
    if answer["next_experiment"] is not None:
        yield from _experiment(answer["next_experiment"])
    if not causes:
        yield paragraph("No effect is named.")
        return
    rows = []
    for cause in causes:
        fixed = words.fixed_parameters(found, cause)
        for number, (name, value) in enumerate(cause["parameters"].items()):
            text, _ = quantity(name)
            known = "typical, not fitted" if name in fixed else _interval(value)
            shown = si_text(value["value"], value["unit"])
            rows.append([cause["effect"] if number == 0 else "", text, shown, known])
    yield table(["effect", "parameter", "value", "95 % interval"], rows, "llrl")
    yield table(
        ["effect", "probability", "share", "share of its own", "cannot be told apart from"],
        [
            [
                cause["effect"],
                probability_text(cause["probability"]),
                percent(cause["share"]),
                percent(words.unique(cause)),
                ", ".join(cause["indistinguishable_from"]) or "–",
            ]
            for cause in causes
        ],
        "lrrrl",
    )


def _experiment(experiment: Mapping[str, Any]) -> Iterator[Block]:
    pair = " from ".join(experiment["to_separate"])
    motion = experiment.get("motion", experiment["trajectory"])
    file = f" ({experiment['trajectory']})" if motion not in experiment["trajectory"] else ""
    yield paragraph(f"Next experiment, to separate {pair}: {motion}{file}")
    if "separates" not in experiment:
        return
    low, high = (si_text(bound, "m") for bound in experiment["position_m"])
    chance = experiment["expected_probability"]
    rows = [
        ["where", f"{low} to {high}"],
        ["amplitude", si_text(experiment["amplitude_m"], "m")],
        ["fastest", si_text(experiment["velocity_m_per_s"], "m/s")],
        ["hardest", si_text(experiment["acceleration_m_per_s2"], "m/s²")],
        ["lasts", si_text(experiment["duration_s"], "s")],
        [
            "probability of the true cause, expected",
            f"{probability_text(chance['now'])} now, {probability_text(chance['after'])} after it",
        ],
        ["gain for each second of the machine", f"{experiment['expected_gain_per_s']:.2g}"],
        *(
            [f"{' from '.join(item['effects'])}, expected", f"{item['expected_log_odds']:.3g} of log odds"]
            for item in experiment["separates"]
        ),
    ]
    yield table(["next experiment", ""], rows, "lr")


def _interval(value: Mapping[str, Any]) -> str:
    if value["ci95"] is None:
        return "not computed"
    return " to ".join(si_text(bound, value["unit"]) for bound in value["ci95"])


def _shrinkage(answer: Mapping[str, Any]) -> Iterator[Block]:
    paper, size = words.sizes(answer)
    steps = answer["shrinkage"]["steps"]
    names = ["on paper", "re-calibrated", *(f"+ {step['added']}" for step in steps), "noise alone"]
    values = np.array([paper, size, *(step["after"] for step in steps), 1.0])
    none = (math.nan, math.nan)
    intervals = [(step["before"] * (1.0 - step["ci95"][1]), step["before"] * (1.0 - step["ci95"][0])) for step in steps]
    bounds = np.array([none, none, *intervals, none])
    styles = {name: AFTER if name.startswith("+") else BEFORE for name in names} | {"noise alone": Style(colour=SOFT)}
    title = "Mean squared gap in units of the noise floor"
    caption = f"Judged on {judged_on(answer)}. Bars: 95 % of resampled stretches of time, for the step alone."
    figure = dots(title, names, values, bounds, styles, "mean squared gap / noise floor")
    yield Figure(title=title, traces=figure.traces, layout=figure.layout, height_px=figure.height_px, caption=caption)
    yield tag("ul", *(tag("li", sentence) for sentence in words.shrinkage(answer)))
    rows = [
        [
            quantity(name)[0],
            *(si_text(channel[key], channel["unit"]) for key in ("before", "recalibrated", "repaired", "noise_floor")),
            percent(channel["reduction"]),
        ]
        for name, channel in answer["gap"]["channels"].items()
    ]
    header = ["channel", "on paper", "re-calibrated", "repaired", "noise floor", "mean square less"]
    yield paragraph("Gap of each channel, root mean square:")
    yield table(header, rows, "lrrrrr")
