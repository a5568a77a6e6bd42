"""Spectral lines: frequencies that stand out of signals over time, and what a signal has of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.settings import MODEL, SEARCH
from fdbench.record import FloatArray

ComplexArray = NDArray[np.complex128]


def highest_Hz(period_s: float) -> float:
    """Return the highest frequency of a mode or line that samples still show."""
    return MODEL.highest_of_nyquist * 0.5 / period_s


def lines_in_time(signals: Sequence[FloatArray], period_s: float) -> list[float]:
    """Return the lines (Hz) that stand out of the spectrum of any signal, (n_channels, n) each, the sharpest first.

    Of a force that is no sine each counts with its harmonics: these may be sharper than what they are harmonics of.
    None is as slow as what a signal resolves, where it has no surroundings on either side. Where each of them is, all
    signals say together: one that comes and goes with the motion is off by a good part of what one signal resolves.
    """
    from scipy.signal import periodogram

    found: list[tuple[float, float, float]] = []
    near, far = SEARCH.line_near, SEARCH.line_far
    for signal in signals:
        frequency, powers = periodogram(signal, 1.0 / period_s, "hann")
        power = powers.sum(axis=0)
        lowest = max(SEARCH.lowest_line_Hz, near * float(frequency[1]))
        power[(frequency < lowest) | (frequency > MODEL.highest_of_nyquist * frequency[-1])] = 0.0
        side = np.lib.stride_tricks.sliding_window_view(np.pad(power, far, mode="edge"), far - near + 1).max(axis=1)
        height = power / np.maximum(np.maximum(side[: len(power)], side[far + near :]), 1e-30)
        for peak in np.flatnonzero(height > SEARCH.stands_out).tolist():
            found.append((float(height[peak]), at_peak(frequency, power, peak), near * float(frequency[1])))
    heights: dict[float, float] = {}
    for height, line, width in sorted(found, reverse=True):
        if all(abs(line - other) > width for other in heights):
            heights[line] = height
    finest = 1.0 / (period_s * max(signal.shape[1] for signal in signals)) if heights else 0.0
    slowest = max(SEARCH.lowest_line_Hz, near * finest)

    def with_harmonics(line: float) -> float:
        return sum(own for other, own in heights.items() if abs(other - round(other / line) * line) < finest)

    lines = sorted(heights, key=with_harmonics, reverse=True)[: SEARCH.lines]
    return [max(_by_all(signals, line, finest, period_s), slowest) for line in lines]


def _by_all(signals: Sequence[FloatArray], line: float, within: float, period_s: float) -> float:
    """Return the frequency (Hz) that all signals together have most of, within so much about a line."""
    from scipy.optimize import minimize_scalar

    windowed = [np.hanning(signal.shape[1]) * signal for signal in signals]
    longest = max(own.shape[1] for own in windowed)

    def missed(frequency: float) -> float:
        wave = phasor(frequency * period_s, longest)
        return -sum(float(np.sum(np.abs(own @ wave[: own.shape[1]]) ** 2)) for own in windowed)

    tried = np.linspace(line - within, line + within, 9)
    best, step = min(tried.tolist(), key=missed), float(tried[1] - tried[0])
    return float(minimize_scalar(missed, bounds=(best - step, best + step), method="bounded").x)


def at_peak(axis: FloatArray, power: FloatArray, peak: int) -> float:
    """Return where the peak is on an even axis, by a parabola through the roots of three powers."""
    if not 0 < peak < len(power) - 1:
        return float(axis[peak])
    left, middle, right = np.sqrt(power[peak - 1 : peak + 2])
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(axis[peak] + min(max(offset, -1.0), 1.0) * (axis[1] - axis[0]))


def phasor(frequency: float, n_samples: int) -> ComplexArray:
    r"""Return :math:`e^{-2 \pi i f k}` for samples k, with f in cycles per sample.

    Exponentials are taken of a row and of a column of samples, of which the others are products.

    >>> bool(np.allclose(phasor(0.25, 4), [1, -1j, -1, 1j]))
    True
    """
    width = math.isqrt(n_samples) + 1
    turn = -2j * np.pi * frequency
    found = np.outer(np.exp(turn * width * np.arange(width)), np.exp(turn * np.arange(width)))
    return np.asarray(found.ravel()[:n_samples])


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretches:
    """Where in a record a line is looked for: in all of it, or in stretches with nothing of the line between them.

    Attributes
    ----------
    n_samples : int
        Of the record.
    slices : tuple of slice
        At least one.
    """

    n_samples: int
    slices: tuple[slice, ...]

    @classmethod
    def whole(cls, n_samples: int) -> "Stretches":
        """Return all of a record as one stretch."""
        return cls(n_samples=n_samples, slices=(slice(0, n_samples),))

    @property
    def resolved(self) -> float:
        """What the longest stretch resolves, in cycles per sample."""
        return 1.0 / float(max(own.stop - own.start for own in self.slices))

    @cached_property
    def window(self) -> FloatArray:
        """Hann's window over each stretch, (n_samples,)."""
        found = np.zeros(self.n_samples)
        for own in self.slices:
            found[own] = np.hanning(own.stop - own.start)
        return found

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Which samples are in a stretch, (n_samples,)."""
        found = np.zeros(self.n_samples, dtype=np.bool_)
        for own in self.slices:
            found[own] = True
        return found

    def of(self, signal: FloatArray) -> list[FloatArray]:
        """Return the stretches of a signal (n_samples,), each as the only channel of its own."""
        return [signal[None, own] for own in self.slices]

    def component(self, signal: FloatArray, frequency: float) -> complex:
        """Return what a signal has of a frequency (cycles per sample) in the stretches, as a complex amplitude."""
        turned = (self.window * signal) @ phasor(frequency, self.n_samples)
        return complex(2.0 * turned / self.window.sum())

    def sharpened(self, signal: FloatArray, frequency: float, within: float | None = None) -> float:
        """Return the frequency (cycles per sample) that a signal has most of, within what is resolved about one.

        Several stretches are in phase at several frequencies, of which the best is refined.
        """
        from scipy.optimize import minimize_scalar

        def missed(own: float) -> float:
            return -abs(self.component(signal, own))

        within = self.resolved if within is None else within
        tried = np.linspace(frequency - within, frequency + within, 1 + 2 * math.ceil(2.0 * within * self.n_samples))
        best, step = min(tried.tolist(), key=missed), float(tried[1] - tried[0])
        return float(minimize_scalar(missed, bounds=(best - step, best + step), method="bounded").x)

    def tones(self, frequencies: Sequence[float]) -> FloatArray:
        """Return cosine and sine of frequencies (cycles per sample) in the stretches, (2 n_frequencies, n_samples)."""
        angle = 2.0 * np.pi * np.outer(frequencies, np.arange(self.n_samples))
        return np.asarray(np.concatenate((np.cos(angle), np.sin(angle))) * self.inside)


def fitted(signals: FloatArray, basis: FloatArray) -> FloatArray:
    """Return what least squares make of signals, (n_channels, n_samples), by the rows of a basis."""
    return np.asarray(np.linalg.lstsq(basis.T, signals.T, rcond=None)[0].T @ basis)
