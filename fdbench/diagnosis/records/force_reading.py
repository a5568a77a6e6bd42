"""What a force column cannot show: what is finer than its steps, and what was cut off."""

from collections.abc import Sequence

import numpy as np

from fdbench.diagnosis.records.damage import stretches
from fdbench.diagnosis.records.runs import FORCE, RecordedRun, same_force
from fdbench.diagnosis.settings import PLAUSIBLE
from fdbench.plants.feed_drive import Cascade, FeedDrive
from fdbench.record import FloatArray

ROUNDED = 1e-3  # of a step, by which a number that was written with few digits is off


def limits_of_forces(runs: Sequence[RecordedRun], drive: FeedDrive) -> list[str]:
    """Return a warning where forces are written in coarse steps, and one where they are cut off.

    A force that is commanded may stand still; where a loop asks for it, it stands at its greatest value only where
    something limits it.

    Parameters
    ----------
    runs : sequence of RecordedRun
    drive : FeedDrive
        The nominal model, whose force limit is known.
    """
    coarse = [(run, text) for run in runs if (text := _coarse(run)) and not _in_commanded_steps(run, runs)]
    cut = [(run, text) for run in runs if (text := _cut_off(run, drive))]
    return [*told_once(coarse), *told_once(cut)]


def told_once(said: Sequence[tuple[RecordedRun, str]]) -> list[str]:
    """Return what is said of the first of several runs, with how many others it is said of; nothing without any."""
    if not said:
        return []
    run, text = said[0]
    others = f" and {len(said) - 1} more" if len(said) > 1 else ""
    return [f"{run.name}{others}: {text}"]


def _coarse(run: RecordedRun) -> str:
    force = run.channels[FORCE] if run.given_force is None else run.given_force
    step = step_of(force)
    if step == 0.0:
        return ""
    return (
        f"{FORCE} is written in steps of {step:.3g} N, {np.ptp(force) / step:.0f} of them in its range. What is "
        "smaller shows in the position alone: log it with more digits."
    )


def _in_commanded_steps(run: RecordedRun, runs: Sequence[RecordedRun]) -> bool:
    """Return whether the steps of a force are its command: it was given again, or it stands and jumps over steps.

    A force that is only written in steps goes from one to the next, or changes at every sample.
    """
    if run.given_force is None:
        return False
    if any(other is not run and same_force(run, other) for other in runs):
        return True
    changes = np.diff(run.given_force)
    places = np.flatnonzero(changes)
    jumps = np.abs(changes[places]) / step_of(run.given_force)
    return bool(np.median(np.diff(places)) > 1.0 and round(float(np.median(jumps))) > 1)


def _cut_off(run: RecordedRun, drive: FeedDrive) -> str:
    force, controller = run.channels[FORCE], drive.controller
    greatest = float(np.abs(force).max())
    if not isinstance(controller, Cascade) or greatest > PLAUSIBLE.greatest_force * controller.force_limit_N:
        return ""
    ends = stretches(np.abs(force) == greatest)
    standing = sum(last - first for first, last in ends if last - first >= PLAUSIBLE.cut_samples)
    rounded = len(np.unique(force)) < 0.5 * (len(force) - standing)
    if greatest == 0.0 or rounded or standing <= PLAUSIBLE.cut_force * len(force):
        return ""
    return (
        f"{FORCE} stands at its greatest value, {greatest:.4g} N, for {standing} samples, and the model's "
        f"force_limit_N is {controller.force_limit_N:.4g}. Either the drive limits it there, which the model should "
        "say, or the logger cut it off."
    )


def step_of(values: FloatArray) -> float:
    """Return the step that all values are multiples of, where few of them make up their range; else 0.

    >>> step_of(np.repeat([0.0, 2.5, -5.0, 7.5], 3))
    2.5
    """
    levels = np.unique(values)
    if not 2 < len(levels) <= PLAUSIBLE.coarse_force + 1.0:
        return 0.0
    step = float(np.diff(levels).min())
    multiples = (levels - levels[0]) / step
    if multiples[-1] > PLAUSIBLE.coarse_force or np.abs(multiples - np.round(multiples)).max() > ROUNDED:
        return 0.0
    return step
