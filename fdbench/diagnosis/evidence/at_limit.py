"""Where a controller is at its limit: what its loop does there is no evidence."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.evidence.segment_products import segment_counts, segment_length, segment_samples
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.records.force_reading import told_once
from fdbench.diagnosis.records.runs import FORCE, RecordedRun
from fdbench.diagnosis.settings import EVIDENCE, PLAUSIBLE
from fdbench.plants.feed_drive import Cascade, FeedDrive, Following
from fdbench.record import FloatArray, Record


def at_limit(run: RecordedRun, drive: FeedDrive) -> NDArray[np.bool_]:
    """Return in which segments of a run the controller is at its limit, or has just been, (n_segments,).

    What a loop does there hangs on how its integral is held, which no data sheet tells.
    """
    if not isinstance(drive.controller, Cascade) or run.given_force is not None:
        return np.zeros(len(segment_counts(run)), dtype=np.bool_)
    return _limited(run.channels[FORCE], drive.controller, segment_length(run))


def without_limited_controller(nominal: Nominal, records: Sequence[Record]) -> tuple[Nominal, list[str]]:
    """Return a model without its controller, and why, where that is `at_limit` for long; else the model as it is.

    A model that follows the measured motion needs to know nothing of what a loop does at its limit. A force that is
    far beyond that limit was logged in another unit, which the loop tells.
    """
    drive, controller = nominal.drive, nominal.drive.controller
    if not isinstance(controller, Cascade):
        return nominal, []
    records = nominal.on_the_arc(records)
    forces = [drive.motor_force(record) for record in records]
    lengths = [segment_samples(record.sampling_time_s) for record in records]
    limited = [_limited(force, controller, length) for force, length in zip(forces, lengths, strict=True)]
    part = float(np.concatenate(limited).mean()) if limited else 0.0
    greatest_N = max((float(np.abs(force).max()) for force in forces), default=0.0)
    if part <= EVIDENCE.limited or greatest_N > PLAUSIBLE.wrong_gain * controller.force_limit_N:
        return nominal, []
    left_out = dataclasses.replace(drive, controller=Following(feedback=controller.feedback))
    said = _said(part) + "the controller was left out of the model."
    swinging = np.concatenate([_swings(own, controller, n) for own, n in zip(forces, lengths, strict=True)])
    if swinging.mean() > EVIDENCE.swinging:
        said += (
            " It swings from one limit to the other: a loop that is not stable, of which a force of one frequency is "
            "its own. Log it stable."
        )
    return dataclasses.replace(nominal, plant=left_out), [said]


def _limited(force_N: FloatArray, controller: Cascade, length: int) -> NDArray[np.bool_]:
    limited = np.zeros(-(-len(force_N) // length), dtype=np.bool_)
    beyond = np.abs(force_N) > PLAUSIBLE.greatest_force * controller.force_limit_N
    limited[np.flatnonzero(beyond) // length] = True
    limited[1:] |= limited[:-1].copy()
    return limited


def _swings(force_N: FloatArray, controller: Cascade, length: int) -> NDArray[np.bool_]:
    """Return in which segments a force reaches both limits."""
    limit_N, starts = PLAUSIBLE.greatest_force * controller.force_limit_N, np.arange(0, len(force_N), length)
    highest, lowest = np.maximum.reduceat(force_N, starts), np.minimum.reduceat(force_N, starts)
    return np.asarray((highest > limit_N) & (lowest < -limit_N))


def told_at_limits(runs: Sequence[RecordedRun], drive: FeedDrive) -> list[str]:
    """Return a warning that says how much of the runs is no evidence, where a controller is `at_limit`."""
    parts = [(run, float(at_limit(run, drive).mean())) for run in runs]
    if all(part == 1.0 for _, part in parts):
        return []
    return told_once([(run, _no_evidence(part)) for run, part in parts if part > 0.0])


def _no_evidence(part: float) -> str:
    return _said(part) + "nothing is judged by that part."


def _said(part: float) -> str:
    return (
        f"the controller is at its force_limit_N, or has just been, for {100.0 * part:.0f} % of the time. What its "
        "loop does there hangs on how its integral is held, which the model does not say: "
    )
