"""Controllers of the foreign axes, and the march of loop and mechanics in time.

The form `COUNTS` re-implements what the public documentation of LinuxCNC says of its component ``pid`` (deadband,
maximum integral, FF1 and FF2, feedback in counts); none of its code is used.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.virtual_axes.foreign.mechanics import N_STATES, TURN, advance, delivered_force, screw_shift

FloatArray = NDArray[np.float64]
CASCADE, FILTERED, TACHOMETER, COUNTS, TWO_SENSORS, TORQUE = range(6)
N_STOPS = 2
# state of a controller
INTEGRAL, FILTERED_SPEED, LAST_ERROR, LAST_READING = range(4)
N_LOOP_STATES = 4


class ForeignLoop(NamedTuple):
    """Settings of a controller; what a form does not have is not looked at."""

    form: float
    position_gain_per_s: float
    velocity_gain_N_s_per_m: float
    integral_gain_N_per_m: float
    velocity_feedforward: float
    acceleration_feedforward_kg: float
    force_limit_N: float
    reads_table: float
    filter_s: float
    count_m: float
    deadband_counts: float
    latency_s: float
    force_constant_ratio: float


def as_used(form: float, reference: FloatArray, period: float) -> FloatArray:
    """Return position, velocity and acceleration (n, 3) of a command as the controller itself takes them.

    A loop with two sensors has its velocity half a sample late, one in counts takes backward differences.
    """
    used = reference.copy()
    if form == TWO_SENSORS:
        used[1:, 1] = 0.5 * (reference[1:, 1] + reference[:-1, 1])
    if form == COUNTS:
        used[:, 1] = np.diff(reference[:, 0], prepend=reference[0, 0]) / period
        used[:, 2] = np.diff(used[:, 1], prepend=used[0, 1]) / period
    return used


@njit(error_model="numpy")
def as_read(motor, table, noise, loop, wrong):  # type: ignore[no-untyped-def]
    """Return the positions of motor and table as a controller reads them: errors of the encoders, noise (3,), grids."""
    if wrong.division_m != 0.0:
        angle = TURN * motor / wrong.division_period_m + wrong.division_phase_rad
        motor += wrong.division_m * (np.cos(angle) + 0.25 * np.cos(2.0 * angle))
    motor += noise[0]
    table += noise[1]
    if loop.count_m > 0.0:
        motor = loop.count_m * np.round(motor / loop.count_m)
    if wrong.step_m > 0.0:
        motor = wrong.step_m * np.ceil(motor / wrong.step_m)
    return motor, table


@njit(error_model="numpy")
def differenced(motor, table, loop):  # type: ignore[no-untyped-def]
    """Return the position whose change in a cycle is the speed."""
    return table if loop.reads_table > 0.5 and loop.form != TWO_SENSORS else motor


@njit(error_model="numpy")
def asked_force(motor, table, velocity, reference, state, loop, wrong, period):  # type: ignore[no-untyped-def]
    """Return the force that a controller asks for in a cycle, within its limit, and bring its state up to date.

    Parameters
    ----------
    motor, table : float
        Positions as read.
    velocity : float
        Of the motor, as a tachometer has it.
    reference : (4,) array
        See `march`.
    state : (4,) array
        See `INTEGRAL` and what follows it.
    loop, wrong : named tuples
    period : float
    """
    reading = table if loop.reads_table > 0.5 else motor
    source = differenced(motor, table, loop)
    speed = (source - state[LAST_READING]) / period
    state[LAST_READING] = source
    if loop.form == TACHOMETER:
        speed = velocity
    filter_s = loop.filter_s + wrong.filter_s
    if filter_s > 0.0:
        state[FILTERED_SPEED] += (speed - state[FILTERED_SPEED]) * period / (period + filter_s)
        speed = state[FILTERED_SPEED]
    wanted = loop.velocity_feedforward * (1.0 - wrong.feedforward_loss) * reference[1]
    ahead = loop.acceleration_feedforward_kg * reference[2]
    integral, limit = state[INTEGRAL], loop.force_limit_N
    if loop.form == TORQUE:
        ideal = reference[3]
    elif loop.form == COUNTS:
        counts = np.round(reference[0] / loop.count_m) - np.round(reading / loop.count_m)
        counts = np.sign(counts) * max(abs(counts) - loop.deadband_counts, 0.0)
        error, rate = counts * loop.count_m, wanted - speed
        ideal = loop.velocity_gain_N_s_per_m * (loop.position_gain_per_s * error + rate) + ahead
        ideal += loop.integral_gain_N_per_m * integral
        state[INTEGRAL] += error * period
    else:
        error = wanted + loop.position_gain_per_s * (reference[0] - reading) - speed
        ideal = loop.velocity_gain_N_s_per_m * error + loop.integral_gain_N_per_m * integral + ahead
        if loop.form == FILTERED:
            beyond = min(max(ideal, -limit), limit) - ideal
            state[INTEGRAL] += period * (0.5 * (error + state[LAST_ERROR]) + beyond / loop.velocity_gain_N_s_per_m)
            state[LAST_ERROR] = error
        elif abs(ideal) < limit:
            state[INTEGRAL] += period * error
    return min(max(ideal, -limit), limit)


@kept
@njit(error_model="numpy")
def march(body, wrong, loop, reference, outer, noise, stops_N, stops_m, scale, period, steps):  # type: ignore[no-untyped-def]
    """Return the (n_cycles, 3) readings of motor position, table position and asked force in each control cycle.

    Parameters
    ----------
    body, wrong, loop : named tuples
    reference : (n_cycles, 4) array
        Commanded position, velocity, acceleration, and force of the open loop.
    outer : (n_cycles,) array
        Process force against positive motion (N).
    noise : (n_cycles, 3) array
        Of motor position (m), table position (m) and logged force (N).
    stops_N, stops_m : (2,) array
        Slip force and distance of elements of hysteresis.
    scale : float
        Friction of this run against the usual one.
    period : float
        Control period (s).
    steps : int
        Integration steps in it.
    """
    n = reference.shape[0]
    h = period / steps
    out = np.empty((n, 3))
    y, trial, slopes = np.zeros(N_STATES), np.empty(N_STATES), np.empty((4, N_STATES))
    stops = np.zeros(N_STOPS)
    y[0] = y[2] = y[5] = reference[0, 0]
    if body.stiffness_N_per_m > 0.0:
        y[2] = y[5] = y[0] + screw_shift(y[0], 0.0, wrong)
    late = (loop.latency_s + wrong.late_s) / h
    whole, part = int(late), late - int(late)
    asked = np.zeros(whole + 3)
    n_past = int(wrong.scale_late_s / h) + 1
    past = np.full(n_past, y[2])
    state = np.zeros(N_LOOP_STATES)
    path = lag_1 = lag_2 = 0.0
    count = 0
    for k in range(n):
        motor, table = as_read(y[0], past[(count + 1) % n_past], noise[k], loop, wrong)
        if k == 0:
            state[LAST_READING] = differenced(motor, table, loop)
        force = asked_force(motor, table, y[1], reference[k], state, loop, wrong, period)
        out[k, 0], out[k, 1], out[k, 2] = motor, table, force + noise[k, 2]
        for _ in range(steps):
            asked[count % asked.shape[0]] = force
            newer = asked[(count - whole) % asked.shape[0]]
            older = asked[(count - whole - 1) % asked.shape[0]]
            acting = loop.force_constant_ratio * (newer * (1.0 - part) + older * part)
            if wrong.lag_s > 0.0:
                share = 1.0 - np.exp(-2.0 * h / wrong.lag_s)
                lag_1 += (acting - lag_1) * share
                lag_2 += (lag_1 - lag_2) * share
                acting = lag_2
            held = outer[k]
            for i in range(N_STOPS):
                held += stops[i]
            before = y[2]
            advance(
                count * h,
                h,
                y,
                slopes,
                trial,
                body,
                wrong,
                delivered_force(acting, y[0], wrong),
                held,
                path,
                scale,
            )
            moved = y[2] - before
            path += abs(moved)
            for i in range(N_STOPS):
                if stops_N[i] > 0.0:
                    stops[i] = min(max(stops[i] + stops_N[i] / stops_m[i] * moved, -stops_N[i]), stops_N[i])
            count += 1
            past[count % n_past] = y[2]
    return out
