"""The noise floor: what repeats of one command differ by, so that nobody explains noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fdbench.gap.runs import Run, differences
from fdbench.record import FloatArray

ASSUMED_QUANTILE = 0.25
PIECE = 256
BAND = 9  # frequencies
SMALLEST = 1e-12


@dataclass(frozen=True, kw_only=True)
class Floor:
    """Noise of one channel.

    Attributes
    ----------
    rms : float
        Standard deviation of a sample, in the unit of the channel.
    measured : bool
        Whether it comes from repeats; else it is assumed, see `assumed`.
    """

    rms: float
    measured: bool


def noise_floor(runs: Sequence[Run], channel: str) -> Floor:
    """Return the floor of a channel.

    With repeats (of records, or of laps within one) it is the root mean square of their differences over the root of
    two, drift from repeat to repeat included. Without, it is `assumed`.
    """
    found = differences(runs, channel)
    if found:
        mean_square = float(np.mean(np.concatenate(found) ** 2)) / 2.0
        return Floor(rms=max(np.sqrt(mean_square), SMALLEST), measured=True)
    return Floor(
        rms=max(assumed([run.channels[channel] if run.left is None else run.left[channel] for run in runs]), SMALLEST),
        measured=False,
    )


def assumed(signals: Sequence[FloatArray]) -> float:
    r"""Return the root mean square of the noise in what a model leaves, without repeats to tell it from the gap.

    Noise is what is there all the time and at no frequency in particular: of the spectra of all pieces of 256 samples
    (overlapping by half, without their trend) the quietest quarter counts, at each frequency, and of neighbouring
    frequencies the median. A gap that comes and goes with the motion, and lines, are left out; what is steady and
    broad is not told from noise, and noise slower than a piece is not seen. A quartile of the power of Gaussian noise
    is its mean times :math:`\ln 4/3`.
    """
    window, trend = np.hanning(PIECE), np.linspace(-1.0, 1.0, PIECE)
    pieces = np.concatenate([sliding_window_view(_long_enough(values), PIECE)[:: PIECE // 2] for values in signals])
    centred = pieces - pieces.mean(axis=1, keepdims=True)
    centred = centred - np.outer(centred @ trend / (trend @ trend), trend)
    power = np.abs(np.fft.rfft(centred * window)) ** 2 / np.sum(window**2)
    quiet = np.quantile(power, ASSUMED_QUANTILE, axis=0)[1:-1] / -math.log(1.0 - ASSUMED_QUANTILE)
    smooth = np.median(sliding_window_view(np.pad(quiet, BAND // 2, mode="edge"), BAND), axis=1)
    return math.sqrt(2.0 / PIECE * float(smooth.sum()))


def _long_enough(values: FloatArray) -> FloatArray:
    missing = PIECE - len(values)
    return np.pad(values, (0, missing), mode="reflect") if missing > 0 else values


def floors(runs: Sequence[Run]) -> Mapping[str, Floor]:
    """Return the floor of each channel."""
    return {channel: noise_floor(runs, channel) for channel in runs[0].channels}


def raised(found: Mapping[str, Floor], energy: Mapping[str, float]) -> Mapping[str, Floor]:
    """Return floors that mean squares are added to, of what cannot be simulated sample by sample."""
    return {
        name: Floor(rms=float(np.sqrt(floor.rms**2 + energy[name])), measured=floor.measured)
        for name, floor in found.items()
    }
