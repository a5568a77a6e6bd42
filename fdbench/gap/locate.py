"""Locate periods: the strongest lines of the gap over time and over position."""

from collections.abc import Mapping

import numpy as np

from fdbench.gap.evidence import Split
from fdbench.gap.hypothesis import Hypothesis
from fdbench.gap.replay import Replay
from fdbench.record import FloatArray

LINES = 2
LOWEST_HZ = 2.0
SHORTEST_M, PER_TRAVEL = 1e-3, 3.0
BIN_M, OVERSAMPLING = 1e-4, 8


def located(replay: Replay, split: Split, base: Hypothesis) -> Mapping[str, list[float]]:
    """Return the frequencies (Hz) and wavelengths (m) that stand out in the force that the model lacks."""
    gaps, times, positions = [], [], []
    for run in split.runs:
        simulated = replay.simulate(run, [base.variant()])
        gap = run.channels["motor_force_N"] - simulated["motor_force_N"][0]
        gaps.append(gap - gap.mean())
        times.append(np.arange(run.n_samples) * run.period_s)
        positions.append(run.channels["position_m"])
    longest = max(range(len(gaps)), key=lambda index: len(gaps[index]))
    period = split.runs[longest].period_s
    return {
        "frequency": _lines_in_time(gaps[longest], period),
        "wavelength": _lines_in_position(np.concatenate(gaps), np.concatenate(positions)),
    }


def _lines_in_time(gap: FloatArray, period_s: float) -> list[float]:
    window = np.hanning(len(gap))
    power = np.abs(np.fft.rfft(gap * window)) ** 2
    frequency = np.asarray(np.fft.rfftfreq(len(gap), period_s), dtype=np.float64)
    power[frequency < LOWEST_HZ] = 0.0
    found = []
    for _ in range(LINES):
        peak = int(np.argmax(power))
        found.append(_parabola(frequency, power, peak))
        power[max(0, peak - 5) : peak + 6] = 0.0
    return found


def _lines_in_position(gap: FloatArray, position: FloatArray) -> list[float]:
    travel = float(np.ptp(position))
    if travel < 2.0 * SHORTEST_M:
        return []
    n_bins = max(64, round(travel / BIN_M))
    place = np.minimum(((position - position.min()) * (n_bins / travel)).astype(np.intp), n_bins - 1)
    visits = np.maximum(np.bincount(place, minlength=n_bins), 1)
    profile = np.bincount(place, weights=gap, minlength=n_bins) / np.sqrt(visits)
    power = np.abs(np.fft.rfft(profile - profile.mean(), OVERSAMPLING * n_bins)) ** 2
    wavenumber = np.asarray(np.fft.rfftfreq(OVERSAMPLING * n_bins, travel / n_bins), dtype=np.float64)
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
