"""Conditions: records of one command that differ by more than repeats do were taken under another force."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fdbench.diagnosis.records.runs import Run, deviations, same_command
from fdbench.diagnosis.settings import RECORDS
from fdbench.record import FloatArray

FORCE = "motor_force_N"


@dataclass(frozen=True, kw_only=True, eq=False)
class Apart:
    """A run of another condition than that which is diagnosed, and the runs of its command in that condition."""

    run: Run
    repeats: tuple[Run, ...]


def apart(runs: Sequence[Run]) -> list[Apart]:
    """Return the runs that are not of the condition of most, which is the first of several with as many runs.

    A record may name its condition. Of records that do not, repeats of one command are of one condition unless their
    forces differ by more than five times what laps within them, or other repeats, do; a change of friction, mass or
    offset alone is no other condition, since these change from day to day.
    """
    named = [run.condition or "" for run in runs]
    usual = max(dict.fromkeys(named), key=named.count)
    inside = [run for run, name in zip(runs, named, strict=True) if name == usual]
    groups: list[list[Run]] = []
    for run in inside:
        group = next((group for group in groups if same_command(group[0], run)), None)
        if group is None:
            groups.append([run])
        else:
            group.append(run)
    kept = [run for group in groups for run in _largest_of_one_condition(group)]
    return [
        Apart(run=run, repeats=tuple(other for other in kept if same_command(other, run)))
        for run in runs
        if not any(run is other for other in kept)
    ]


def _largest_of_one_condition(group: Sequence[Run]) -> list[Run]:
    """Return the largest part of repeats of one command that differ by no more than noise, the first of equal ones."""
    differences = np.array([[_rms(_unlike(a, b)) for b in group] for a in group])
    floors = [_rms(values[run.lap :] - values[: -run.lap]) for run in group if run.lap for values in [_force(run)]]
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


def restless(run: Run) -> bool:
    """Return whether a force acts that does not repeat with the motion: laps differ by a tenth of the force and more.

    Such laps are no repeats, and what they differ by is no noise.
    """
    if run.lap is None:
        return False
    later, before = (dataclasses.replace(run, left=None, motion=None, **part) for part in _laps(run, run.lap))
    return _rms(_unlike(later, before)) > math.sqrt(2.0) * RECORDS.restless * _rms(run.channels[FORCE])


def _laps(run: Run, lap: int) -> list[dict[str, Any]]:
    """Return reference and force without the first lap, and without the last."""
    parts = (slice(lap, None), slice(-lap))
    return [{"reference": run.reference[part], "channels": {FORCE: run.channels[FORCE][part]}} for part in parts]


def _force(run: Run) -> FloatArray:
    return deviations(run, FORCE)


def _unlike(a: Run, b: Run) -> FloatArray:
    """Return the difference of two forces without what other friction, mass and offset explain of it."""
    difference, speed = _force(a) - _force(b), a.reference[:, 1]
    turning = np.sign(np.where(np.abs(speed) > RECORDS.resting * np.abs(speed).max(), speed, 0.0))
    columns = np.column_stack((np.ones_like(speed), turning, speed, a.reference[:, 2]))
    return np.asarray(difference - columns @ np.linalg.lstsq(columns, difference, rcond=None)[0])


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
