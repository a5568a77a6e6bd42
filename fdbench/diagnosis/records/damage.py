"""Damage of a record that no machine makes: spikes, jumps, frozen and repeated stretches, told by kind and place."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from fdbench.diagnosis.records.runs import COMMAND, FORCE, POSITION, RecordedRun
from fdbench.diagnosis.settings import PLAUSIBLE, RECORDS
from fdbench.errors import RecordError
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray
from fdbench.units import time_text


def check_damage(run: RecordedRun, drive: FeedDrive, noise_m: float) -> None:
    """Raise a RecordError where a stretch of a run was not made by a machine; the message says which, and what to do.

    Parameters
    ----------
    run : RecordedRun
    drive : FeedDrive
        The nominal model; its mass tells which jumps no force could make.
    noise_m : float
        Noise of the position, standard deviation.
    """
    position, force = run.channels[POSITION], run.channels[FORCE]
    _refuse_copies(run, position, force)
    least = _least_bend(run, drive, noise_m)
    _refuse_many_spikes(run, least)
    jumps = _jumps(run, least)
    _refuse_frozen(run, position, force, jumps, noise_m)
    if 0 < jumps.size <= PLAUSIBLE.rare * run.n_samples:
        steps = np.abs(np.diff(position))
        is_spike = int(jumps[-1]) - int(jumps[0]) < PLAUSIBLE.spike_samples == jumps.size
        first = int(jumps[0]) + 1 if is_spike else int(jumps[np.argmax(steps[jumps])])
        size = float(steps[first])
        kind = (
            "A damaged sample: cut it out"
            if is_spike
            else "Missing rows, damaged samples, or two recordings in one: split the record there"
        )
        raise RecordError(
            f"{run.name}: {POSITION} jumps by {size:.3g} m after {_place(run, first)} ({jumps.size} samples in all), "
            f"which no force of this axis could do. {kind}."
        )
    _refuse_spikes(run, drive, noise_m)


def _place(run: RecordedRun, sample: int) -> str:
    """Return a sample of a run in words, counted from where its record begins."""
    place = run.n_before + sample
    return f"sample {place} ({time_text(place * run.period_s)})"


def _least_bend(run: RecordedRun, drive: FeedDrive, noise_m: float) -> float:
    """Return the second difference of the position that no force, noise or encoder could make, m."""
    position, h = run.channels[POSITION], run.period_s
    steps = np.abs(np.diff(position))
    quantum = float(steps[steps > 0.0].min(initial=math.inf)) if steps.any() else 0.0
    strongest = float(np.quantile(np.abs(run.channels[FORCE]), 0.999))
    return max(
        PLAUSIBLE.impossible_force * strongest * h**2 / drive.motor.mass_kg,
        PLAUSIBLE.bend_noise * math.sqrt(6.0) * noise_m,
        PLAUSIBLE.encoder_steps * quantum,
    )


def _jumps(run: RecordedRun, least: float) -> NDArray[np.intp]:
    """Return the samples after which the position bends as no force could bend it; those held by the logger do not."""
    bent = np.abs(np.diff(run.channels[POSITION], 2)) > least
    if run.held is not None:
        near = np.convolve(run.held, np.ones(5), "same") > 0.0
        bent &= ~near[1:-1]
    return np.asarray(np.flatnonzero(bent), dtype=np.intp)


def _refuse_many_spikes(run: RecordedRun, least: float) -> None:
    """Refuse spikes of one sample, however many: the position bends away and back, by s, -2 s and s.

    A sample that the logger held bends so too, but repeats its neighbour.
    """
    steps = np.diff(run.channels[POSITION])
    bends = np.diff(steps)
    middle = bends[1:-1]
    odd = np.maximum(np.abs(bends[:-2] + 0.5 * middle), np.abs(bends[2:] + 0.5 * middle))
    repeats = (steps[1:-2] == 0.0) | (steps[2:-1] == 0.0)
    spikes = np.flatnonzero((np.abs(middle) > 2.0 * least) & (odd < PLAUSIBLE.spike_shape * np.abs(middle)) & ~repeats)
    if spikes.size > PLAUSIBLE.spike_samples:
        largest = int(spikes[np.argmax(np.abs(middle[spikes]))])
        raise RecordError(
            f"{run.name}: {POSITION} has {spikes.size} spikes of one sample, the largest of "
            f"{0.5 * abs(float(middle[largest])):.3g} m at {_place(run, largest + 2)}, which no force of this axis "
            "could make. Damaged samples: check encoder and logger, and record again."
        )


def stretches(inside: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index, exclusive, of each stretch that is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], inside, [False])).astype(np.int8)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _refuse_frozen(
    run: RecordedRun, position: FloatArray, force: FloatArray, jumps: NDArray[np.intp], noise_m: float
) -> None:
    """Refuse a stretch in which nothing changes though the axis is told to move, or which begins with a jump."""
    same = (np.diff(position) == 0.0) & (np.diff(force) == 0.0)
    fewest = max(PLAUSIBLE.frozen_samples, round(PLAUSIBLE.frozen_s / run.period_s))
    span, noisy = float(np.ptp(position)), PLAUSIBLE.bend_noise * noise_m
    for first, last in stretches(same):
        if last - first < fewest:
            continue
        told = float(np.ptp(run.reference[first : last + 1, 0])) if run.motion is None else 0.0
        jump = abs(float(position[first] - position[first - 1])) if first > 0 else 0.0
        jumped = jump > max(PLAUSIBLE.frozen_jump * span, noisy) and bool(np.any(np.abs(jumps - first) <= 2))
        if told > max(PLAUSIBLE.frozen_command * span, noisy) or jumped:
            value = "zero" if position[first] == 0.0 and force[first] == 0.0 else "constant"
            where = "at its end" if last >= run.n_samples - 2 else "within it"
            moves = f" while {COMMAND} moves by {told:.3g} m" if told > 0.0 else ""
            raise RecordError(
                f"{run.name}: force and position are {value} for {last - first + 1} samples {where}, from "
                f"{_place(run, first)} on{moves}. The logger wrote no readings there: cut this stretch out."
            )


def _refuse_copies(run: RecordedRun, position: FloatArray, force: FloatArray) -> None:
    """Refuse a block of rows that is repeated to the last digit, but where the command was the same about it, too."""
    order = np.lexsort((np.arange(len(force)), position, force))
    twin = (np.diff(force[order]) == 0.0) & (np.diff(position[order]) == 0.0)
    lag = np.zeros(len(force), dtype=np.intp)
    lag[order[1:][twin]] = np.diff(order)[twin]
    moving, fewest = np.concatenate(([False], np.diff(position) != 0.0)), PLAUSIBLE.copied_samples
    for first, last in stretches((lag > 0) & np.concatenate(([False], lag[1:] == lag[:-1]))):
        is_block = last - first >= fewest and np.count_nonzero(moving[first:last]) > fewest // 2
        if is_block and not _comes_again(run, first, last, int(lag[first])):
            raise RecordError(
                f"{run.name}: the {last - first + 1} samples from {_place(run, first - 1)} on repeat those "
                f"{lag[first]} samples before to the last digit. A block was written twice: cut one of them out."
            )


def _comes_again(run: RecordedRun, first: int, last: int, lag: int) -> bool:
    """Return whether the command repeats itself after so many samples from well before a stretch to well behind it.

    Readings that are coarse may then repeat themselves for a while, too, but not through most of a period.
    """
    if run.motion is not None or 2 * (last - first) > lag:
        return False
    command, beside = run.command[:, 0], last - first
    begin, end = max(first - beside, lag), min(last + beside, len(command))
    told = command[begin:end] - command[begin - lag : end - lag]
    allowed = RECORDS.same_command * float(np.ptp(command))
    return end - begin > beside and bool(np.all(np.abs(told) <= allowed))


def _refuse_spikes(run: RecordedRun, drive: FeedDrive, noise_m: float) -> None:
    """Refuse a short spike of the force that the axis would have felt, but did not."""
    force, position, h = run.channels[FORCE], run.channels[POSITION], run.period_s
    usual, beside = float(np.quantile(np.abs(force), 0.995)), PLAUSIBLE.beside_spike_samples
    for first, last in stretches(np.abs(force) > PLAUSIBLE.spike * usual) if usual > 0.0 else []:
        before, after = position[max(0, first - beside) : first + 1], position[last : last + beside + 1]
        if last - first > PLAUSIBLE.spike_samples or min(len(before), len(after)) <= beside:
            continue
        change = (after[-1] - after[0] - before[-1] + before[0]) / (beside * h)
        impulse = float(force[first:last].sum()) * h / drive.mass_kg
        others = np.concatenate((force[first - beside : first], force[last : last + beside]))
        noise = PLAUSIBLE.bend_noise * noise_m * 2.0 / (beside * h)
        noise += beside * h * float(np.abs(others).mean()) / drive.mass_kg
        if abs(impulse) > noise / PLAUSIBLE.unfelt and change / impulse < PLAUSIBLE.unfelt:
            place = first + int(np.argmax(np.abs(force[first:last])))
            raise RecordError(
                f"{run.name}: {FORCE} is {force[place]:.4g} N at {_place(run, place)}, and hardly ever more than "
                f"{usual:.3g} N elsewhere; the axis did not feel it. A damaged sample: cut it out."
            )


def check_force_is_own(run: RecordedRun, simulated: FloatArray) -> None:
    """Raise a RecordError where the force of a run is not the one that moves the axis.

    Whatever acts beside it, a motor's force has in it what the motion asks for, unless it is limited.

    Parameters
    ----------
    run : RecordedRun
    simulated : (n_samples,) array
        Force of the nominal model along the run's command, N.
    """
    force = run.channels[FORCE]
    limited = np.abs(force) > PLAUSIBLE.greatest_force * float(np.abs(force).max())
    share, doubt, parts = _share_of(simulated, force)
    most = share + float(stdtrit(parts - 1, ndtr(PLAUSIBLE.sure_foreign))) * doubt
    if limited.mean() < PLAUSIBLE.limited_force and most < PLAUSIBLE.foreign_force:
        raise RecordError(
            f"{run.name}: {FORCE} has {share:.0%} of the force that this motion asks of the model, give or take "
            f"{doubt:.0%}. It is not the force that moved the axis: another column or axis, another recording, or "
            "damaged samples."
        )


def check_force_is_alive(run: RecordedRun, simulated: FloatArray) -> None:
    """Raise a RecordError where the force stands still, below its limit, while the motion asks for another one.

    For the parameters see `check_force_is_own`.
    """
    force, span = run.channels[FORCE], float(np.ptp(simulated))
    least = max(PLAUSIBLE.frozen_samples, round(PLAUSIBLE.frozen_force_s / run.period_s))
    for first, last in stretches(np.diff(force) == 0.0):
        asked = float(np.ptp(simulated[first : last + 1]))
        limited = abs(float(force[first])) > PLAUSIBLE.greatest_force * float(np.abs(force).max())
        if last - first >= least and asked > PLAUSIBLE.frozen_force * span and not limited:
            raise RecordError(
                f"{run.name}: {FORCE} is {force[first] + 0.0:.4g} N for {last - first + 1} samples from "
                f"{_place(run, first)} on, where the motion asks for changes of {asked:.3g} N. The logger wrote no "
                "readings there: cut this stretch out."
            )


def _share_of(asked: FloatArray, force: FloatArray) -> tuple[float, float, int]:
    """Return the slope of one force over another, its standard error, and of how many parts the slopes tell it.

    Of so few parts the error is itself in doubt (Student 1908, Biometrika 6(1)).
    """
    slopes, n_parts = [], PLAUSIBLE.force_parts
    for own, other in zip(np.array_split(asked, n_parts), np.array_split(force, n_parts), strict=True):
        centred = own - asked.mean()
        squares = float(centred @ centred)
        if squares > 0.1 * len(own) * float(asked.var()):
            slopes.append(float(centred @ (other - force.mean())) / squares)
    if len(slopes) < 3:
        return 1.0, math.inf, n_parts
    return float(np.mean(slopes)), float(np.std(slopes, ddof=1)) / math.sqrt(len(slopes)), len(slopes)
