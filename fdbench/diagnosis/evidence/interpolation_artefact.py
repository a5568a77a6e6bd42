"""Interpolation errors of an encoder, which readings show by themselves: a wave over the reading, far below a turn.

A model would have to know the true position to a part of the encoder's signal period, a few micrometres, to follow such
an error sample by sample. The readings know it: between neighbouring samples no axis moves as its encoder errs.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from fdbench.diagnosis.evidence.sensor_artefacts import Artefact, changed_by, readings_of
from fdbench.diagnosis.model.candidates import phase_of
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.diagnosis.records.runs import FORCE, RecordedRun
from fdbench.diagnosis.settings import EVIDENCE
from fdbench.effects import Effect, Parameter, Port
from fdbench.record import FloatArray

BENDS = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0  # of a cubic nothing is left, of what is random about all
SUDDEN = 3.0  # times what 95 % of the bends are below
SAME = 1e-9  # of the travel, by which equal readings differ by rounding
ROUNDS = 3  # the wave is one over the true position, which readings less the wave are
TURNS, FEWEST = 32, 40  # bins of the wave's turn from sample to sample, and samples that make one
PARTS = 40  # of a run, that belong in turn to either of two halves


@dataclass(frozen=True, kw_only=True)
class _Wave:
    """Error a cos(2 pi y / p) + b sin(2 pi y / p) over the reading y, as a - ib; how far halves and runs differ."""

    period_m: float
    error: complex
    spread: float


@dataclass(frozen=True, kw_only=True)
class InterpolationError:
    """Error that an encoder makes, as an effect, whose parameter ``length`` is that of the wave.

    Its size (m) may be beyond the effect's bounds.
    """

    effect: Effect
    length: str
    size_m: float
    low_m: float
    high_m: float


def waves(library: Iterable[type[Effect]]) -> tuple[str, ...]:
    """Return the names of effects that are a wave over the reading; what readings do not show, no simulation does."""
    return tuple(kind.name for kind in library if _wave_of(kind) is not None)


def interpolation_error(runs: Sequence[RecordedRun], nominal: Nominal) -> InterpolationError | None:
    r"""Return the error that an encoder makes by a wave over its reading, or None.

    With the readings :math:`y_k` and their bend :math:`d_k`, a fourth difference, the period is where

    .. math:: P(\kappa) = \sum_{\text{runs}} \left|\sum_k d_k e^{-i \kappa y_k}\right|^2 / \sum_k d_k^2

    is largest; samples may be further apart than the wave is long. The wave is fitted to two halves of each run, parts
    of it in turn, and is there where both agree, and all runs on its size.

    Parameters
    ----------
    runs : sequence of RecordedRun
        As read.
    nominal : Nominal
        Waves longer than a part of a turn of its motor may be true motion.
    """
    found: list[tuple[float, InterpolationError]] = []
    for kind in nominal.library:
        length = _wave_of(kind)
        if length is None:
            continue
        readings = [
            values for values in readings_of(runs, nominal.drive, kind.port) if len(values) > len(BENDS) * PARTS
        ]
        wave = _strongest(readings, nominal.turn_m, length)
        if wave is None or wave.spread > EVIDENCE.wave_spread:
            continue
        size = abs(wave.error)
        shape = {length.name: wave.period_m, str(phase_of(kind)): math.atan2(wave.error.real, -wave.error.imag)}
        effect = kind.typical(**shape).within(**{kind.amplitude: size})
        low, high = size * (1.0 - wave.spread), size * (1.0 + wave.spread)
        found.append(
            (wave.spread, InterpolationError(effect=effect, length=length.name, size_m=size, low_m=low, high_m=high))
        )
    return min(found, key=lambda item: item[0])[1] if found else None


def interpolation_artefact(
    error: InterpolationError, runs: Sequence[RecordedRun], replay: Replay, noise_models: Mapping[str, NoiseModel]
) -> Artefact:
    """Return the artefact, as probably a cause as it is larger than what every encoder has, in the run where it is so.

    Parameters
    ----------
    error : InterpolationError
    runs : sequence of RecordedRun
    replay : Replay
    noise_models : mapping of str to NoiseModel
        Of each channel.
    """
    of_runs = [_energy(run, replay, error) for run in runs]
    samples = [run.n_samples for run in runs]
    largest = max(np.mean([own[name] / floor.rms**2 for name, floor in noise_models.items()]) for own in of_runs)
    odds = (float(largest) / EVIDENCE.usual_wave) ** EVIDENCE.wave_slope
    return Artefact(
        kind=type(error.effect),
        probability=odds / (1.0 + odds),
        value=error.size_m,
        low=error.low_m,
        high=error.high_m,
        energy={name: float(np.average([own[name] for own in of_runs], weights=samples)) for name in noise_models},
    )


def _energy(run: RecordedRun, replay: Replay, error: InterpolationError) -> dict[str, float]:
    """Return the mean square that the error brings into each channel of a run, in the channel's unit squared.

    The force has no more of it than was measured: a loop may filter what its model does not.
    """
    # A scaled bound of the effect is no bound of the readings.
    beyond = error.size_m / float(getattr(error.effect, error.effect.amplitude))
    changes = {name: beyond * own for name, own in changed_by(error.effect, run, replay).items()}
    energy = {name: float(np.mean(own**2)) for name, own in changes.items()}
    readings = next(readings_of([run], replay.drive, error.effect.port))
    expected = float(np.mean(np.convolve(changes[FORCE], BENDS, "valid") ** 2))
    measured = _coherent(np.convolve(run.channels[FORCE], BENDS, "valid"), readings[2:-2], error)
    energy[FORCE] *= min(measured / expected, 1.0) if expected > 0.0 else 1.0
    return energy


def _coherent(values: FloatArray, readings: FloatArray, error: InterpolationError) -> float:
    """Return the mean square of what goes with the wave, whatever gain and phase a loop has at each frequency.

    In a sampled loop these depend on the turn of the wave from one sample to the next alone.
    """
    angle = 2.0 * math.pi / float(getattr(error.effect, error.length)) * readings
    turn = np.remainder(np.gradient(angle), 2.0 * math.pi)
    place = np.minimum((turn * (TURNS / (2.0 * math.pi))).astype(np.intp), TURNS - 1)
    steady = ~_is_sudden(values)
    explained = 0.0
    for own in range(TURNS):
        inside = steady & (place == own)
        if inside.sum() < FEWEST:
            continue
        columns = np.stack((np.cos(angle[inside]), np.sin(angle[inside])))
        right = columns @ values[inside]
        power = float(right @ np.linalg.lstsq(columns @ columns.T, right, rcond=None)[0])
        left = max(float(values[inside] @ values[inside]) - power, 0.0)
        explained += power - 2.0 * left / (float(inside.sum()) - 2.0)  # two columns explain as much of mere noise
    return max(explained, 0.0) / max(int(steady.sum()), 1)


def _wave_of(kind: type[Effect]) -> Parameter | None:
    """Return the parameter of an encoder's effect that is the length of a wave over its reading, if it has one."""
    if kind.port not in (Port.MOTOR_ENCODER, Port.TABLE_SCALE) or kind.states or phase_of(kind) is None:
        return None
    lengths = [item for item in kind.parameters() if item.unit == "m" and item.name != kind.amplitude]
    return lengths[0] if len(lengths) == 1 else None


def _strongest(readings: Sequence[FloatArray], turn_m: float | None, bounds: Parameter) -> _Wave | None:
    """Return the wave with most power over some readings; None where none is possible."""
    if not readings:
        return None
    lowest = min(float(values.min()) for values in readings)
    travel = max(float(values.max()) for values in readings) - lowest
    if travel <= 0.0:
        return None
    longest = min(
        travel / EVIDENCE.wave_fewest, bounds.high, math.inf if turn_m is None else turn_m / EVIDENCE.wave_of_turn
    )
    shortest = max(travel / EVIDENCE.wave_most, bounds.low, 2.0 * _grid(readings, travel))
    if longest <= shortest:
        return None
    n_bins = math.ceil(4.0 * travel / shortest)
    n_padded = next_fast_len(2 * n_bins, real=True)
    bends = [np.convolve(values, BENDS, "valid") for values in readings]
    power = np.zeros(n_padded // 2 + 1)
    for values, bend in zip(readings, bends, strict=True):
        steady = np.where(_is_sudden(bend), 0.0, bend)
        place = np.minimum(((values[2:-2] - lowest) * (n_bins / travel)).astype(np.intp), n_bins - 1)
        sums = np.bincount(place, steady, minlength=n_bins)
        power += np.abs(np.fft.rfft(sums, n_padded)) ** 2 / max(float(steady @ steady), 1e-300)
    wavenumber = np.arange(len(power)) * (n_bins / travel / n_padded)
    power[(wavenumber < 1.0 / longest) | (wavenumber > 1.0 / shortest)] = 0.0
    peak = int(np.argmax(power))
    # Where the power of a run is P, its halves differ by 1 / sqrt(P) of the wave, root mean square.
    if power[peak] < 0.5 * len(readings) / EVIDENCE.wave_spread**2:
        return None
    middle, wave = float(wavenumber[peak]), None
    for step in (0.5, 0.125):
        tried = [_fitted(readings, bends, 1.0 / (middle + n * step * float(wavenumber[1]))) for n in range(-2, 3)]
        wave = max(tried, key=lambda own: abs(own.error))
        middle = 1.0 / wave.period_m
    return wave


def _grid(readings: Sequence[FloatArray], travel: float) -> float:
    """Return the step of readings that lie on a grid; of others, what lies between the two that are nearest.

    On a grid a wave below two steps looks like a longer one, which may be true motion.
    """
    steps = np.diff(np.unique(np.concatenate(readings)))
    return float(np.min(steps[steps > SAME * travel], initial=travel))


def _is_sudden(bend: FloatArray) -> NDArray[np.bool_]:
    """Return where the motion itself bends, as at the steps of a command."""
    size = np.abs(bend)
    return np.asarray(size > SUDDEN * np.quantile(size, 0.95))


def _error(wave: complex, position: FloatArray, period_m: float) -> FloatArray:
    """Return the error at positions."""
    angle = 2.0 * math.pi / period_m * position
    return np.asarray(wave.real * np.cos(angle) - wave.imag * np.sin(angle))


def _fitted(readings: Sequence[FloatArray], bends: Sequence[FloatArray], period_m: float) -> _Wave:
    """Return the wave of a period, fitted to the bends of readings; its phase may differ from run to run.

    Each run counts by the squares of the bends that a wave has there: where an axis creeps there are hardly any, and
    any size fits.
    """
    errors, between, told = [], [], []
    for values, bend in zip(readings, bends, strict=True):
        first, steady = np.arange(len(bend)) * PARTS // len(bend) % 2 == 0, ~_is_sudden(bend)
        halves, true = [0j, 0j], values
        for _ in range(ROUNDS):
            true = values - _error(0.5 * (halves[0] + halves[1]), true, period_m)
            angle = 2.0 * math.pi / period_m * true
            columns = np.stack([np.convolve(own, BENDS, "valid") for own in (np.cos(angle), np.sin(angle))])
            for place, half in enumerate((first & steady, ~first & steady)):
                part = columns[:, half]
                found = np.linalg.lstsq(part @ part.T, part @ bend[half], rcond=None)[0]
                halves[place] = complex(found[0], -found[1])
        errors.append(0.5 * (halves[0] + halves[1]))
        between.append(abs(0.5 * (halves[0] - halves[1])))
        told.append(max(float(np.sum(columns[:, steady] ** 2)), 1e-300))
    sizes = np.abs(errors)
    size = math.sqrt(float(np.average(sizes**2, weights=told)))
    # What the motion itself has of such a wave is in some runs, an encoder errs alike in all.
    apart = np.square(between) + (sizes - np.average(sizes, weights=told)) ** 2
    spread = math.sqrt(float(np.average(apart, weights=told))) / max(size, 1e-300)
    clearest = errors[int(np.argmax(told))]
    return _Wave(period_m=period_m, error=size * clearest / max(abs(clearest), 1e-300), spread=spread)
