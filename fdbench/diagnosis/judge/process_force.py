"""Process force: what acts on the axis in a record of another condition, by inverse dynamics, whatever its course."""

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from fdbench.diagnosis.answer.process_force import Course, ProcessForce
from fdbench.diagnosis.evidence.inverse_dynamics import inertia_and_drag
from fdbench.diagnosis.judge.force_balance_check import smoothed
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.conditions import Apart
from fdbench.diagnosis.records.runs import RecordedRun, between_laps
from fdbench.diagnosis.settings import EVIDENCE, JUDGE
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray
from fdbench.statistics import rms

Channels = Mapping[str, FloatArray]


def process_forces(found: Sequence[Apart], readings: Readings, final: Hypothesis) -> list[ProcessForce]:
    """Return the force that acts in each record of another condition.

    Beside repeats of its command in the usual condition it is what differs from their mean, so that friction and every
    cause that the model lacks cancel; without, what differs from the final model, whose error is then that of the
    force.

    Parameters
    ----------
    found : sequence of Apart
    readings : Readings
        Along the runs of the usual condition, which tell how far the model can be trusted.
    final : Hypothesis
    """
    drive = final.nominal.drive
    return [_process_force(item, readings, final, drive) for item in found]


def unsteady_forces(runs: Sequence[RecordedRun], replay: Replay, nominal: Hypothesis) -> list[ProcessForce]:
    """Return the force that acts in each record where it does not repeat with the motion: beside the nominal model.

    A model that is fitted to such a record takes up a part of the force. What the nominal one leaves has the errors of
    its values in it, which the standard deviation does not count.
    """
    found = []
    for run in runs:
        force = force_on_axis(run, run.channels, replay.alone(run, nominal.variant), nominal.nominal.drive)
        found.append(described(run, force, _quiet(run, force), "nominal"))
    return found


def _process_force(item: Apart, readings: Readings, final: Hypothesis, drive: FeedDrive) -> ProcessForce:
    run, repeats = item.run, item.repeats
    by_model = partial(_error_of_model, readings, final, drive)
    if not repeats:
        usual: Channels = readings.replay.alone(run, final.variant)
        return described(run, force_on_axis(run, run.channels, usual, drive), by_model(), "model")
    usual = {name: np.mean([own.channels[name] for own in repeats], axis=0) for name in run.channels}
    force, error = force_on_axis(run, run.channels, usual, drive), _error_of_repeats(repeats, drive)
    if error is None:
        # Two records differ by no more noise than twice what the model leaves of one.
        error = min(_quiet(run, force), math.sqrt(2.0) * by_model())
    return described(run, force, error, "repeats")


def _error_of_model(readings: Readings, final: Hypothesis, drive: FeedDrive) -> float:
    """Return the root mean square of the force that the final model leaves of the runs of the usual condition."""
    lefts = [
        force_on_axis(own, own.channels, readings.alone(place, final), drive) for place, own in enumerate(readings.runs)
    ]
    return rms(np.concatenate(lefts))


def described(run: RecordedRun, force: FloatArray, error: float, beside: str) -> ProcessForce:
    """Return what is said of a force whose values are known to ``error``: how large while it acts, and its course."""
    time = run.time_s[0] + JUDGE.force_balance_margin_s + np.arange(len(force)) * run.period_s
    first, last = _acting(force, JUDGE.sure_of_force * error, run.period_s)
    there = force[first : last + 1]
    frequency, amplitude = _line(there, run.period_s)
    every = max(1, math.ceil(len(force) / JUDGE.force_points))
    return ProcessForce(
        record=run.name,
        condition=run.condition,
        beside=beside,
        rms_N=rms(there),
        mean_N=float(there.mean()),
        largest_N=float(there[np.argmax(np.abs(there))]),
        standard_deviation_N=error,
        range_s=(float(time[first]), float(time[last])),
        frequency_Hz=frequency,
        amplitude_N=amplitude,
        course=Course(time_s=tuple(time[::every].tolist()), force_N=tuple(force[::every].tolist())),
    )


def _acting(force: FloatArray, sure: float, period_s: float) -> tuple[int, int]:
    """Return the first and the last sample that are surely beyond zero, in stretches that are; without any, the ends.

    Among many samples some are beyond any bound by chance, whole stretches are not.
    """
    beyond = [(np.abs(part) > sure) & (rms(part) > sure) for part in _stretches(force, period_s)]
    places = np.flatnonzero(np.concatenate(beyond))
    return (int(places[0]), int(places[-1])) if len(places) else (0, len(force) - 1)


def force_on_axis(run: RecordedRun, channels: Channels, usual: Channels, drive: FeedDrive) -> FloatArray:
    r"""Return the force on an axis beyond what acts on it usually, below 60 Hz, without its ends, in N.

    .. math:: d = m \Delta\ddot x + B \Delta\dot x - \Delta F

    with the differences of position x and motor force F from those of the usual condition, the moved mass m and the
    viscous friction B. Derivatives and force are those in the middle between samples.
    """
    h = run.period_s
    x, force = (channels[name] - usual[name] for name in ("position_m", "motor_force_N"))
    found = inertia_and_drag(drive.mass_kg, drive.viscous_friction_N_s_per_m, x, h) - force[1:-2]
    margin = round(JUDGE.force_balance_margin_s / h)
    return np.asarray(smoothed(found, h)[margin : len(found) - margin])


def _error_of_repeats(repeats: Sequence[RecordedRun], drive: FeedDrive) -> float | None:
    """Return the root mean square of the force between two repeats, or two laps of one; None where there is neither."""
    first = repeats[0]
    if len(repeats) > 1:
        return rms(force_on_axis(first, repeats[1].channels, first.channels, drive))
    if first.lap is None:
        return None
    apart_by_a_lap = {name: between_laps(values, first.lap) for name, values in first.channels.items()}
    none = {name: np.zeros_like(values) for name, values in apart_by_a_lap.items()}
    return rms(force_on_axis(first, apart_by_a_lap, none, drive))


def _quiet(run: RecordedRun, force: FloatArray) -> float:
    """Return the standard deviation about the mean in the quietest tenth of short stretches."""
    return float(np.quantile([np.std(part) for part in _stretches(force, run.period_s)], 0.1))


def _stretches(force: FloatArray, period_s: float) -> list[FloatArray]:
    return np.array_split(force, max(1, round(len(force) * period_s / EVIDENCE.segment_s)))


def _line(force: FloatArray, period_s: float) -> tuple[float | None, float | None]:
    """Return frequency and amplitude of the strongest line, where it holds a quarter of the squares about the mean."""
    from scipy.signal import periodogram

    frequencies_Hz, power = periodogram(force, 1.0 / period_s, "hann")
    peak = int(np.argmax(power))
    share = float(power[max(0, peak - 2) : peak + 3].sum() / max(power.sum(), 1e-300))
    if peak < JUDGE.force_periods or share < JUDGE.force_line:
        return None, None
    near = slice(max(0, peak - 2), peak + 3)
    frequency = float(np.average(frequencies_Hz[near], weights=power[near]))
    return frequency, math.sqrt(2.0 * share * float(np.var(force)))
