"""A drive's motion under its parameters, its friction, a walk and waves, as filter and smoothers of it take it."""

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import Context, FloatArray
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._drifting_forces import NoiseSearch, wave_columns, with_waves
from fdbench_baselines._friction_motion import FEED, LOOP, Driven, DriveSheet, bent, shape_knobs
from fdbench_baselines._motion_smoother import ForcedMotion
from fdbench_baselines._slip import below_half

SEARCHED, COMPARED, MENDED = 80, 30, 40  # evaluations of the likelihood
MEANS = 2  # columns of a cut without a wave


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


def found_shapes(context: Context, paper: DriveSheet, shape_deviation: float, b: FloatArray) -> dict[str, float]:
    """Return logarithms over the nominal shapes, by the names of `shape_knobs`, for coefficients b of `walked`."""
    shapes = shape_deviation * paper.rigid(b).mass_kg / paper.mass_kg * b[4:]
    return dict(zip([knob.name for knob in shape_knobs(context.plant)], shapes.tolist(), strict=True))


def under_waves(
    context: Context,
    record: Record,
    paper: DriveSheet,
    search: NoiseSearch,
    angle: FloatArray,
    period_s: float,
    harmonics: int,
    starts: bool = False,
) -> tuple[NoiseSearch, FloatArray]:
    """Return the search with waves of a shaker or of a cutter, and these (n, n_waves).

    Parameters
    ----------
    angle : (n,) array
        Of the first wave half a sample after each reading, rad.
    period_s : float
        Nominal period.
    harmonics : int
        Of the period; in positions those below half of the sampling frequency count.
    starts : bool
        Whether a shaker's waves begin anew where they seem to jump; see `NoiseSearch.told`.
    """
    unit, time_s = float(search.motion.columns[0, search.own]), record["time_s"]
    harmonics = harmonics if context.model == LOOP else below_half(time_s, period_s, harmonics)
    waves, groups = wave_columns(angle, harmonics)
    best = with_waves(search, unit, waves).likeliest(SEARCHED)
    cut, cut_groups = wave_columns(angle, harmonics, record[FEED] if FEED in record else np.zeros(len(time_s)))
    # Beside a friction the mean of a cut is not told from it; tried all the same, it takes the friction's place.
    means = 0 if paper.has_friction else MEANS
    cut, cut_groups = cut[:, : cut.shape[1] - MEANS + means], cut_groups[: cut.shape[1] - MEANS + means]
    other = with_waves(best, unit, cut, means).likeliest(COMPARED)
    if other.log_likelihood > best.log_likelihood:
        best, waves, groups, starts = other.likeliest(MENDED), cut, cut_groups, False
    for _ in range(2):
        best = best.told(groups, starts).likeliest(MENDED)
    return best.told(groups, starts).likeliest(MENDED), waves
