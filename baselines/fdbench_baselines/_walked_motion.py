"""A drive's motion under its parameters, its friction and a walk, as filter and smoothers of it take it."""

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import Context, FloatArray
from fdbench.plants.feed_drive import FeedDrive
from fdbench_baselines._drifting_forces import NoiseSearch
from fdbench_baselines._friction_motion import LOOP, Driven, DriveSheet, bent, shape_knobs
from fdbench_baselines._motion_smoother import ForcedMotion


def walked(
    context: Context,
    drive: Driven,
    paper: DriveSheet,
    shape_deviation: float,
    level: float = 1.0,
    shapes: FloatArray | None = None,
) -> NoiseSearch:
    """Return the motion under parameters and a walk, the friction bent about a level and shapes."""
    plant = context.plant
    if not isinstance(plant, FeedDrive):
        raise SpecError(f"the plant of {context.model} is no feed drive.")
    place, step_s, n = int(context.model == LOOP), context.sampling_time_s, len(drive.force_N)
    per_N = step_s ** (2 - place) / (paper.mass_kg * drive.unit)
    v = drive.mean_velocity_m_per_s
    friction = bent(plant, drive, step_s, level, np.zeros(len(shape_knobs(plant))) if shapes is None else shapes)
    pushed = drive.force_N - friction.rest_N
    forces = np.column_stack((-pushed, paper.linear_N_s_per_m * v, friction.level_N, np.ones(n)))
    own = np.hstack((forces * paper.deviations, shape_deviation * friction.slopes_N))
    unit = per_N * paper.force_unit_N
    columns = np.hstack((-per_N * own, np.full((n, 1), -unit)))
    left = pushed - paper.linear_N_s_per_m * v - friction.level_N - paper.offset_N
    motion = ForcedMotion(
        known=per_N * left,
        columns=columns,
        reading=drive.reading / drive.unit,
        missing=drive.held,
        jolt=np.where(drive.held, unit**2, 0.0),
        shock=np.zeros(n, dtype=np.bool_),
        place=place,
    )
    return NoiseSearch(motion, own.shape[1], np.empty(0), np.zeros(3), step_s)
