"""Where the gap lies: exact partitions of its energy by phase of motion, frequency, position, speed, time, channel.

Energy is counted in units of the noise floor; what the floor itself would give is set apart as noise and never spread
over the cells, so that the shares of each partition add up to one. Their intervals are those of a block bootstrap
(Kunsch 1989) over stretches of time that are drawn whole, with all channels.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft, rfftfreq

from fdbench.diagnosis.answer.quantity import Pair
from fdbench.diagnosis.answer.where import Cell, FrequencyCell, PositionCell, TimeCell, VelocityCell, Where
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.settings import EVIDENCE, JUDGE
from fdbench.record import FloatArray
from fdbench.statistics import drawn_counts, percentile_interval

PHASES = (
    "rest",
    "reversal",
    "break_away",
    "acceleration",
    "cruise_positive",
    "cruise_negative",
)
BANDS_HZ = (0.0, 5.0, 15.0, 50.0, 150.0, 500.0)
N_POSITIONS, N_SPEEDS, N_TIMES = 8, 5, 8

CellT = TypeVar("CellT", bound=Cell)


@dataclass(frozen=True, kw_only=True, eq=False)
class Gaps:
    """What is left of each channel of each run, in units of its floor."""

    runs: Sequence[RecordedRun]
    scaled: Sequence[Mapping[str, FloatArray]]
    noise_models: Mapping[str, NoiseModel]

    @classmethod
    def of(cls, split: Split, simulated: Sequence[Mapping[str, FloatArray]]) -> "Gaps":
        """Return the gaps between runs and their simulations, (n_samples,) each."""
        return cls(
            runs=split.runs,
            noise_models=split.noise_models,
            scaled=[split.gap(place, own) for place, own in enumerate(simulated)],
        )

    def energy(self) -> FloatArray:
        """Return the squared gap of each sample of all runs, summed over channels, beyond what the floor gives."""
        return np.asarray(self.by_channel().sum(axis=0))

    def by_channel(self) -> FloatArray:
        """Return the squared gap of each channel and sample beyond what the floor gives."""
        names = self.runs[0].channels
        return np.stack([np.concatenate([item[name] for item in self.scaled]) ** 2 - 1.0 for name in names])

    def by_band(self, edges_Hz: Sequence[float]) -> FloatArray:
        """Return the same for each band of frequency and sample, summed over channels.

        The band-passed gaps of a run have the sum of squares that its spectrum has in the band (Parseval); the floor
        is that of the band.
        """
        n_bands = len(edges_Hz) - 1
        found = []
        for run, item in zip(self.runs, self.scaled, strict=True):
            frequency = rfftfreq(run.n_samples, run.period_s)
            place = np.clip(np.searchsorted(edges_Hz, frequency, side="right") - 1, 0, n_bands - 1)
            relative = [2.0 * run.period_s * edge for edge in edges_Hz]
            noise = np.sum([floor.shares(relative) for floor in self.noise_models.values()], axis=0)
            squares = np.zeros((n_bands, run.n_samples))
            inside = place == np.arange(n_bands)[:, None]
            for values in item.values():
                squares += irfft(np.where(inside, rfft(values), 0.0), run.n_samples) ** 2
            found.append(squares - noise[:, None])
        return np.concatenate(found, axis=1)

    def stretches(self) -> NDArray[np.intp]:
        """Return the stretch of time that each sample of all runs belongs to."""
        found, offset = [], 0
        for run in self.runs:
            own = np.arange(run.n_samples) // max(8, round(EVIDENCE.segment_s / run.period_s))
            found.append(offset + own)
            offset += int(own[-1]) + 1
        return np.concatenate(found)


def phase_of(run: RecordedRun) -> NDArray[np.intp]:
    """Return the phase of motion of each sample, as an index of `PHASES`, from the command alone."""
    velocity, acceleration = run.reference[:, 1], run.reference[:, 2]
    fastest = max(float(np.max(np.abs(velocity))), 1e-12)
    hardest = max(float(np.max(np.abs(acceleration))), 1e-12)
    moving = np.abs(velocity) > JUDGE.rest_speed * fastest
    phase = np.where(velocity >= 0.0, PHASES.index("cruise_positive"), PHASES.index("cruise_negative"))
    phase[np.abs(acceleration) > JUDGE.steady * hardest] = PHASES.index("acceleration")
    phase[~moving] = PHASES.index("rest")
    width = max(1, round(JUDGE.reversal_s / run.period_s))
    direction = np.sign(velocity) * moving
    starts = np.flatnonzero(np.diff(moving.astype(int)) == 1) + 1
    last = 0.0
    for index in np.flatnonzero(np.diff(direction) != 0.0) + 1:
        near = slice(max(0, index - width), index + width)
        if direction[index] != 0.0:
            phase[near] = PHASES.index("reversal" if last == -direction[index] else "break_away")
            last = direction[index]
        elif direction[index - 1] != 0.0:
            last = direction[index - 1]
    if len(starts) == 0 and moving.any() and not moving.all():
        phase[np.argmax(moving) : np.argmax(moving) + width] = PHASES.index("break_away")
    return phase.astype(np.intp)


def bands_up_to(highest_Hz: float) -> list[float]:
    """Return the edges of the bands of frequency.

    >>> bands_up_to(125.0)
    [0.0, 5.0, 15.0, 50.0, 125.0]
    """
    return [edge for edge in BANDS_HZ if edge < highest_Hz] + [highest_Hz]


def shares(parts: FloatArray) -> FloatArray:
    """Return non-negative shares along the last axis that add up to one; all zero where nothing is beyond the floor.

    >>> shares(np.array([[3.0, -1.0, 1.0], [-1.0, -2.0, 0.0]])).tolist()
    [[0.75, 0.0, 0.25], [0.0, 0.0, 0.0]]
    """
    clipped = np.maximum(parts, 0.0)
    total = clipped.sum(axis=-1, keepdims=True)
    return np.asarray(np.divide(clipped, total, out=np.zeros_like(clipped), where=total > 0.0))


class Partition:
    """Shares of the cells of one partition, with intervals.

    Parameters
    ----------
    parts : (n_stretches, n_cells) array
        Energy of each stretch of time in each cell.
    seed : int
        Of the bootstrap.
    """

    def __init__(self, parts: FloatArray, seed: int = 0) -> None:
        drawn = drawn_counts(np.arange(len(parts)), JUDGE.resamples, seed)
        self.shares: list[float] = shares(parts.sum(axis=0)).tolist()
        bounds = percentile_interval(shares(drawn @ parts)).T.tolist()
        self.ci95: list[Pair] = [(low, high) for low, high in bounds]

    def named(self, names: Sequence[str]) -> tuple[dict[str, float], dict[str, Pair]]:
        """Return shares and intervals by name."""
        return dict(zip(names, self.shares, strict=True)), dict(zip(names, self.ci95, strict=True))

    def cells(self, kind: type[CellT], edges: Sequence[float]) -> tuple[CellT, ...]:
        """Return cells of a kind between edges."""
        between = itertools.pairwise(map(float, edges))
        return tuple(
            kind(share=share, ci95=bounds, **{kind.edges: pair})
            for pair, share, bounds in zip(between, self.shares, self.ci95, strict=True)
        )


def where(gaps: Gaps) -> Where:
    """Return the partitions of the gap with 95 % intervals."""
    energy, stretch = gaps.energy(), gaps.stretches()
    n_stretches = int(stretch[-1]) + 1

    def placed(place: NDArray[np.intp], n_cells: int) -> Partition:
        cell = stretch * n_cells + place
        parts = np.bincount(cell, weights=energy, minlength=n_stretches * n_cells)
        return Partition(np.asarray(parts.reshape(-1, n_cells), dtype=np.float64))

    def split(rows: FloatArray) -> Partition:
        return Partition(np.stack([np.bincount(stretch, weights=row) for row in rows], axis=1))

    def cells(coordinate: FloatArray, n_cells: int, kind: type[CellT]) -> tuple[CellT, ...]:
        edges = np.linspace(float(coordinate.min()), float(coordinate.max()), n_cells + 1)
        place = np.clip(np.searchsorted(edges, coordinate, side="right") - 1, 0, n_cells - 1)
        return placed(place, n_cells).cells(kind, edges.tolist())

    bands = bands_up_to(0.5 / gaps.runs[0].period_s)
    position, speed, _ = np.concatenate([run.reference for run in gaps.runs]).T
    time = np.concatenate([run.time_s for run in gaps.runs])
    phase = np.concatenate([phase_of(run) for run in gaps.runs])
    motion, motion_ci95 = placed(phase, len(PHASES)).named(PHASES)
    channel, channel_ci95 = split(gaps.by_channel()).named(list(gaps.runs[0].channels))
    return Where(
        motion=motion,
        frequency=split(gaps.by_band(bands)).cells(FrequencyCell, bands),
        position=cells(position, N_POSITIONS, PositionCell),
        velocity=cells(speed, N_SPEEDS, VelocityCell),
        time=cells(time, N_TIMES, TimeCell),
        channel=channel,
        ci95={"motion": motion_ci95, "channel": channel_ci95},
    )
