"""The noise floor: what repeats of one command differ by, so that nobody explains noise."""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fdbench.diagnosis.records.runs import POSITION, RecordedRun, differences
from fdbench.diagnosis.settings import RECORDS
from fdbench.record import FloatArray

SMALLEST = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseModel:
    """Noise of one channel.

    Attributes
    ----------
    spectrum : (n_frequencies,) array
        Mean square at frequencies from 0 Hz to half the sampling rate, in the squared unit of the channel.
    measured : bool
        Whether it comes from repeats; else it is assumed, see `assumed`.
    from_run_to_run : (n_frequencies,) array or None
        The same of what differs from run to run beside it: see `fdbench.diagnosis.evidence.run_to_run`.
    unseen : float
        Mean square from run to run that is to be expected besides, as few repeats may be alike by chance.
    """

    spectrum: FloatArray
    measured: bool
    from_run_to_run: FloatArray | None = None
    unseen: float = 0.0

    @cached_property
    def rms(self) -> float:
        """Standard deviation of a sample within a run, in the unit of the channel."""
        return max(math.sqrt(float(self.spectrum.sum())), SMALLEST)

    @property
    def at_high_frequencies(self) -> float:
        """Root mean square of the white noise that is as loud above half of the highest frequency."""
        return max(self.rms * math.sqrt(2.0 * float(self.shares((0.5, 1.0))[0])), SMALLEST)

    @cached_property
    def total(self) -> float:
        """Root mean square of what repeats differ by, over the root of two."""
        return self.rms if self.from_run_to_run is None else self.whole.rms

    @property
    def expected(self) -> float:
        """Mean square that repeats are to be expected to differ by, in units of what they did differ by."""
        return 1.0 + self.unseen / self.total**2

    @property
    def whole(self) -> "NoiseModel":
        """The floor in which what changes from run to run counts as noise."""
        if self.from_run_to_run is None:
            return self
        return dataclasses.replace(self, spectrum=self.spectrum + self.from_run_to_run, from_run_to_run=None)

    def shares(self, edges: Sequence[float]) -> FloatArray:
        """Return the shares of the noise within a run in bands of frequency, (n_edges - 1,).

        Parameters
        ----------
        edges : sequence of float
            Ascending, in units of half the sampling rate.

        Examples
        --------
        >>> white(1.0, measured=True).shares((0.0, 0.1, 1.0)).round(3).tolist()
        [0.1, 0.9]
        """
        n = len(self.spectrum)
        ends = np.clip((np.arange(n + 1) - 0.5) / (n - 1), 0.0, 1.0)
        below = np.concatenate(([0.0], np.cumsum(self.spectrum)))
        return np.asarray(np.diff(np.interp(edges, ends, below)) / max(below[-1], SMALLEST**2))


def white(rms: float, measured: bool) -> NoiseModel:
    """Return a floor that is alike at all frequencies."""
    spectrum = np.ones(RECORDS.piece_samples // 2 + 1)
    spectrum[[0, -1]] = 0.5
    return NoiseModel(spectrum=spectrum * (rms**2 / spectrum.sum()), measured=measured)


@dataclass(frozen=True, kw_only=True)
class Way:
    """How finely what repeats with the position is told, and after which way an axis that turns is where it was."""

    bin_m: float = RECORDS.profile_bin_m
    turn_m: float | None = None


def noise_floor(runs: Sequence[RecordedRun], channel: str, way: Way | None = None) -> NoiseModel:
    """Return the floor of a channel.

    With repeats (of records, or of laps within one) it is half of what they differ by, drift from repeat to repeat
    included. Without, it is `assumed`, from what is left where that does not repeat with the position.
    """
    found = differences(runs, channel)
    if found:
        return NoiseModel(spectrum=0.5 * spectrum_of(found), measured=True)
    left = [run.channels[channel] if run.left is None else run.left[channel] for run in runs]
    return NoiseModel(spectrum=assumed(without_profile(runs, left, way or Way())), measured=False)


def without_profile(runs: Sequence[RecordedRun], signals: Sequence[FloatArray], way: Way) -> list[FloatArray]:
    """Return signals without their mean at each position and direction, where the axis came by several times.

    What repeats with the position is no noise. A mean over V visits takes 1/V of the noise, which is given back.
    """
    if any(POSITION not in run.channels for run in runs):
        return list(signals)
    position = np.concatenate([run.channels[POSITION] for run in runs])
    speed = np.concatenate([np.gradient(run.channels[POSITION]) for run in runs])
    if way.turn_m is not None:
        position = np.mod(position, way.turn_m)
    cell = 2 * np.floor((position - position.min()) / way.bin_m).astype(np.intp) + (speed > 0.0)
    first = np.cumsum([0, *(len(values) for values in signals)])
    new = np.concatenate(([True], np.diff(cell) != 0))
    new[first[:-1]] = True
    visits = np.bincount(cell[new])
    values = np.concatenate(list(signals))
    samples = np.bincount(cell)
    mean = np.bincount(cell, weights=values) / np.maximum(samples, 1)
    often = visits[cell] >= RECORDS.fewest_visits
    kept = np.sqrt(visits / np.maximum(visits - 1, 1))[cell]
    left = np.where(often, (values - mean[cell]) * kept, values)
    return [left[start:end] for start, end in itertools.pairwise(first)]


def spectrum_of(signals: Sequence[FloatArray], length: int | None = None) -> FloatArray:
    """Return the mean square of signals at frequencies from 0 Hz to half the sampling rate, (n_frequencies,).

    By Welch's method (1967): pieces that overlap by half, Hann's window; scaled to the mean square of all samples.
    Without a ``length``, pieces are long ones where all signals are as long.
    """
    short, long = RECORDS.piece_samples, RECORDS.long_piece_samples
    length = length or (short if min(len(values) for values in signals) < long else long)
    power = _powers(signals, length, without_trend=False).mean(axis=0)
    mean_square = sum(float(values @ values) for values in signals) / sum(len(values) for values in signals)
    return np.asarray(power * (mean_square / max(float(power.sum()), SMALLEST**2)))


def assumed(signals: Sequence[FloatArray]) -> FloatArray:
    r"""Return the mean square at each frequency of the noise in what a model leaves, without repeats to tell it.

    Noise is what is there all the time and at no frequency in particular: of the spectra of all pieces of 256 samples
    (overlapping by half, without their trend) the quietest quarter counts, at each frequency, and of neighbouring
    frequencies the median. A gap that comes and goes with the motion, and lines, are left out; what is steady and
    broad counts as noise, and noise slower than a piece is not seen. A quartile of the power of Gaussian noise is its
    mean times :math:`\ln 4/3`.
    """
    piece, beside = RECORDS.piece_samples, RECORDS.neighbouring_frequencies
    power = _powers(signals, piece, without_trend=True)
    quiet = np.quantile(power, RECORDS.assumed_quantile, axis=0)[1:-1] / -math.log(1.0 - RECORDS.assumed_quantile)
    median = np.median(sliding_window_view(np.pad(quiet, beside, mode="edge"), 2 * beside + 1), axis=1)
    # At either end windows are not whole, and a line may be most of one: there the nearest whole window tells.
    whole = np.pad(median[beside:-beside], beside, mode="edge")
    smooth = np.where(median > RECORDS.line * whole, whole, median)
    return np.concatenate(([0.0], smooth / piece, [0.0]))


def _powers(signals: Sequence[FloatArray], length: int, *, without_trend: bool) -> FloatArray:
    """Return the one-sided power density of each piece, (n_pieces, length / 2 + 1), for a sampling rate of 1 Hz."""
    from scipy.signal import detrend, spectrogram

    every = [
        spectrogram(
            _long_enough(values, length),
            window="hann",
            nperseg=length,
            noverlap=length // 2,
            detrend=detrend if without_trend else False,
        )[2]
        for values in signals
    ]
    return np.asarray(np.concatenate(every, axis=1).T)


def _long_enough(values: FloatArray, length: int) -> FloatArray:
    missing = length - len(values)
    return np.pad(values, (0, missing), mode="reflect") if missing > 0 else values


def noise_models(runs: Sequence[RecordedRun], way: Way | None = None) -> Mapping[str, NoiseModel]:
    """Return the floor of each channel."""
    return {channel: noise_floor(runs, channel, way) for channel in runs[0].channels}


def raised(found: Mapping[str, NoiseModel], energy: Mapping[str, float]) -> Mapping[str, NoiseModel]:
    """Return floors that mean squares are added to, of what cannot be simulated sample by sample."""
    result = {}
    for name, floor in found.items():
        level = np.full(len(floor.spectrum), energy[name] / len(floor.spectrum))
        result[name] = dataclasses.replace(floor, spectrum=floor.spectrum + level)
    return result
