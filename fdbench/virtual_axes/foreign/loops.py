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
    integral = speed_filtered = path = force = last_error = lag_1 = lag_2 = 0.0
    last_motor = y[0]
    filter_s = loop.filter_s + wrong.filter_s
    count = 0
    for k in range(n):
        motor, table = y[0], past[(count + 1) % n_past]
        if wrong.division_m != 0.0:
            angle = TURN * motor / wrong.division_period_m + wrong.division_phase_rad
            motor += wrong.division_m * (np.cos(angle) + 0.25 * np.cos(2.0 * angle))
        motor += noise[k, 0]
        table += noise[k, 1]
        if loop.count_m > 0.0:
            motor = loop.count_m * np.round(motor / loop.count_m)
        if wrong.step_m > 0.0:
            motor = wrong.step_m * np.ceil(motor / wrong.step_m)
        reading = table if loop.reads_table > 0.5 else motor
        source = motor if loop.form == TWO_SENSORS else reading
        if k == 0:
            last_motor = source
        speed = (source - last_motor) / period
        last_motor = source
        if loop.form == TACHOMETER:
            speed = y[1]
        if filter_s > 0.0:
            speed_filtered += (speed - speed_filtered) * period / (period + filter_s)
            speed = speed_filtered
        wanted = loop.velocity_feedforward * (1.0 - wrong.feedforward_loss) * reference[k, 1]
        error = reference[k, 0] - reading
        ahead = loop.acceleration_feedforward_kg * reference[k, 2]
        if loop.form == TORQUE:
            ideal = reference[k, 3]
        elif loop.form == COUNTS:
            counts = np.round(reference[k, 0] / loop.count_m) - np.round(reading / loop.count_m)
            width = loop.deadband_counts
            counts = np.sign(counts) * max(abs(counts) - width, 0.0)
            now = counts * loop.count_m
            rate = wanted - speed
            ideal = loop.velocity_gain_N_s_per_m * (loop.position_gain_per_s * now + rate) + ahead
            ideal += loop.integral_gain_N_per_m * integral
            integral += now * period
        else:
            both = wanted + loop.position_gain_per_s * error - speed
            ideal = loop.velocity_gain_N_s_per_m * both + loop.integral_gain_N_per_m * integral + ahead
            if loop.form == FILTERED:
                limited = min(max(ideal, -loop.force_limit_N), loop.force_limit_N)
                integral += period * (0.5 * (both + last_error) + (limited - ideal) / loop.velocity_gain_N_s_per_m)
                last_error = both
            elif abs(ideal) < loop.force_limit_N:
                integral += period * both
        force = min(max(ideal, -loop.force_limit_N), loop.force_limit_N)
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
