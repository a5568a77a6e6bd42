"""Locate periods: the strongest lines of the gap over time and over position."""

from collections.abc import Mapping, Sequence

import numpy as np

from fdbench.gap.evidence import Split
from fdbench.gap.hypothesis import Hypothesis
from fdbench.gap.replay import Replay
from fdbench.gap.runs import Run
from fdbench.record import FloatArray

LINES = 2
LOWEST_HZ = 2.0
SHORTEST_M, PER_TRAVEL = 4e-4, 0.9
BIN_M, OVERSAMPLING = 1e-4, 8


def located(replay: Replay, split: Split, base: Hypothesis) -> Mapping[str, list[float]]:
    """Return the frequencies (Hz) and wavelengths (m) that stand out in what the model lacks.

    Over time the longest run and the one that differs most are looked at, over position all runs.
    """
    gaps = []
    for run in split.runs:
        simulated = replay.simulate(run, [base.variant()])
        scaled = [
            (measured - simulated[name][0]) / split.floors[name].rms
            for name, measured in run.channels.items()
            if name != "position_m"
        ]
        gap = np.stack(scaled)
        gaps.append(np.where(np.isfinite(gap), gap, 0.0))
    longest = max(range(len(gaps)), key=lambda index: gaps[index].shape[1])
    worst = max(range(len(gaps)), key=lambda index: float(np.mean(gaps[index] ** 2)))
    frequencies: list[float] = []
    for place in dict.fromkeys((longest, worst)):
        frequencies += _lines_in_time(gaps[place], split.runs[place].period_s)
    return {"frequency": frequencies, "wavelength": _lines_in_position(gaps, split.runs)}


def _lines_in_time(gap: FloatArray, period_s: float) -> list[float]:
    n = gap.shape[1]
    centred = gap - gap.mean(axis=1, keepdims=True)
    power = np.sum(np.abs(np.fft.rfft(centred * np.hanning(n))) ** 2, axis=0)
    frequency = np.asarray(np.fft.rfftfreq(n, period_s), dtype=np.float64)
    power[frequency < LOWEST_HZ] = 0.0
    found = []
    for _ in range(LINES):
        peak = int(np.argmax(power))
        found.append(_parabola(frequency, power, peak))
        power[max(0, peak - 5) : peak + 6] = 0.0
    return found


def _lines_in_position(gaps: Sequence[FloatArray], runs: Sequence[Run]) -> list[float]:
    """Return the wavelengths that stand out in the profiles over position.

    Each run and direction has a profile of its own: the loop shifts a wave by its lag, friction turns its sign.
    """
    lowest = min(float(run.channels["position_m"].min()) for run in runs)
    travel = max(float(run.channels["position_m"].max()) for run in runs) - lowest
    if travel < 2.0 * SHORTEST_M:
        return []
    n_bins = max(64, round(travel / BIN_M))
    wavenumber = np.asarray(np.fft.rfftfreq(OVERSAMPLING * n_bins, travel / n_bins), dtype=np.float64)
    power = np.zeros(len(wavenumber))
    for run, gap in zip(runs, gaps, strict=True):
        place = np.minimum(((run.channels["position_m"] - lowest) * (n_bins / travel)).astype(np.intp), n_bins - 1)
        for moving in (run.reference[:, 1] > 0.0, run.reference[:, 1] < 0.0):
            visits = np.bincount(place[moving], minlength=n_bins)
            for signal in gap:
                sums = np.bincount(place[moving], weights=signal[moving], minlength=n_bins)
                profile = sums / np.sqrt(np.maximum(visits, 1))
                profile -= visits**0.5 * (sums.sum() / max(visits.sum(), 1))
                power += np.abs(np.fft.rfft(profile, OVERSAMPLING * n_bins)) ** 2
    power[(wavenumber < PER_TRAVEL / travel) | (wavenumber > 1.0 / SHORTEST_M)] = 0.0
    found = []
    for _ in range(LINES):
        peak = int(np.argmax(power))
        found.append(1.0 / _parabola(wavenumber, power, peak))
        width = max(3, int(2.0 / travel / (wavenumber[1] - wavenumber[0])))
        power[max(0, peak - width) : peak + width + 1] = 0.0
    return found


def _parabola(axis: FloatArray, power: FloatArray, peak: int) -> float:
    if not 0 < peak < len(power) - 1:
        return float(axis[peak])
    left, middle, right = np.sqrt(power[peak - 1 : peak + 2])
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(axis[peak] + offset * (axis[1] - axis[0]))
