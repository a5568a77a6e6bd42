"""Mechanics of the foreign axes: friction laws, forces and the formula of each imperfection.

Written apart from the package's simulator: of the package it uses the store of compiled code alone.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from fdbench.compilation import kept

TURN = 2.0 * np.pi
TANH, SOFT, ARCTAN, ROOT, BRISTLE = range(5)
RUNGE_KUTTA, HEUN, PROXIMAL = range(3)
N_STATES = 7  # x and v of the motor, x and v of the table, bristle, x and v of the carried mass
STEEL_PER_K = 1.17e-5
HERTZ_M = 5e-7  # over which a contact grows stiff


class Body(NamedTuple):
    """An axis in SI units and coordinates of the table; without stiffness it is one mass."""

    motor_mass_kg: float
    table_mass_kg: float
    motor_viscous_N_s_per_m: float
    table_viscous_N_s_per_m: float
    stiffness_N_per_m: float
    damping_N_s_per_m: float
    motor_friction_N: float
    table_friction_N: float
    law: float
    width_m_per_s: float
    presliding_m: float
    presliding_damping_N_s_per_m: float
    weight_N: float
    integrator: float


class Wrong(NamedTuple):
    """Every imperfection at the size that makes it vanish."""

    cogging_N: float = 0.0
    ripple: float = 0.0
    pitch_m: float = 0.02
    pitch_phase_rad: float = 0.0
    third_harmonic: float = 0.15
    knee_N: float = 0.0
    lag_s: float = 0.0
    late_s: float = 0.0
    step_m: float = 0.0
    division_m: float = 0.0
    division_period_m: float = 2e-5
    division_phase_rad: float = 0.0
    direction_share: float = 0.0
    direction_viscous_N_s_per_m: float = 0.0
    place_N: float = 0.0
    place_period_m: float = 0.1
    place_phase_rad: float = 0.0
    load_share: float = 0.0
    cold_N: float = 0.0
    cold_path_m: float = 1.0
    drag_N_at_1_m_per_s: float = 0.0
    grease_N_s_per_m: float = 0.0
    preload_N: float = 0.0
    stick_N: float = 0.0
    stick_m_per_s: float = 3e-3
    presliding_m: float = 0.0
    presliding_damping_N_s_per_m: float = 0.0
    constant_N: float = 0.0
    payload_kg: float = 0.0
    cable_N_per_m: float = 0.0
    cable_length_m: float = 0.5
    line_N: float = 0.0
    line_Hz: float = 50.0
    line_phase_rad: float = 0.0
    gap_m: float = 0.0
    softening: float = 0.0
    carried_kg: float = 0.0
    carried_Hz: float = 60.0
    carried_damping: float = 0.03
    screw_error_m: float = 0.0
    screw_period_m: float = 0.01
    screw_phase_rad: float = 0.0
    warming_K: float = 0.0
    warming_path_m: float = 1.0
    bearing_m: float = -0.2
    bump_N: float = 0.0
    bump_place_m: float = 0.05
    bump_width_m: float = 3e-3
    loop_N: float = 0.0
    loop_m: float = 1e-4
    filter_s: float = 0.0
    feedforward_loss: float = 0.0
    scale_late_s: float = 0.0
    constant_share: float = 0.0
    dip: float = 0.0
    dip_m_per_s: float = 0.02
    square_N: float = 0.0
    thrust_N: float = 0.0


@kept
@njit(error_model="numpy")
def unit_friction(law: float, v: float, width: float) -> float:
    """Return a friction curve for a level of 1; that of bristles is the sign at speed."""
    ratio: float = v / width
    if law == TANH:
        return float(np.tanh(ratio))
    if law == SOFT:
        return min(max(ratio, -1.0), 1.0)
    if law == ARCTAN:
        return float(np.arctan(0.5 * np.pi * ratio) / (0.5 * np.pi))
    return float(ratio / np.sqrt(1.0 + ratio * ratio))


@kept
@njit(error_model="numpy")
def delivered_force(asked: float, x: float, w: Wrong) -> float:
    """Return what the motor gives of an asked force: saturation of third order, two harmonics of ripple, magnets."""
    if w.knee_N > 0.0:
        asked /= (1.0 + abs(asked / w.knee_N) ** 3) ** (1.0 / 3.0)
    if w.ripple != 0.0:
        angle = TURN * x / w.pitch_m + w.pitch_phase_rad
        asked *= 1.0 + w.ripple * (np.sin(angle) + w.third_harmonic * np.sin(2.0 * angle))
    return asked * (1.0 + w.constant_share)


@kept
@njit(error_model="numpy")
def contact(u: float, gap: float) -> float:
    """Return the compression of two flanks a gap apart; each grows stiff over a short way as curved bodies do."""
    if gap <= 0.0:
        return u
    d: float = abs(u) - 0.5 * gap
    if d <= 0.0:
        return 0.0
    return float(np.sign(u) * d * d / (d + HERTZ_M))


@kept
@njit(error_model="numpy")
def screw_shift(x: float, path: float, w: Wrong) -> float:
    """Return by how much the unloaded table is beyond the motor (m): periodic error, and growth with the path run."""
    shift = 0.0
    if w.screw_error_m != 0.0:
        angle = TURN * x / w.screw_period_m + w.screw_phase_rad
        shift += w.screw_error_m * (np.cos(angle) + 0.2 * np.cos(2.0 * angle))
    if w.warming_K != 0.0:
        shift += STEEL_PER_K * w.warming_K * path / (path + w.warming_path_m) * (x - w.bearing_m)
    return shift


@kept
@njit(error_model="numpy")
def guide_force(x: float, v: float, load: float, path: float, b: Body, w: Wrong, scale: float) -> float:
    """Return what resists the table besides its own friction law, bristles and hysteresis (N)."""
    sign = unit_friction(ROOT, v, b.width_m_per_s)
    force: float = scale * b.table_viscous_N_s_per_m * v + b.weight_N + w.constant_N
    force += w.grease_N_s_per_m * v + w.direction_viscous_N_s_per_m * abs(v) + w.preload_N * sign
    if w.stick_N != 0.0:
        speed = v / w.stick_m_per_s
        force += w.stick_N / (1.0 + speed * speed) * sign
    if w.place_N != 0.0:
        angle = TURN * x / w.place_period_m + w.place_phase_rad
        force += w.place_N * (np.sin(angle) + 0.5 * w.third_harmonic * np.sin(3.0 * angle)) * sign
    force += w.load_share * abs(load) * sign
    if w.cold_N != 0.0:
        force += w.cold_N * np.exp(-path / w.cold_path_m) * sign
    if w.drag_N_at_1_m_per_s != 0.0:
        force += w.drag_N_at_1_m_per_s * abs(v) ** 0.8 * v
    if w.cable_N_per_m != 0.0:
        force += w.cable_N_per_m * x * (1.0 + abs(x) / w.cable_length_m)
    if w.bump_N != 0.0:
        away = (x - w.bump_place_m) / w.bump_width_m
        force += w.bump_N * np.exp(-0.5 * away * away) * sign
    return force


@kept
@njit(error_model="numpy")
def friction_level(v: float, b: Body, w: Wrong, scale: float) -> float:
    """Return the level of the table's own friction (N): uneven in direction, below its value at low speed."""
    level: float = scale * b.table_friction_N * (1.0 + w.direction_share * unit_friction(ROOT, v, b.width_m_per_s))
    if w.dip != 0.0:
        level *= 1.0 - w.dip * np.exp(-abs(v) / w.dip_m_per_s)
    return level


@kept
@njit(error_model="numpy")
def derivative(t, y, dy, b, w, force, outer, path, scale, own):  # type: ignore[no-untyped-def]
    """Write the time derivative of the state; with ``own`` 0 the table's own friction law is left out."""
    x, v = y[0], y[1]
    rigid = b.stiffness_N_per_m == 0.0
    motor = force - b.motor_viscous_N_s_per_m * v
    if w.cogging_N != 0.0:
        angle = TURN * x / w.pitch_m + w.pitch_phase_rad
        motor -= w.cogging_N * (np.cos(angle) + 0.3 * np.cos(2.0 * angle) + w.third_harmonic * np.cos(3.0 * angle))
    if rigid:
        x_t, v_t, screw = x, v, force
    else:
        x_t, v_t = y[2], y[3]
        motor -= scale * b.motor_friction_N * unit_friction(b.law, v, b.width_m_per_s)
        stiffness = b.stiffness_N_per_m * (1.0 - w.softening)
        squeezed = contact(x + screw_shift(x, path, w) - x_t, w.gap_m)
        share = 1.0 if w.gap_m <= 0.0 or squeezed != 0.0 else 0.0
        screw = stiffness * squeezed + share * b.damping_N_s_per_m * (v - v_t)
    guide = guide_force(x_t, v_t, screw, path, b, w, scale) + outer
    if w.line_N != 0.0:
        angle = TURN * w.line_Hz * t + w.line_phase_rad
        guide += w.line_N * (np.sin(angle) + 0.1 * np.sin(3.0 * angle))
    level = friction_level(v_t, b, w, scale)
    presliding = b.presliding_m if w.presliding_m == 0.0 else w.presliding_m
    dy[4] = 0.0
    if presliding > 0.0:
        # Dahl's bristle with a softening of power 1.5, so that it is no curve of the library.
        load = min(max(y[4] / presliding, -1.0), 1.0)
        slip = 1.0 - load * np.sign(v_t)
        dy[4] = v_t * np.sign(slip) * abs(slip) ** 1.5
        guide += level * load + (b.presliding_damping_N_s_per_m + w.presliding_damping_N_s_per_m) * dy[4]
    elif own > 0.0:
        guide += level * unit_friction(b.law, v_t, b.width_m_per_s)
    dy[5] = dy[6] = 0.0
    if w.carried_kg > 0.0:
        omega = TURN * w.carried_Hz
        pull = w.carried_kg * omega * (omega * (y[5] - x_t) + 2.0 * w.carried_damping * (y[6] - v_t))
        guide -= pull
        dy[5], dy[6] = y[6], -pull / w.carried_kg
    table_mass = b.table_mass_kg + w.payload_kg
    dy[0], dy[2] = v, v_t
    if rigid:
        dy[1] = (motor - guide) / (b.motor_mass_kg + table_mass)
        dy[3] = dy[1]
    else:
        dy[1] = (motor - screw) / b.motor_mass_kg
        dy[3] = (screw - guide) / table_mass


@kept
@njit(error_model="numpy")
def advance(t, h, y, slopes, trial, b, w, force, outer, path, scale):  # type: ignore[no-untyped-def]
    """Advance the state by one step with the integrator of the kind."""
    n = y.shape[0]
    if b.integrator == RUNGE_KUTTA:
        for stage in range(4):
            ahead = (0.0, 0.5 * h, 0.5 * h, h)[stage]
            for i in range(n):
                trial[i] = y[i] + ahead * (slopes[stage - 1, i] if stage > 0 else 0.0)
            derivative(t + ahead, trial, slopes[stage], b, w, force, outer, path, scale, 1.0)
        for i in range(n):
            y[i] += h / 6.0 * (slopes[0, i] + 2.0 * slopes[1, i] + 2.0 * slopes[2, i] + slopes[3, i])
    elif b.integrator == HEUN:
        derivative(t, y, slopes[0], b, w, force, outer, path, scale, 1.0)
        for i in range(n):
            trial[i] = y[i] + h * slopes[0, i]
        derivative(t + h, trial, slopes[1], b, w, force, outer, path, scale, 1.0)
        for i in range(n):
            y[i] += 0.5 * h * (slopes[0, i] + slopes[1, i])
    else:
        # Velocities first; friction by the proximal step of its regularised constraint, as solvers of contacts do.
        derivative(t, y, slopes[0], b, w, force, outer, path, scale, 0.0)
        for i in (1, 3, 6):
            y[i] += h * slopes[0, i]
        rigid = b.stiffness_N_per_m == 0.0
        place = 1 if rigid else 3
        if b.presliding_m == 0.0 and w.presliding_m == 0.0:
            mass = b.table_mass_kg + w.payload_kg + (b.motor_mass_kg if rigid else 0.0)
            impulse = h * friction_level(y[place], b, w, scale) / mass
            sticking = y[place] / (1.0 + impulse / b.width_m_per_s)
            sliding = y[place] - np.sign(y[place]) * impulse
            y[place] = sticking if abs(sticking) <= b.width_m_per_s else sliding
        if rigid:
            y[3] = y[1]
        y[4] += h * slopes[0, 4]
        for i in (0, 2, 5):
            y[i] += h * y[i + 1]
    presliding = b.presliding_m if w.presliding_m == 0.0 else w.presliding_m
    y[4] = min(max(y[4], -presliding), presliding)
    if b.stiffness_N_per_m == 0.0:
        y[2], y[3] = y[0], y[1]
