"""Locate periods: the strongest lines of what the model lacks, over time and over position, and its resonances."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.fft import next_fast_len, rfft

from fdbench.diagnosis.evidence.inverse_dynamics import inverse_dynamics_residuals
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import PIECE
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.records.spectral_lines import at_peak, lines_in_time
from fdbench.diagnosis.search.resonances import resonances
from fdbench.diagnosis.settings import RECORDS, SEARCH
from fdbench.record import FloatArray


def located(readings: Readings, split: Split, base: Hypothesis) -> Mapping[str, list[float]]:
    """Return lines, resonances (Hz), wavelengths (m) of what the model lacks; see `fdbench.effects.Parameter.locate`.

    Lines are sought in the residual over time; wavelengths in the inverse-dynamics residual over position, also
    multiplied by the motor force, to expose effects that are proportional to it. Pitches are the wavelengths that a
    motor may have: a slow change along the way is one only at a known order of its turn. What changes from run to run
    is shrunk to the noise, for it may be far larger.
    """
    simulated: list[dict[str, FloatArray]] = []
    for place, run in enumerate(split.runs):
        found = readings.alone(place, base)
        finite = np.logical_and.reduce([np.isfinite(values) for values in found.values()])
        simulated.append({name: np.where(finite, values, run.channels[name]) for name, values in found.items()})
    in_noise = [split.gap(place, own) for place, own in enumerate(simulated)]
    gaps = [
        {name: values / split.per_unit(place, name) for name, values in own.items()}
        for place, own in enumerate(in_noise)
    ]
    scaled = [np.stack([values for name, values in own.items() if name != "position_m"]) for own in in_noise]
    turned = [gap * np.sign(run.reference[:, 1]) for gap, run in zip(scaled, split.runs, strict=True)]
    lacking = [
        inverse_dynamics_residuals(run, own, split.noise_models, base.nominal.drive)
        for run, own in zip(split.runs, gaps, strict=True)
    ]
    turn_m, length, period_s = base.nominal.turn_m, base.nominal.scale.length, split.runs[0].period_s
    times_force = [own * run.channels["motor_force_N"][1:-2] for own, run in zip(lacking, split.runs, strict=True)]
    waves, waves_of_ratio = (_lines_in_position(own, split.runs, turn_m, length) for own in (lacking, times_force))
    travel = _travel(split.runs)[1]
    pitches, pitches_of_ratio = (_pitches(own, travel, turn_m, length) for own in (waves, waves_of_ratio))
    return {
        "line": lines_in_time(scaled, period_s),
        "line_of_motion": lines_in_time(turned, period_s),
        "wavelength": waves,
        "pitch": pitches,
        "pitch_of_ratio": pitches_of_ratio,
        "resonance": resonances([own[-1] for own in lacking], split, base.nominal.drive),
    }


def _pitches(waves: Sequence[float], travel: float, turn_m: float | None, length: float) -> list[float]:
    """Return the wavelengths that a motor may have: short ones, and long ones at a known order of its turn."""
    longest_m = max(length * SEARCH.longest_pitch_m, travel / SEARCH.long_waves)
    orders = () if turn_m is None else [turn_m / order for order in SEARCH.orders]
    off = SEARCH.of_an_order / travel
    return [wave for wave in waves if wave <= longest_m or any(abs(1.0 / wave - 1.0 / own) < off for own in orders)]


def _travel(runs: Sequence[RecordedRun]) -> tuple[float, float]:
    """Return the lowest position of all runs, and how far the highest is from it."""
    lowest = min(float(run.channels["position_m"].min()) for run in runs)
    return lowest, max(float(run.channels["position_m"].max()) for run in runs) - lowest


def _lines_in_position(
    gaps: Sequence[FloatArray], runs: Sequence[RecordedRun], turn_m: float | None, length: float
) -> list[float]:
    """Return the wavelengths that stand out in the profiles over position, and orders of the lead that may be there.

    Each run and direction has a profile of its own: the loop shifts a wave by its lag, friction turns its sign. Short
    waves are sought octave by octave in what the mean over the longest of each leaves: at a steady speed samples lie a
    way apart that a slow change would be taken for a wave of; of waves that pass faster at the median speed there is
    nothing else. Motors and screws repeat at known orders, where less is needed to be tried, and of long ones nothing.
    """
    speeds = np.concatenate([np.abs(run.reference[:, 1]) * run.period_s for run in runs])
    steps = speeds[speeds > RECORDS.resting * speeds.max()]
    shortest_wave_m = max(length * SEARCH.shortest_wave_m, 2.0 * float(np.median(steps)) if len(steps) else 0.0)
    lowest, travel = _travel(runs)
    if travel < 2.0 * shortest_wave_m:
        return []
    n_bins = max(64, round(travel / (length * SEARCH.bin_m)))
    n_padded = next_fast_len(SEARCH.oversampling * n_bins, real=True)
    wavenumber = np.asarray(np.fft.rfftfreq(n_padded, travel / n_bins), dtype=np.float64)
    octaves = [(SEARCH.fewest_waves / travel, SEARCH.long_waves / travel)]
    while octaves[-1][1] * shortest_wave_m < 1.0:
        octaves.append((octaves[-1][1], 2.0 * octaves[-1][1]))
    widths = [round(n_bins / (low * travel)) for low, _ in octaves]
    power = np.zeros((len(octaves), len(wavenumber)))
    parts: list[tuple[FloatArray, FloatArray]] = []
    for run, gap in zip(runs, gaps, strict=True):
        inside = slice(1, 1 + gap.shape[1])
        position, speed = run.channels["position_m"][inside], run.reference[inside, 1]
        place = np.minimum(((position - lowest) * (n_bins / travel)).astype(np.intp), n_bins - 1)
        for moving in (speed > 0.0, speed < 0.0):
            visits = np.bincount(place[moving], minlength=n_bins).astype(np.float64)
            left = []
            for own in gap:
                sums = np.bincount(place[moving], weights=own[moving], minlength=n_bins).astype(np.float64)
                slow = [_local_mean(sums, visits, width) for width in widths]
                profiles = np.stack([sums - visits * mean for mean in slow])
                left.append(own[moving] - slow[:2][-1][place[moving]])  # a short travel has long waves alone
                power += np.abs(rfft(profiles / np.sqrt(np.maximum(visits, 1.0)), n_padded)) ** 2
            parts.append((position[moving], np.stack(left)))
    resolved = max(3, round(2.0 / travel / float(wavenumber[1])))
    # What is slower has more power than any pitch, also at the ways of a sample at its speeds; it goes before.
    height = np.zeros(len(wavenumber))
    for own, (low, high) in zip(power[1:], octaves[1:], strict=True):
        within = (wavenumber >= low) & (wavenumber < high)
        height[within] = (own / _around(own, resolved))[within]
    found: list[float] = []
    band = np.where(wavenumber <= SEARCH.long_waves / travel, power[0], 0.0)
    for peak in _peaks(np.where(wavenumber >= SEARCH.fewest_waves / travel, band, 0.0), resolved, SEARCH.lines):
        found.append(1.0 / at_peak(wavenumber, power[0], peak))
    band = np.where(wavenumber <= 1.0 / shortest_wave_m, height, 0.0)
    peaks = [at_peak(wavenumber, height, peak) for peak in _peaks(band, resolved, SEARCH.standing_out)]
    found += [1.0 / wave for wave in _telling(peaks, parts)]
    for pitch_m in () if turn_m is None else [turn_m / order for order in SEARCH.orders]:
        near = np.abs(wavenumber - 1.0 / pitch_m) < 0.5 * wavenumber[resolved]
        is_long = pitch_m > travel / SEARCH.long_waves
        apart = SEARCH.of_an_order / travel if is_long else wavenumber[resolved]
        if (
            shortest_wave_m < pitch_m < travel / SEARCH.fewest_waves
            and (is_long or height[near].max(initial=0.0) > SEARCH.above)
            and all(abs(1.0 / pitch_m - 1.0 / other) > apart for other in found)
        ):
            found.append(pitch_m)
    return found


def _peaks(band: FloatArray, resolved: int, most: int) -> list[int]:
    """Return the places of the highest peaks, the highest first, that are apart by what is resolved."""
    left, found = band.copy(), []
    for _ in range(most):
        peak = int(np.argmax(left))
        if left[peak] <= 0.0:
            break
        found.append(peak)
        left[max(0, peak - resolved) : peak + resolved + 1] = 0.0
    return found


def _telling(waves: Sequence[float], parts: Sequence[tuple[FloatArray, FloatArray]]) -> list[float]:
    """Return which waves (1/m) are tried: what takes a good part of the squares of a gap, else what stands out most.

    At a steady speed samples are equally far apart, and a strong wave has aliases there, which may stand out more
    sharply than itself; they take nothing where the speed is another. What is weak is told from noise by standing out.

    Parameters
    ----------
    waves : sequence of float
        What stands out most is first.
    parts : sequence of pairs of arrays
        Positions (n,) and gap (n_channels, n) in each run and direction, without what is slow.
    """
    amplitudes = [_Amplitudes.of(gap, position, waves) for position, gap in parts]
    found: list[float] = []
    left = list(range(len(waves)))
    while left and len(found) < SEARCH.pitches:
        taken = np.sum([part.taken() for part in amplitudes], axis=0)[left]
        best = int(np.argmax(taken))
        if taken[best] < SEARCH.strong_wave * sum(part.squares for part in amplitudes):
            best = 0
        number = left.pop(best)
        for part in amplitudes:
            part.take(number)
        found.append(waves[number])
    return found


class _Amplitudes:
    """Least-squares fits of waves over the position to rows of values, one wave after another taken from them.

    Parameters
    ----------
    gram : (2, n_waves, 2, n_waves) array
        Products of cosine and sine of each wave with those of each.
    along : (2, n_waves, n_rows) array
        Products of these with the values.
    squares : float
        Of the values.
    """

    def __init__(self, gram: FloatArray, along: FloatArray, squares: float) -> None:
        self.gram, self.along, self.squares = gram, along, squares

    @classmethod
    def of(cls, values: FloatArray, position: FloatArray, waves: Sequence[float]) -> "_Amplitudes":
        """Return the products of values (n_rows, n) and of waves (1/m) at positions (n,)."""
        n = 2 * len(waves)
        gram, along = np.zeros((n, n)), np.zeros((n, len(values)))
        turns = 2.0 * np.pi * np.asarray(waves)
        for first in range(0, len(position), PIECE):
            here = slice(first, first + PIECE)
            angle = np.outer(turns, position[here])
            basis = np.concatenate((np.cos(angle), np.sin(angle)))
            gram += basis @ basis.T
            along += basis @ values[:, here].T
        shape = (2, len(waves))
        return cls(gram.reshape(*shape, *shape), along.reshape(*shape, len(values)), float(np.sum(values**2)))

    def taken(self) -> FloatArray:
        """Return the squares that each wave alone takes of the values, (n_waves,)."""
        own = np.einsum("awbw->wab", self.gram)
        amplitudes = self._fitted(own, self.along.transpose(1, 0, 2))
        return np.asarray(np.einsum("war,wab,wbr->w", amplitudes, own, amplitudes))

    def take(self, number: int) -> None:
        """Take a wave from the values."""
        own, along = self.gram[:, number, :, number], self.along[:, number]
        amplitudes = self._fitted(own, along)
        self.squares += float(np.sum(amplitudes * (own @ amplitudes - 2.0 * along)))
        self.along = self.along - np.einsum("awb,br->awr", self.gram[:, :, :, number], amplitudes)

    @staticmethod
    def _fitted(own: FloatArray, along: FloatArray) -> FloatArray:
        trace = np.trace(own, axis1=-2, axis2=-1)
        return np.asarray(np.linalg.solve(own + 1e-9 * (1.0 + trace)[..., None, None] * np.eye(2), along))


def _local_mean(sums: FloatArray, visits: FloatArray, width: int) -> FloatArray:
    """Return the mean of what was summed within a width around each bin, or of everything where that is less."""
    from scipy.ndimage import uniform_filter1d

    if width >= len(sums):
        return np.full(len(sums), sums.sum() / max(float(visits.sum()), 1.0))
    around, many = (uniform_filter1d(values, width, mode="constant") for values in (sums, visits))
    return np.asarray(around / np.maximum(many, 0.5 / width))


def _around(power: FloatArray, resolved: int) -> FloatArray:
    """Return the geometric mean of the power within some resolved wavenumbers of each, and not next to it."""
    around = SEARCH.around * resolved
    logs = np.pad(np.log(np.maximum(power, 1e-30)), around, mode="reflect")
    wide, near = (
        np.convolve(logs, np.ones(2 * half + 1), "same")[around : len(power) + around] for half in (around, resolved)
    )
    return np.asarray(np.exp((wide - near) / (2 * (around - resolved))))
