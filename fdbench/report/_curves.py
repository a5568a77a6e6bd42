"""Curves of the gap of a diagnosis, before and after the repair, over time, position and frequency."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.record import FloatArray
from fdbench.report._figures import AFTER, BEFORE, INK, SOFT, TRUTH, Curve, Figure, Panel, Style, labelled
from fdbench.report._page import Block, Folded, note
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

    def folded(self) -> list[Folded]:
        """Return the gap of every channel over time, position and frequency, folded."""
        return [
            Folded("Gap over time", list(self.over_time())),
            Folded("Gap over position", list(self.over_position())),
            Folded("Spectrum of the gap", list(self.spectra())),
        ]

    @property
    def channels(self) -> list[str]:
        """Names of the channels."""
        return list(self.runs[0].channels)

    @property
    def worst_first(self) -> list[str]:
        """Names of the channels, that with the largest share of the gap first."""
        shares = self.found.answer.where.channel
        return sorted(self.channels, key=lambda name: -shares.get(name, 0.0))

    def worst(self) -> Figure:
        """Return the gap of the channel that has most of it, in the record in which it is largest."""
        channel = self.worst_first[0]
        sizes = [float(np.mean(gap**2)) for gap in self.of(channel)[0]]
        index = int(np.argmax(sizes))
        share = self.found.answer.where.channel.get(channel, 0.0)
        title = f"Gap of the {quantity(channel)[0]}, which has {percent(share)} of all"
        drawn = self.of_run(index, [channel])
        title = f"{title}, in {drawn.title}" if len(self.runs) > 1 else title
        return replace(drawn, title=title, panels=[replace(drawn.panels[0], height_px=260)])

    @property
    def runs(self) -> Sequence[RecordedRun]:
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
            yield self.of_run(index, self.worst_first)

    def of_run(self, index: int, channels: Sequence[str]) -> Figure:
        """Return channels and gaps of one run over time."""
        run = self.runs[index]
        n_points = min(MOST_POINTS, POINTS_OF_ALL_RUNS // min(len(self.runs), MOST_RUNS))
        panels = [panel for channel in channels for panel in self._panels(index, channel, n_points)]
        held_out = float(self.found.split.held_out[index].mean())
        caption = f"Dashed: twice the noise floor. Not fitted, but judged on: {percent(held_out)} of the samples."
        return Figure(title=Path(run.name).name, panels=panels, x_title="time (s)", caption=caption)

    def _panels(self, index: int, channel: str, n_points: int) -> Iterator[Panel]:
        """Yield the gap of a channel, and below it what was measured and simulated."""
        run, (text, own_unit) = self.runs[index], quantity(channel)
        measured = run.channels[channel]
        before, after = self.found.simulated[index][channel], self.found.repaired[index][channel]

        def curve(name: str, values: FloatArray, style: Style, width: float = 1.2) -> Curve:
            x, y = thinned(run.time_s, values, n_points)
            return Curve(name=name, x=x, y=y, style=style, width=width)

        gaps = measured - before, measured - after
        factor, unit = scaled(own_unit, peak(gaps))
        level = 2.0 * factor * self.found.split.noise_models[channel].rms / math.sqrt(run.repeats)
        floor = Style(colour=SOFT, dash="dash")
        bounds = [
            Curve(name="noise floor", x=run.time_s[[0, -1]], y=np.full(2, side * level), style=floor)
            for side in (-1.0, 1.0)
        ]
        yield Panel(
            y_title=labelled(f"gap of the {text}", unit),
            items=[
                curve(BEFORE_NAME, factor * gaps[0], BEFORE),
                curve(AFTER_NAME, factor * gaps[1], AFTER),
                *bounds,
            ],
            y_range=opening_range([factor * gap for gap in gaps]),
        )
        factor, unit = scaled(own_unit, peak([measured]))
        yield Panel(
            y_title=labelled(text, unit),
            items=[
                curve("measured", factor * measured, Style(colour=TRUTH), 3.0),
                curve(BEFORE_NAME, factor * before, BEFORE),
                curve(AFTER_NAME, factor * after, AFTER),
            ],
            height_px=150,
        )

    def over_position(self) -> Iterator[Block]:
        yield note(
            "Mean gap at each commanded position while the axis moves, forwards and backwards, over all records."
        )
        yield from (self.profile(channel) for channel in self.worst_first)

    def profile(self, channel: str) -> Figure:
        """Return the mean gap of a channel at each commanded position."""
        position, velocity, _ = np.concatenate([run.reference for run in self.runs]).T
        both = [np.concatenate(gaps) for gaps in self.of(channel)]
        edges = np.linspace(float(position.min()), float(position.max()) + 1e-12, N_BINS + 1)
        moving = np.abs(velocity) > 1e-3 * np.abs(velocity).max()
        factor, unit = scaled(quantity(channel)[1], peak(both))
        items = []
        for gap, style, name in zip(both, (BEFORE, AFTER), (BEFORE_NAME, AFTER_NAME), strict=True):
            for side, direction, dash in ((1.0, "forwards", "solid"), (-1.0, "backwards", "dot")):
                chosen = moving & (side * velocity > 0.0)
                place = np.searchsorted(edges, position[chosen], side="right") - 1
                counts = np.bincount(place, minlength=N_BINS).astype(np.float64)
                sums = np.bincount(place, weights=gap[chosen], minlength=N_BINS)
                mean = np.divide(sums, counts, out=np.full(N_BINS, np.nan), where=counts > 0.0)
                own = Style(colour=style.colour, dash=dash)
                middle = 0.5 * (edges[1:] + edges[:-1])
                items.append(Curve(name=f"{name}, {direction}", x=middle, y=factor * mean, style=own))
        panel = Panel(y_title=labelled("mean gap", unit), items=items, height_px=280)
        return Figure(title=quantity(channel)[0].capitalize(), panels=[panel], x_title="position (m)")

    def spectra(self) -> Iterator[Block]:
        yield note(f"Welch's method: Hann's window, segments of up to {SEGMENT} samples, mean over all records.")
        yield from (self.spectrum(channel) for channel in self.worst_first)

    def spectrum(self, channel: str) -> Figure:
        """Return the power density of the gap of a channel."""
        period_s = self.runs[0].period_s
        length = min(SEGMENT, *(run.n_samples for run in self.runs))
        items = [
            _level(name, *_density(gaps, period_s, length), style)
            for name, style, gaps in zip((BEFORE_NAME, AFTER_NAME), (BEFORE, AFTER), self.of(channel), strict=True)
        ]
        floor = self.found.split.noise_models[channel]
        share = sum(run.n_samples / run.repeats for run in self.runs) / sum(run.n_samples for run in self.runs)
        parts = (("noise floor", floor.spectrum, "dash"), ("run to run", floor.from_run_to_run, "dot"))
        for name, spectrum, dash in parts:
            if spectrum is not None:
                frequency = np.linspace(0.0, 0.5 / period_s, len(spectrum))[1:-1]
                density = share * spectrum[1:-1] / frequency[0]
                items.append(_level(name, frequency, density, Style(colour=INK, dash=dash)))
        origin = "half of what repeats differ by" if floor.measured else "assumed, as nothing was repeated"
        caption = f"Noise floor: {origin}."
        if floor.from_run_to_run is not None:
            caption = f"Noise floor: {origin}, and apart from it what changes from run to run."
        text, unit = quantity(channel)
        power = unit_text(f"({unit})^2" if "/" in unit or " " in unit else f"{unit}^2")
        return Figure(
            title=text.capitalize(),
            panels=[Panel(y_title=f"gap (dB re 1 {power}/Hz)", items=items, height_px=280)],
            x_title="frequency (Hz)",
            x_log=True,
            caption=caption,
        )


def _density(series: Sequence[FloatArray], period_s: float, length: int) -> tuple[FloatArray, FloatArray]:
    """Return frequencies without 0 Hz and the power density of all series together."""
    from scipy.signal import welch

    parts = [welch(values, fs=1.0 / period_s, nperseg=length) for values in series]
    weights = [float(len(values)) for values in series]
    return parts[0][0][1:], np.average([density[1:] for _, density in parts], axis=0, weights=weights)


def _level(name: str, frequency_Hz: FloatArray, density: FloatArray, style: Style) -> Curve:
    """Return a density in dB; none at all is a gap."""
    decibels = 10.0 * np.log10(np.where(density > 0.0, density, np.nan))
    return Curve(name=name, x=frequency_Hz, y=decibels, style=style)
