"""What a drive makes of a command when curves of friction and position are added to its linear model."""

from typing import NamedTuple

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench.estimator import Context, FloatArray
from fdbench.plants._velocity_loop import DEAD_BAND_M_PER_S
from fdbench.record import Record
from fdbench_baselines._drive_features import Library, motion

BEYOND, TABLE = 1.2, 24001  # how far a table goes beyond the record's motion, and its rows


class Learned(NamedTuple):
    """A drive as it was found: parameters of its regressors, candidates and their coefficients."""

    beta: FloatArray
    features: Library
    coefficients: FloatArray


def free_run(context: Context, learned: Learned, command: Record) -> FloatArray:
    """Return the target that parameters and curves, without the periodic part, make of a command."""
    if context.model == "velocity_loop":
        return _velocity(context, learned, command)
    position = command["reference_position_m"]
    idle = np.zeros(len(position))
    moved = Record({"time_s": command["time_s"], "motor_position_m": position, "motor_force_N": idle})
    regression = context.regression(moved)
    curves = learned.features.all(*motion(moved, regression, context.model))
    return np.asarray(regression.regressors @ learned.beta + curves @ learned.coefficients)


def _velocity(context: Context, learned: Learned, command: Record) -> FloatArray:
    features, n = learned.features, len(context.nominal)
    velocity = features.speed_m_per_s * np.linspace(-BEYOND, BEYOND, TABLE)
    position = features.centre_m + features.reach_m * np.linspace(-BEYOND, BEYOND, TABLE)
    at_rest = features.friction(velocity)
    split = at_rest.shape[1]
    start = command["reference_position_m"][0] if "reference_position_m" in command else 0.0
    found: FloatArray = follow(
        command["reference_velocity_m_per_s"],
        np.append(learned.beta, np.zeros(4 - n)),
        (velocity[0], velocity[-1]),
        at_rest @ learned.coefficients[:split],
        (position[0], position[-1]),
        features.place(position) @ learned.coefficients[split:],
        DEAD_BAND_M_PER_S,
        float(start),
        context.sampling_time_s,
    )
    return found


@kept
@njit(error_model="numpy")
def follow(reference, beta, speeds, curve, places, profile, dead_band, position, step_s):  # type: ignore[no-untyped-def]
    """Return the velocities v_1 ... v_{n-1} from rest, with curves over speed and place given by uniform tables."""
    v, out = 0.0, np.empty(len(reference) - 1)
    for k in range(len(out)):
        friction = beta[2] if v > dead_band else -beta[3] if v < -dead_band else 0.0
        following = beta[0] * reference[k] + beta[1] * v - friction
        following += from_table(v, speeds, curve) + from_table(position, places, profile)
        position += step_s * v
        v = following
        out[k] = v
    return out


@kept
@njit(error_model="numpy")
def from_table(x, ends, values):  # type: ignore[no-untyped-def]
    """Return a value between two of a uniform table, the last one beyond its ends."""
    place = (x - ends[0]) / (ends[1] - ends[0]) * (len(values) - 1)
    place = min(max(place, 0.0), len(values) - 1.0)
    i = min(int(place), len(values) - 2)
    return values[i] + (place - i) * (values[i + 1] - values[i])
