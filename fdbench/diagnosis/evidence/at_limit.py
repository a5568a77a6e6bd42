"""Where a controller is at its limit: what its loop does there is no evidence."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.evidence.segment_products import segment_counts, segment_length
from fdbench.diagnosis.records.force_reading import told_once
from fdbench.diagnosis.records.runs import FORCE, RecordedRun
from fdbench.diagnosis.settings import PLAUSIBLE
from fdbench.plants.feed_drive import Cascade, FeedDrive


def at_limit(run: RecordedRun, drive: FeedDrive) -> NDArray[np.bool_]:
    """Return in which segments of a run the controller is at its limit, or has just been, (n_segments,).

    What a loop does there hangs on how its integral is held, which no data sheet tells.
    """
    limited = np.zeros(len(segment_counts(run)), dtype=np.bool_)
    if isinstance(drive.controller, Cascade) and run.given_force is None:
        beyond = np.abs(run.channels[FORCE]) > PLAUSIBLE.greatest_force * drive.controller.force_limit_N
        limited[np.flatnonzero(beyond) // segment_length(run)] = True
        limited[1:] |= limited[:-1].copy()
    return limited


def told_at_limits(runs: Sequence[RecordedRun], drive: FeedDrive) -> list[str]:
    """Return a warning that says how much of the runs is no evidence, where a controller is `at_limit`."""
    parts = [(run, float(at_limit(run, drive).mean())) for run in runs]
    if all(part == 1.0 for _, part in parts):
        return []
    return told_once([(run, _no_evidence(part)) for run, part in parts if part > 0.0])


def _no_evidence(part: float) -> str:
    return (
        f"the controller is at its force_limit_N, or has just been, for {100.0 * part:.0f} % of the time. What its "
        "loop does there hangs on how its integral is held, which the model does not say: nothing is judged by that "
        "part."
    )
