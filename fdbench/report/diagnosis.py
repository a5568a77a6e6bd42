"""The page of a diagnosis: verdict, gap over time, position and frequency, where it lies, causes, shrinkage, rivals."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fdbench.benchmark.leaderboard import public_text
from fdbench.gap import summary as words
from fdbench.gap.diagnose import Diagnosis
from fdbench.gap.hypothesis import calibrations
from fdbench.gap.repaired import model_text
from fdbench.gap.replay import Replay
from fdbench.gap.runs import Run, differences
from fdbench.gap.search import SMALLEST_GAIN, Stage
from fdbench.record import FloatArray
from fdbench.report._figures import (
    GRID,
    INK,
    SOFT,
    TRUTH,
    Panel,
    Style,
    axis,
    dots,
    labelled,
    layout,
    line,
    plain,
    quantity,
    scaled,
    stack,
    unit_text,
)
from fdbench.report._page import Block, Figure, Grid, Html, Section, folded, note, paragraph, table, tag, write_page
from fdbench.report._series import opening_range, peak, thinned

MOST_RUNS = 6
POINTS_OF_ALL_RUNS, MOST_POINTS = 12_000, 3000
N_BINS = 120
SEGMENT = 4096  # samples of Welch's method
SEEN_RIVALS = 8
BAR_PX = 24
BEFORE, AFTER = Style(colour="var(--series-0)"), Style(colour="var(--series-1)")
BEFORE_NAME, AFTER_NAME = "simulated, re-calibrated", "simulated, repaired"
PARTITIONS = {
    "motion": "Phase of motion",
    "frequency": "Frequency",
    "position": "Position",
    "velocity": "Velocity",
    "time": "Time",
    "channel": "Channel",
}


def write_diagnosis(found: Diagnosis, path: str | Path) -> None:
    """Write a diagnosis as one HTML file that works offline.

    Parameters
    ----------
    found : Diagnosis
    path : path

    Raises
    ------
    FdbenchError
        If the file cannot be written.
    """
    gaps = _Gaps(found)
    sections = [
        Section("Gap over time", list(gaps.over_time())),
        Section("Gap over position", list(gaps.over_position())),
        Section("Spectrum of the gap", list(gaps.spectra())),
        Section("Where the gap lies", list(_where(found.answer))),
        Section("Causes", list(_causes(found))),
        Section("How far the gap shrinks", list(_shrinkage(found.answer))),
        Section("Rivals", list(_rivals(found.stages))),
        Section("Records, noise floor and re-calibration", list(_basis(found))),
        Section("Repaired model", [tag("div", tag("pre", model_text(found)), kind="wide")]),
    ]
    write_page(Path(path), "fdbench: diagnosis of a gap", list(_lead(found)), [one for one in sections if one.blocks])


def _lead(found: Diagnosis) -> Iterator[Html]:
    for sentence in words.verdict(found):
        yield paragraph(tag("strong", sentence))
    doubts = list(words.doubts(found))
    if doubts:
        yield paragraph("Doubts:")
        yield tag("ul", *(tag("li", public_text(doubt)) for doubt in doubts))


# ---- the gap itself ----


@dataclass(frozen=True, eq=False)
class _Gaps:
    """Measured, re-calibrated and repaired channels of all runs."""

    found: Diagnosis

    @cached_property
    def repaired(self) -> list[dict[str, FloatArray]]:
        nominal = self.found.final.nominal
        replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
        variant = self.found.final.variant()
        simulated = (replay.simulate(run, [variant]) for run in self.runs)
        return [{name: values[0] for name, values in channels.items()} for channels in simulated]

    @property
    def channels(self) -> list[str]:
        return list(self.runs[0].channels)

    @property
    def runs(self) -> Sequence[Run]:
        return self.found.split.runs

    def of(self, channel: str) -> tuple[list[FloatArray], list[FloatArray]]:
        """Return the gap of each run before and after the repair."""
        return (
            [run.channels[channel] - own[channel] for run, own in zip(self.runs, self.found.simulated, strict=True)],
            [run.channels[channel] - own[channel] for run, own in zip(self.runs, self.repaired, strict=True)],
        )

    def over_time(self) -> Iterator[Block]:
        runs = self.runs
        if len(runs) > MOST_RUNS:
            yield note(f"The first {MOST_RUNS} of {len(runs)} records.")
        n_points = min(MOST_POINTS, POINTS_OF_ALL_RUNS // min(len(runs), MOST_RUNS))
        for index, run in enumerate(runs[:MOST_RUNS]):
            panels = [panel for channel in self.channels for panel in self._panels(index, channel, n_points)]
            held_out = float(self.found.split.held_out[index].mean())
            caption = (
                f"Dashed: twice the noise floor. Not fitted, but judged on: {words.percent(held_out)} of the samples."
            )
            yield stack(Path(run.name).name, panels, "time (s)", caption)

    def _panels(self, index: int, channel: str, n_points: int) -> Iterator[Panel]:
        run, text = self.runs[index], quantity(channel)[0]
        time_s = run.period_s * np.arange(run.n_samples, dtype=np.float64)
        measured = run.channels[channel]
        before, after = self.found.simulated[index][channel], self.repaired[index][channel]
        factor, unit = scaled(quantity(channel)[1], peak([measured]))

        def curve(name: str, values: FloatArray, style: Style, width: float = 1.2) -> dict[str, Any]:
            return line(name, *thinned(time_s, values, n_points), style, width=width)

        yield Panel(
            y_title=labelled(text, unit),
            traces=[
                curve("measured", factor * measured, Style(colour=TRUTH), 3.0),
                curve(BEFORE_NAME, factor * before, BEFORE),
                curve(AFTER_NAME, factor * after, AFTER),
            ],
            height_px=180,
        )
        gaps = measured - before, measured - after
        factor, unit = scaled(quantity(channel)[1], peak(gaps))
        level = 2.0 * factor * self.found.split.floors[channel].rms / math.sqrt(run.repeats)
        ends = time_s[[0, -1]]
        floor = Style(colour=SOFT, dash="dash")
        yield Panel(
            y_title=labelled("gap", unit),
            traces=[
                curve(BEFORE_NAME, factor * gaps[0], BEFORE),
                curve(AFTER_NAME, factor * gaps[1], AFTER),
                *(line("noise floor", ends, np.full(2, side * level), floor) for side in (-1.0, 1.0)),
            ],
            y_range=opening_range([factor * gap for gap in gaps]),
            height_px=220,
        )

    def over_position(self) -> Iterator[Block]:
        yield note(
            "Mean gap at each commanded position while the axis moves, forwards and backwards, over all records."
        )
        yield from (self._profile(channel) for channel in self.channels)

    def _profile(self, channel: str) -> Figure:
        position, velocity, _ = np.concatenate([run.reference for run in self.runs]).T
        both = [np.concatenate(gaps) for gaps in self.of(channel)]
        edges = np.linspace(float(position.min()), float(position.max()) + 1e-12, N_BINS + 1)
        moving = np.abs(velocity) > 1e-3 * np.abs(velocity).max()
        factor, unit = scaled(quantity(channel)[1], peak(both))
        traces = []
        for gap, style, name in zip(both, (BEFORE, AFTER), (BEFORE_NAME, AFTER_NAME), strict=True):
            for side, direction, dash in ((1.0, "forwards", "solid"), (-1.0, "backwards", "dot")):
                chosen = moving & (side * velocity > 0.0)
                place = np.searchsorted(edges, position[chosen], side="right") - 1
                counts = np.bincount(place, minlength=N_BINS).astype(np.float64)
                sums = np.bincount(place, weights=gap[chosen], minlength=N_BINS)
                mean = np.divide(sums, counts, out=np.full(N_BINS, np.nan), where=counts > 0.0)
                own = Style(colour=style.colour, dash=dash)
                traces.append(line(f"{name}, {direction}", 0.5 * (edges[1:] + edges[:-1]), factor * mean, own))
        text = quantity(channel)[0]
        return Figure(
            title=text.capitalize(),
            traces=traces,
            layout=layout(axis("position (m)"), axis(labelled("mean gap", unit))),
            height_px=360,
        )

    def spectra(self) -> Iterator[Block]:
        yield note(f"Welch's method: Hann's window, segments of up to {SEGMENT} samples, mean over all records.")
        yield from (self._spectrum(channel) for channel in self.channels)

    def _spectrum(self, channel: str) -> Figure:
        period_s = self.runs[0].period_s
        length = min(SEGMENT, *(run.n_samples for run in self.runs))
        before, after = (_decibels(_density(gaps, period_s, length)) for gaps in self.of(channel))
        traces = [line(BEFORE_NAME, *before, BEFORE), line(AFTER_NAME, *after, AFTER)]
        floor = self.found.split.floors[channel]
        repeats = [item for item in differences(self.runs, channel) if len(item) >= length]
        style = Style(colour=INK, dash="dash")
        if floor.measured and repeats:
            frequency, density = _density(repeats, period_s, length)
            traces.append(line("noise floor", *_decibels((frequency, 0.5 * density)), style))
            caption = "Noise floor: half the density of the differences between repeats."
        else:
            ends = np.array([1.0 / (length * period_s), 0.5 / period_s])
            share = sum(run.n_samples / run.repeats for run in self.runs) / sum(run.n_samples for run in self.runs)
            white = np.full(2, 2.0 * period_s * floor.rms**2 * share)
            traces.append(line("noise floor", *_decibels((ends, white)), style))
            kind = "measured from repeats" if floor.measured else "assumed, as nothing was repeated"
            caption = f"Noise floor: {kind}, and drawn as white."
        text, unit = quantity(channel)
        power = unit_text(f"({unit})^2" if "/" in unit or " " in unit else f"{unit}^2")
        return Figure(
            title=text.capitalize(),
            traces=traces,
            layout=layout(axis("frequency (Hz)") | {"type": "log"}, axis(f"gap (dB re 1 {power}/Hz)")),
            height_px=360,
            caption=caption,
        )


def _density(series: Sequence[FloatArray], period_s: float, length: int) -> tuple[FloatArray, FloatArray]:
    """Return frequencies without 0 Hz and the power density of all series together."""
    from scipy.signal import welch

    parts = [welch(values, fs=1.0 / period_s, nperseg=length) for values in series]
    weights = [float(len(values)) for values in series]
    return parts[0][0][1:], np.average([density[1:] for _, density in parts], axis=0, weights=weights)


def _decibels(pair: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    return pair[0], np.asarray(10.0 * np.log10(np.where(pair[1] > 0.0, pair[1], np.nan)))


# ---- bars ----


def _bars(
    title: str,
    names: Sequence[str],
    values: Sequence[float],
    x_title: str,
    caption: str = "",
    bounds: Sequence[Sequence[float]] = (),
) -> Figure:
    """Return a bar for each name, the first one on top, with its interval where there are ``bounds``."""
    trace = {
        "type": "bar",
        "orientation": "h",
        "x": list(values),
        "y": [plain(name) for name in names],
        "marker": {"color": BEFORE.colour},
        "hovertemplate": "%{y}: %{x:.3g}<extra></extra>",
        "showlegend": False,
    }
    high = max([*values, 0.0])
    if bounds:
        trace["error_x"] = {
            "type": "data",
            "symmetric": False,
            "array": [max(above - value, 0.0) for value, (_, above) in zip(values, bounds, strict=True)],
            "arrayminus": [max(value - below, 0.0) for value, (below, _) in zip(values, bounds, strict=True)],
            "color": INK,
            "thickness": 1,
            "width": 3,
        }
        high = max([high, *(above for _, above in bounds)])
    rows = {"categoryorder": "array", "categoryarray": [plain(name) for name in reversed(names)], "ticks": ""}
    horizontal = axis(x_title) | {"range": [0.0, 1.05 * high or 1.0], "zerolinecolor": GRID}
    return Figure(
        title=title,
        traces=[trace],
        layout=layout(horizontal, axis("") | rows) | {"dragmode": False},
        height_px=BAR_PX * len(names) + 84,
        caption=caption,
    )


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
            figures.append(_bars(title, names, shares, "share", bounds=_bounds(answer["where"], key)))
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
    yield _bars("Probability", names, chances, "probability", "Several effects may be present at once.")
    size = words.sizes(answer)[1]
    noise = min(1.0, 1.0 / size) if size > 0.0 else 1.0
    added = [cause for cause in causes if not words.is_parametric(cause)]
    yield _bars(
        "What the mean squared gap consists of",
        [*(cause["effect"] for cause in added), "not explained", "noise"],
        [*(cause["share"] for cause in added), words.unexplained(answer), noise],
        "share of the mean squared gap after re-calibration",
        f"Judged on {words.judged_on(answer)}. What effects share is split by the mean over all orders.",
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
            shown = words.si_text(value["value"], value["unit"])
            rows.append([cause["effect"] if number == 0 else "", text, shown, known])
    yield table(["effect", "parameter", "value", "95 % interval"], rows, "llrl")
    yield table(
        ["effect", "probability", "share", "share of its own", "cannot be told apart from"],
        [
            [
                cause["effect"],
                words.probability_text(cause["probability"]),
                words.percent(cause["share"]),
                words.percent(words.unique(cause)),
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
    low, high = (words.si_text(bound, "m") for bound in experiment["position_m"])
    chance = experiment["expected_probability"]
    rows = [
        ["where", f"{low} to {high}"],
        ["amplitude", words.si_text(experiment["amplitude_m"], "m")],
        ["fastest", words.si_text(experiment["velocity_m_per_s"], "m/s")],
        ["hardest", words.si_text(experiment["acceleration_m_per_s2"], "m/s²")],
        ["lasts", words.si_text(experiment["duration_s"], "s")],
        [
            "probability of the true cause, expected",
            f"{words.probability_text(chance['now'])} now, {words.probability_text(chance['after'])} after it",
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
    return " to ".join(words.si_text(bound, value["unit"]) for bound in value["ci95"])


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
    caption = f"Judged on {words.judged_on(answer)}. Bars: 95 % of resampled stretches of time, for the step alone."
    figure = dots(title, names, values, bounds, styles, "mean squared gap / noise floor")
    yield Figure(title=title, traces=figure.traces, layout=figure.layout, height_px=figure.height_px, caption=caption)
    yield tag("ul", *(tag("li", sentence) for sentence in words.shrinkage(answer)))
    rows = [
        [
            quantity(name)[0],
            *(
                words.si_text(channel[key], channel["unit"])
                for key in ("before", "recalibrated", "repaired", "noise_floor")
            ),
            words.percent(channel["reduction"]),
        ]
        for name, channel in answer["gap"]["channels"].items()
    ]
    header = ["channel", "on paper", "re-calibrated", "repaired", "noise floor", "mean square less"]
    yield paragraph("Gap of each channel, root mean square:")
    yield table(header, rows, "lrrrrr")


def _rivals(stages: Sequence[Stage]) -> Iterator[Block]:
    yield note(
        "Each round tries every effect of the library on top of those found before; bars show which share of the gap "
        f"beyond the noise it removes on what was not fitted. Below {words.percent(SMALLEST_GAIN)} none is added. Only "
        "the best are refined in closed loop; the others are estimated from one simulation."
    )
    for number, stage in enumerate(stages, start=1):
        base = ", ".join(effect.name for effect in stage.base.effects) or "the re-calibrated model"
        gains = [(rival, stage.gain(rival)) for rival in stage.rivals]
        shown = [(rival.kind.name, max(gain, 0.0)) for rival, gain in gains[:SEEN_RIVALS]]
        blocks: list[Block] = [note(f"On top of {base}.")]
        if shown:
            blocks.append(
                _bars("Share removed", [name for name, _ in shown], [gain for _, gain in shown], "share removed")
            )
        rows = [
            [
                rival.kind.name,
                words.percent(gain) if gain > -1.0 else "much worse",
                f"{rival.misfit:.4g}",
                "yes" if rival.refined else "no",
            ]
            for rival, gain in gains
        ]
        header = ["effect", "removes", "weighted misfit", "refined in closed loop"]
        blocks.append(folded("Numbers", table(header, rows, "lrrl")))
        yield Section(f"Round {number}", blocks)


def _basis(found: Diagnosis) -> Iterator[Block]:
    answer = found.answer
    rows = [
        [
            Path(run.name).name,
            str(run.repeats),
            str(run.n_samples),
            words.si_text(run.period_s, "s"),
            "–" if run.lap is None else words.si_text(run.lap * run.period_s, "s"),
            words.percent(float(out.mean())),
        ]
        for run, out in zip(found.split.runs, found.split.held_out, strict=True)
    ]
    yield table(["record", "mean of", "samples", "sampling time", "repeats itself after", "held out"], rows, "lrrrrr")
    floors = [
        [
            quantity(name)[0],
            words.si_text(floor["value"], floor["unit"]),
            "measured from repeats" if floor["measured_from_repeats"] else "assumed from the quietest parts",
        ]
        for name, floor in answer["noise_floor"].items()
    ]
    yield table(["channel", "noise floor", "origin"], floors, "lrl")
    names = [item.name for item in calibrations(found.final.nominal)]
    moved = zip(names, found.calibrated.shifts, found.final.shifts, strict=True)
    yield paragraph("What re-calibration moved, in standard deviations of the values on paper:")
    yield table(
        ["value on paper", "alone", "with the effects"],
        [[name.replace("_", " "), f"{alone:+.2f}", f"{beside:+.2f}"] for name, alone, beside in moved],
        "lrr",
    )
