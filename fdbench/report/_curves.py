"""Curves of the gap of a diagnosis, before and after the repair, over time, position and frequency."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.diagnosis.records.runs import Run
from fdbench.record import FloatArray
from fdbench.report._figures import (
    AFTER,
    BEFORE,
    INK,
    SOFT,
    TRUTH,
    Panel,
    Style,
    axis,
    labelled,
    layout,
    line,
    stack,
)
from fdbench.report._page import Block, Figure, Section, note
from fdbench.report._series import MOST_POINTS, opening_range, peak, thinned
from fdbench.wording import percent, quantity, scaled, unit_text

MOST_RUNS = 6
POINTS_OF_ALL_RUNS = 12_000
N_BINS = 120
SEGMENT = 4096  # samples of Welch's method
BEFORE_NAME, AFTER_NAME = "simulated, re-calibrated", "simulated, repaired"


@dataclass(frozen=True, eq=False)
class Curves:
    """Measured, re-calibrated and repaired channels of all runs."""

    found: Diagnosis

    def sections(self) -> list[Section]:
        """Return the gap over time, position and frequency."""
        return [
            Section("Gap over time", list(self.over_time())),
            Section("Gap over position", list(self.over_position())),
            Section("Spectrum of the gap", list(self.spectra())),
        ]

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
            [run.channels[channel] - own[channel] for run, own in zip(self.runs, self.found.repaired, strict=True)],
        )

    def over_time(self) -> Iterator[Block]:
        runs = self.runs
        if len(runs) > MOST_RUNS:
            yield note(f"The first {MOST_RUNS} of {len(runs)} records.")
        for index in range(min(len(runs), MOST_RUNS)):
            yield self.of_run(index, self.channels)

    def of_run(self, index: int, channels: Sequence[str]) -> Figure:
        """Return channels and gaps of one run over time."""
        run = self.runs[index]
        n_points = min(MOST_POINTS, POINTS_OF_ALL_RUNS // min(len(self.runs), MOST_RUNS))
        panels = [panel for channel in channels for panel in self._panels(index, channel, n_points)]
        held_out = float(self.found.split.held_out[index].mean())
        caption = f"Dashed: twice the noise floor. Not fitted, but judged on: {percent(held_out)} of the samples."
        return stack(Path(run.name).name, panels, "time (s)", caption)

    def _panels(self, index: int, channel: str, n_points: int) -> Iterator[Panel]:
        run, text = self.runs[index], quantity(channel)[0]
        time_s = run.period_s * np.arange(run.n_samples, dtype=np.float64)
        measured = run.channels[channel]
        before, after = self.found.simulated[index][channel], self.found.repaired[index][channel]
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
        level = 2.0 * factor * self.found.split.noise_models[channel].rms / math.sqrt(run.repeats)
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
        yield from (self.profile(channel) for channel in self.channels)

    def profile(self, channel: str) -> Figure:
        """Return the mean gap of a channel at each commanded position."""
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
        yield from (self.spectrum(channel) for channel in self.channels)

    def spectrum(self, channel: str) -> Figure:
        """Return the power density of the gap of a channel."""
        period_s = self.runs[0].period_s
        length = min(SEGMENT, *(run.n_samples for run in self.runs))
        before, after = (_decibels(_density(gaps, period_s, length)) for gaps in self.of(channel))
        traces = [line(BEFORE_NAME, *before, BEFORE), line(AFTER_NAME, *after, AFTER)]
        floor = self.found.split.noise_models[channel]
        share = sum(run.n_samples / run.repeats for run in self.runs) / sum(run.n_samples for run in self.runs)
        parts = (("noise floor", floor.spectrum, "dash"), ("run to run", floor.from_run_to_run, "dot"))
        for name, spectrum, dash in parts:
            if spectrum is not None:
                frequency = np.linspace(0.0, 0.5 / period_s, len(spectrum))[1:-1]
                density = share * spectrum[1:-1] / frequency[0]
                traces.append(line(name, *_decibels((frequency, density)), Style(colour=INK, dash=dash)))
        origin = "half of what repeats differ by" if floor.measured else "assumed, as nothing was repeated"
        caption = f"Noise floor: {origin}."
        if floor.from_run_to_run is not None:
            caption = f"Noise floor: {origin}, and apart from it what changes from run to run."
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
