"""Alignment: say what is wrong with a record before anybody explains it by physics."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fdbench.diagnosis.records.damage import check_damage, check_force_is_alive, check_force_is_own
from fdbench.diagnosis.records.runs import COMMAND, FORCE, POSITION, RecordedRun
from fdbench.diagnosis.settings import PLAUSIBLE
from fdbench.errors import RecordError
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray, Record
from fdbench.rotary import spoken_unit
from fdbench.units import time_text

PREFIXES = {1e3: "a thousand: millimetres, milliseconds or kilonewtons", 1e6: "a million: micrometres"}


def check_sizes(record: Record) -> None:
    """Raise a RecordError where a column reaches values that no machine has."""
    for name, values in record.items():
        place = int(np.argmax(np.abs(values)))
        if name != "time_s" and abs(values[place]) > PLAUSIBLE.largest_value:
            raise RecordError(
                f"{record.source}: {name} is {values[place]:.4g} at sample {place}. A damaged sample, which has to be "
                "cut out, or a wrong unit or gain in the mapping."
            )


def check_content(runs: Sequence[RecordedRun]) -> None:
    """Raise a RecordError where the force of a run has a damaged sample, or no run shows a motion or a force."""
    for run in runs:
        force = np.abs(run.channels[FORCE])
        usual, place = float(np.quantile(force, 0.99)), int(np.argmax(force))
        if force[place] > PLAUSIBLE.force_peak * usual > 0.0:
            raise RecordError(
                f"{run.name}: {FORCE} reaches {force[place]:.4g} N at sample {place}, and hardly ever more than "
                f"{usual:.3g} N elsewhere. Probably a damaged sample: cut it out, or split the record there."
            )
    if not any(float(np.ptp(run.channels[FORCE])) > 0.0 for run in runs):
        raise RecordError(
            f"{runs[0].name}: {FORCE} never changes. Log the controller's output at the motor, or check which column "
            "is mapped to it."
        )
    if not any(_moves(run) for run in runs):
        raise RecordError(
            f"{runs[0].name}: the axis stands still throughout, so nothing can be said of it. Record strokes both ways "
            "at several speeds; a rest may be one record beside them."
        )


def noise_estimate(values: FloatArray) -> float:
    """Return the standard deviation of the white noise in a channel, from differences that no motion is left in."""
    return float(np.median(np.abs(np.diff(values, 4)))) / (0.6745 * math.sqrt(70.0)) if len(values) > 4 else 0.0


def _moves(run: RecordedRun) -> bool:
    position = run.channels[POSITION]
    commanded = run.motion is None and float(np.ptp(run.reference[:, 0])) > 0.0
    return commanded or float(np.ptp(position)) > PLAUSIBLE.motion * noise_estimate(position)


def check_record(run: RecordedRun, drive: FeedDrive) -> None:
    """Raise a RecordError where a run cannot belong to the drive, before anything is simulated.

    Parameters
    ----------
    run : RecordedRun
    drive : FeedDrive
        The nominal model: its travel and velocity limit, and whether its controller closes a position loop.

    Raises
    ------
    RecordError
        If the record is too short, a unit is wrong, a sign is swapped or two columns do not belong together; the
        message says what to do.
    """
    duration_s = run.n_samples * run.period_s
    fewest, shortest_s = PLAUSIBLE.fewest_samples, PLAUSIBLE.shortest_s
    if run.n_samples < fewest or duration_s < shortest_s:
        raise RecordError(
            f"{run.name}: {run.n_samples} samples, {time_text(duration_s)}; needed: {fewest} samples and "
            f"{shortest_s:g} s at least. Record several strokes at several speeds; or is time_s in another unit?"
        )
    position, velocity = run.channels[POSITION], run.reference[:, 1]
    followed = run.motion is not None
    name, command = (POSITION, position) if followed else (COMMAND, run.reference[:, 0])
    span, fastest = float(np.ptp(command)), float(np.abs(velocity).max())
    slope = _rate_ratio(command, velocity, run.period_s) if span > 0.0 and not followed else 1.0
    _check_rate(run, "reference_velocity_m_per_s", COMMAND, slope)
    _check_acceleration(run)
    steps = np.abs(np.diff(position))
    place, longest = int(np.argmax(steps)), drive.velocity_limit_m_per_s * run.period_s
    if steps[place] > PLAUSIBLE.position_step * max(longest, float(np.quantile(steps, 0.99))):
        raise RecordError(
            f"{run.name}: {POSITION} jumps by {steps[place]:.3g} m after sample {place}; at the model's velocity limit "
            f"it moves {longest:.3g} m between samples. Damaged samples, or two recordings in one: split it there."
        )
    check_damage(run, drive, noise_estimate(position))
    for does, value, sides, limit, key, unit in (
        ("spans", span, 2.0, drive.travel_m, "travel_m", "m"),
        ("reaches", fastest, 1.0, drive.velocity_limit_m_per_s, "velocity_limit_m_per_s", "m/s"),
    ):
        if value > PLAUSIBLE.outside * sides * limit:
            usual = spoken_unit("m")
            raise RecordError(
                f"{run.name}: the {'motion' if followed else 'command'} {does} {value:.4g} {unit}, the model's {key} "
                f"is {limit:g}. Probably the unit of {name} or time_s is not {usual} or s; a mapping file converts it: "
                f'unit = "{"mm" if usual == "m" else "deg"}".'
            )
    if span == 0.0 and float(np.ptp(position)) > PLAUSIBLE.unmoved * drive.travel_m:
        raise RecordError(
            f"{run.name}: {COMMAND} never changes, but {POSITION} moves by {np.ptp(position):.3g} m. Check which "
            f"column is mapped to {COMMAND}; without that column the measured motion is followed."
        )
    if drive.controller.action_name == POSITION and span > 0.0 and not followed:
        _check_position(run, command, span)


def _check_acceleration(run: RecordedRun) -> None:
    """Refuse an acceleration of the command that gains another speed; a noisy rate of the speed would not tell."""
    speed, gained = run.reference[:, 1], np.cumsum(run.reference[:, 2]) * run.period_s
    if abs(_correlation(speed, gained)) >= PLAUSIBLE.same_shape:
        _check_rate(run, "reference_acceleration_m_per_s2", "the commanded velocity", _slope(speed, gained))


def _check_rate(run: RecordedRun, name: str, of: str, ratio: float) -> None:
    """Refuse a rate of the command that is many times what the command changes by, or turned."""
    if not 1.0 / PLAUSIBLE.other_unit < ratio < PLAUSIBLE.other_unit:
        raise RecordError(
            f"{run.name}: {name} is {ratio:.4g} times the change of {of} in a second.{_factor_words(ratio)} Mend its "
            "unit or sign in the mapping, or leave it out."
        )


def _check_position(run: RecordedRun, command: FloatArray, span: float) -> None:
    position = run.channels[POSITION]
    slope, correlation = _slope(command, position), _correlation(command, position)
    if correlation < PLAUSIBLE.swapped:
        raise RecordError(
            f"{run.name}: position_m runs against reference_position_m (correlation {correlation:.2f}). Probably the "
            "sign of one of them is swapped; gain = -1 in the mapping turns it."
        )
    if correlation < PLAUSIBLE.unrelated:
        raise RecordError(
            f"{run.name}: position_m does not follow reference_position_m (correlation {correlation:.2f}). Probably "
            "one of them is of another axis or another run."
        )
    if not 1.0 / PLAUSIBLE.other_unit < slope < PLAUSIBLE.other_unit:
        raise RecordError(
            f"{run.name}: position_m moves {slope:.4g} times as far as reference_position_m.{_factor_words(slope)} "
            "A mapping file converts units."
        )
    offset = float(np.median(position - command))
    if abs(offset) > PLAUSIBLE.other_zero * span:
        raise RecordError(
            f"{run.name}: position_m lies {offset:.4g} m beside reference_position_m throughout. Probably the two have "
            f"different zero points; offset = {-offset:.6g} in the mapping shifts position_m."
        )


def check_alignment(run: RecordedRun, simulated: Mapping[str, FloatArray], *, unit_is_told: bool = False) -> list[str]:
    """Compare a run with its nominal simulation, and return warnings in words.

    Parameters
    ----------
    run : RecordedRun
    simulated : mapping of str to (n_samples,) array
        Channels of the same command on the nominal model, not re-calibrated.
    unit_is_told : bool
        Whether the unit of the force is right, as its controller tells (`fdbench.diagnosis.records.asked_force`): its
        size is the machine's, then.

    Raises
    ------
    RecordError
        If the two differ so much in sign, scale or kind that no effect could explain it; the message says what to do.
    """
    force, model = run.channels[FORCE], simulated[FORCE]
    if float(np.ptp(run.reference[:, 0])) == 0.0 or float(np.ptp(force)) == 0.0:
        return [f"{run.name}: the command or the force never changes; such a run shows next to nothing of the axis."]
    if not all(np.isfinite(values).all() for values in simulated.values()):
        raise RecordError(
            f"{run.name}: the simulation of this command diverges. Check that time_s is in seconds (one sample takes "
            f"{run.period_s:.4g} s), and the gains of the model's controller."
        )
    warnings = []
    greatest = float(np.abs(model).max())
    limited = float(np.mean(np.abs(model) > 0.99 * greatest))
    delays = {name: delay_of(run, simulated, name) for name in (FORCE, POSITION)}
    correlation, opposed = (_correlation(np.roll(model, round(delays[name])), force) for name in (FORCE, POSITION))
    ratio = float(force.std() / max(model.std(), 1e-12))
    if limited > PLAUSIBLE.at_limit and correlation < PLAUSIBLE.alike:
        raise RecordError(
            f"{run.name}: the simulated force is at its limit in {limited:.0%} of the samples, so the model's loop is "
            f"unstable at one sample each {run.period_s:.4g} s. Check that time_s is in seconds, that the record has "
            "every cycle of the controller and not each tenth, and the controller's gains."
        )
    if opposed < PLAUSIBLE.swapped:
        raise RecordError(
            f"{run.name}: measured and simulated force run against each other (correlation {opposed:.2f}). Probably "
            "the sign of the force is swapped; a negative gain in the mapping turns it."
        )
    in_time = np.roll(model, round(delays[FORCE]))
    check_force_is_alive(run, in_time)
    if correlation < PLAUSIBLE.alike:
        check_force_is_own(run, in_time)
    if correlation < PLAUSIBLE.unrelated:
        warnings.append(
            f"{run.name}: measured and simulated force have next to nothing in common (correlation {correlation:.2f}). "
            "Another column or axis, or a force that the model lacks and that hides all others."
        )
    is_of_another_size = not 1.0 / PLAUSIBLE.wrong_gain < ratio < PLAUSIBLE.wrong_gain
    if correlation > PLAUSIBLE.alike and is_of_another_size and not unit_is_told:
        text = (
            f"{run.name}: the measured force is {ratio:.4g} times the simulated one, with the same shape (correlation "
            f"{correlation:.2f}).{_factor_words(ratio)} Probably its gain (N for each volt, ampere or newton metre) is "
            "wrong."
        )
        if not 1.0 / PLAUSIBLE.useless_gain < ratio < PLAUSIBLE.useless_gain:
            raise RecordError(text)
        warnings.append(f"{text} If not, nominal mass and friction are far off.")
    return warnings


def clock_warnings(run: RecordedRun, simulated: Mapping[str, FloatArray]) -> list[str]:
    """Return warnings of channels that come after or before a simulation throughout.

    Parameters
    ----------
    run : RecordedRun
    simulated : mapping of str to (n_samples,) array
        Channels of the same command; of the re-calibrated model, as too much friction delays a loop as well.
    """
    if float(np.ptp(run.reference[:, 0])) == 0.0:
        return []
    delays = {name: delay_of(run, simulated, name) for name in (FORCE, POSITION)}
    late = {name: delay for name, delay in delays.items() if abs(delay) > 1.0}
    if len(late) == 2 and abs(late[FORCE] - late[POSITION]) <= 1.0 + PLAUSIBLE.common_delay * abs(late[POSITION]):
        late = {f"{FORCE} and {POSITION} together": late[POSITION]}
    of_the_loop = " or a wrong gain of the controller" if run.motion is None else ""
    return [
        f"{run.name}: {name}: {abs(delay):.1f} samples ({time_text(abs(delay) * run.period_s)}) "
        f"{'after' if delay > 0.0 else 'before'} the simulation throughout. If it was logged on another clock than the "
        f"{'command' if run.motion is None else 'position'}, shift the columns against each other (`late_s` in a "
        f"mapping). If the clocks are one, leave them: it is a dead time{of_the_loop}, and may be named as a cause."
        for name, delay in late.items()
    ]


def delay_of(run: RecordedRun, simulated: Mapping[str, FloatArray], channel: str) -> float:
    """Return by how many samples a measured channel comes after the simulated one; 0 where a shift explains little.

    Positions are compared by their speeds. The least mean squared distance of the scaled channels within 1 s, half a
    lap and a quarter of the record gives the delay, a parabola through it the fraction.
    """
    from scipy.signal import correlate

    measured, model = run.channels[channel], simulated[channel]
    if channel == POSITION:
        span = PLAUSIBLE.speed_samples
        measured, model = measured[span:] - measured[:-span], model[span:] - model[:-span]
    n = len(measured)
    half_a_lap = n if run.lap is None else run.lap // 2
    longest = max(2, min(round(PLAUSIBLE.longest_delay_s / run.period_s), n // 4, half_a_lap))
    if measured.std() == 0.0 or model.std() == 0.0:
        return 0.0
    measured, model = (measured - measured.mean()) / measured.std(), (model - model.mean()) / model.std()
    lags = np.arange(-longest, longest + 1)
    products = correlate(measured, model, method="fft")[n - 1 + lags]
    late, early = np.maximum(lags, 0), np.maximum(-lags, 0)
    own, other = (np.concatenate(([0.0], np.cumsum(values**2))) for values in (measured, model))
    energy = own[n - early] - own[late] + other[n - late] - other[early]
    distance = (energy - 2.0 * products) / (n - np.abs(lags))
    best = int(np.argmin(distance))
    if distance[best] > PLAUSIBLE.delayed * distance[longest] or not 0 < best < 2 * longest:
        return 0.0
    left, middle, right = distance[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    return float(lags[best] + (0.5 * (left - right) / bend if bend > 0.0 else 0.0))


def _rate_ratio(command: FloatArray, velocity: FloatArray, period_s: float) -> float:
    """Return how many times the change of a command its given velocity is; of a constant speed, by the means."""
    change = np.gradient(command, period_s)
    if float(change.std()) > PLAUSIBLE.constant_speed * float(np.abs(change).max()):
        return _slope(change, velocity)
    return float(velocity.mean() / change.mean())


def _slope(x: FloatArray, y: FloatArray) -> float:
    centred = x - x.mean()
    return float(centred @ (y - y.mean()) / (centred @ centred))


def _correlation(x: FloatArray, y: FloatArray) -> float:
    spread = float(x.std() * y.std())
    return float(np.mean((x - x.mean()) * (y - y.mean()))) / spread if spread > 0.0 else 0.0


def _factor_words(ratio: float) -> str:
    """Return which unit a ratio hints at.

    >>> _factor_words(998.0), _factor_words(3.0)
    (' That is about a thousand: millimetres, milliseconds or kilonewtons.', '')
    """
    size = max(abs(ratio), 1.0 / max(abs(ratio), 1e-300))
    return next((f" That is about {words}." for factor, words in PREFIXES.items() if 0.8 < size / factor < 1.25), "")
