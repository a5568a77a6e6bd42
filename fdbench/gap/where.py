"""Where the gap lies: exact partitions of its energy by phase of motion, frequency, position, speed, time, channel.

Energy is counted in units of the noise floor; what the floor itself would give is set apart as noise and never spread
over the cells, so that the shares of each partition add up to one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.gap.floor import Floor
from fdbench.gap.runs import Run
from fdbench.record import FloatArray

PHASES = (
    "rest",
    "reversal",
    "break_away",
    "acceleration",
    "cruise_positive",
    "cruise_negative",
)
REST_SPEED = 1e-3  # of the largest commanded speed
REVERSAL_S = 0.05
SLOW, STEADY = 0.05, 0.02  # of the largest commanded speed and acceleration
BANDS_HZ = (0.0, 5.0, 15.0, 50.0, 150.0, 500.0)
N_POSITIONS, N_SPEEDS, N_TIMES = 8, 5, 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Gaps:
    """What is left of each channel of each run, in units of its floor."""

    runs: Sequence[Run]
    scaled: Sequence[Mapping[str, FloatArray]]

    @classmethod
    def of(
        cls, runs: Sequence[Run], simulated: Sequence[Mapping[str, FloatArray]], floors: Mapping[str, Floor]
    ) -> "Gaps":
        """Return the gaps between runs and their simulations, (n_samples,) each."""
        scaled = [
            {
                name: (run.channels[name] - sim[name]) * (np.sqrt(run.repeats) / floors[name].rms)
                for name in run.channels
            }
            for run, sim in zip(runs, simulated, strict=True)
        ]
        return cls(runs=runs, scaled=scaled)

    def energy(self) -> list[FloatArray]:
        """Return the squared gap of each sample, summed over channels, beyond what the floor gives."""
        return [sum_of(item) - len(item) for item in self.scaled]


def sum_of(channels: Mapping[str, FloatArray]) -> FloatArray:
    """Return the sum of squares over channels."""
    total: FloatArray = np.sum([values**2 for values in channels.values()], axis=0)
    return total


def phase_of(run: Run) -> NDArray[np.intp]:
    """Return the phase of motion of each sample, as an index of `PHASES`, from the command alone."""
    velocity, acceleration = run.reference[:, 1], run.reference[:, 2]
    fastest = max(float(np.max(np.abs(velocity))), 1e-12)
    hardest = max(float(np.max(np.abs(acceleration))), 1e-12)
    moving = np.abs(velocity) > REST_SPEED * fastest
    phase = np.where(velocity >= 0.0, PHASES.index("cruise_positive"), PHASES.index("cruise_negative"))
    phase[np.abs(acceleration) > STEADY * hardest] = PHASES.index("acceleration")
    phase[~moving] = PHASES.index("rest")
    width = max(1, round(REVERSAL_S / run.period_s))
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


def shares(parts: Sequence[float]) -> list[float]:
    """Return non-negative shares that add up to one; all zero where there is nothing beyond the floor."""
    clipped = np.maximum(np.asarray(parts, dtype=np.float64), 0.0)
    total = float(clipped.sum())
    return [0.0] * len(clipped) if total <= 0.0 else (clipped / total).tolist()


def where(gaps: Gaps) -> dict[str, Any]:
    """Return the partitions of the contract: motion, frequency, position, velocity, time and channel."""
    energy = np.concatenate(gaps.energy())
    phase = np.concatenate([phase_of(run) for run in gaps.runs])
    motion = [float(energy[phase == index].sum()) for index in range(len(PHASES))]
    position = np.concatenate([run.reference[:, 0] for run in gaps.runs])
    speed = np.concatenate([run.reference[:, 1] for run in gaps.runs])
    time = np.concatenate([np.arange(run.n_samples) * run.period_s for run in gaps.runs])
    channels = list(gaps.runs[0].channels)
    by_channel = [sum(float(np.sum(item[name] ** 2)) - len(item[name]) for item in gaps.scaled) for name in channels]
    return {
        "motion": dict(zip(PHASES, shares(motion), strict=True)),
        "frequency": _bands(gaps),
        "position": _cells(energy, position, N_POSITIONS, "m"),
        "velocity": _cells(energy, speed, N_SPEEDS, "m_per_s"),
        "time": _cells(energy, time, N_TIMES, "s"),
        "channel": dict(zip(channels, shares(by_channel), strict=True)),
    }


def _cells(energy: FloatArray, coordinate: FloatArray, n_cells: int, unit: str) -> list[dict[str, Any]]:
    edges = np.linspace(float(coordinate.min()), float(coordinate.max()), n_cells + 1)
    place = np.clip(np.searchsorted(edges, coordinate, side="right") - 1, 0, n_cells - 1)
    parts = np.bincount(place, weights=energy, minlength=n_cells)
    return [
        {f"range_{unit}": [float(edges[index]), float(edges[index + 1])], "share": share}
        for index, share in enumerate(shares(parts.tolist()))
    ]


def _bands(gaps: Gaps) -> list[dict[str, Any]]:
    period = gaps.runs[0].period_s
    nyquist = 0.5 / period
    edges = [edge for edge in BANDS_HZ if edge < nyquist] + [nyquist]
    parts = np.zeros(len(edges) - 1)
    for run, item in zip(gaps.runs, gaps.scaled, strict=True):
        frequency = np.fft.rfftfreq(run.n_samples, run.period_s)
        weight = np.full(len(frequency), 2.0)
        weight[0] = 1.0
        if run.n_samples % 2 == 0:
            weight[-1] = 1.0
        place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, len(parts) - 1)
        for values in item.values():
            power = weight * np.abs(np.fft.rfft(values)) ** 2 / run.n_samples
            parts += np.bincount(place, weights=power - weight, minlength=len(parts))
    return [
        {"band_Hz": [float(edges[index]), float(edges[index + 1])], "share": share}
        for index, share in enumerate(shares(parts.tolist()))
    ]
