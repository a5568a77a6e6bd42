"""Conditions: records of one command that differ by more than repeats do were taken under another force."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.records.runs import FORCE, RecordedRun, between_laps, by_command, deviations, same_command
from fdbench.diagnosis.settings import RECORDS
from fdbench.record import FloatArray
from fdbench.statistics import rms


@dataclass(frozen=True, kw_only=True, eq=False)
class Apart:
    """A run of another condition than that which is diagnosed, and the runs of its command in that condition."""

    run: RecordedRun
    repeats: tuple[RecordedRun, ...]


def apart(runs: Sequence[RecordedRun]) -> list[Apart]:
    """Return the runs that are not of the condition of most, which is the first of several with as many runs.

    A record may name its condition. Of records that do not, repeats of one command are of one condition unless their
    forces differ by more than five times what laps within them, or other repeats, do; a change of friction, mass or
    offset alone is no other condition, since these change from day to day. Of two that differ by as much more than the
    repeats of every other command do, the one is of another condition that a model leaves twice as much of.
    """
    named = [run.condition or "" for run in runs]
    usual = max(dict.fromkeys(named), key=named.count)
    inside = [run for run, name in zip(runs, named, strict=True) if name == usual]
    groups = by_command(inside)
    kept = [
        run
        for group in groups
        for run in _of_the_usual_condition(
            _largest_of_one_condition(group), [own for own in groups if own is not group]
        )
    ]
    return [
        Apart(run=run, repeats=tuple(other for other in kept if same_command(other, run)))
        for run in runs
        if not any(run is other for other in kept)
    ]


def _largest_of_one_condition(group: Sequence[RecordedRun]) -> list[RecordedRun]:
    """Return the largest part of repeats of one command that differ by no more than noise, the first of equal ones."""
    differences = np.array([[_difference(a, b) for b in group] for a in group])
    floors = [rms(between_laps(_force(run), run.lap)) for run in group if run.lap]
    if len(group) > 2:
        floors.append(float(differences[np.triu_indices(len(group), 1)].min()))
    if not floors:
        return list(group)
    near = differences <= RECORDS.beyond * min(floors)
    parts: list[list[int]] = []
    for index in range(len(group)):
        part = next((part for part in parts if any(near[index, other] for other in part)), None)
        if part is None:
            parts.append([index])
        else:
            part.append(index)
    return [group[index] for index in max(parts, key=len)]


def _of_the_usual_condition(
    group: Sequence[RecordedRun], others: Sequence[Sequence[RecordedRun]]
) -> Sequence[RecordedRun]:
    """Return the one of two repeats that is nearer to the model, where the other tells of another force, else both."""
    left = [rms(_unlike(run.left[FORCE], run.reference)) for run in group if run.left is not None]
    if len(group) != 2 or len(left) != 2:
        return group
    # What is out of step acts in both, at another time.
    if max(left) <= RECORDS.in_one * min(left):
        return group
    elsewhere = [min(itertools.starmap(_difference, itertools.combinations(own, 2))) for own in others if len(own) > 1]
    if not elsewhere or _difference(*group) <= RECORDS.beyond * max(elsewhere):
        return group
    return [group[left.index(min(left))]]


def _difference(a: RecordedRun, b: RecordedRun) -> float:
    """Return what the forces of two repeats differ by, but for other friction, mass and offset."""
    return rms(_unlike(_force(a) - _force(b), a.reference))


def restless(run: RecordedRun) -> bool:
    """Return whether a force acts that does not repeat with the motion: laps differ by a tenth of the force and more.

    Such laps are no repeats, and what they differ by is no noise.
    """
    if run.lap is None:
        return False
    left = _unlike(between_laps(run.channels[FORCE], run.lap), run.reference[run.lap :])
    return rms(left) > math.sqrt(2.0) * RECORDS.restless * rms(run.channels[FORCE])


def _force(run: RecordedRun) -> FloatArray:
    return deviations(run, FORCE)


def _unlike(difference: FloatArray, reference: FloatArray) -> FloatArray:
    """Return what other friction, mass and offset do not explain of the difference of two forces."""
    speed = reference[:, 1]
    turning = np.sign(np.where(np.abs(speed) > RECORDS.resting * np.abs(speed).max(), speed, 0.0))
    columns = np.column_stack((np.ones_like(speed), turning, speed, reference[:, 2]))
    return np.asarray(difference - columns @ np.linalg.lstsq(columns, difference, rcond=None)[0])
