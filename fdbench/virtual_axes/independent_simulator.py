"""A second implementation of a ball-screw axis and of what may be wrong with it, for blind trials.

Written apart from the package's simulator: it imports nothing of the package, integrates by the classical
fourth-order Runge-Kutta method at a finer step, and has another formula for every imperfection. What it may share
with the diagnosis is the task: a command in, readings out.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STEPS = 40  # integration steps in one control period
N_STOPS = 11  # elements of hysteresis: 6 of the guideway, 3 of the cable, 2 of something else
GUIDE, CABLE, OTHER = 0, 6, 9
N_STATES = 8
TURN = 2.0 * np.pi
STEEL_PER_K = 1.15e-5


class IdealAxis(NamedTuple):
    """An axis without imperfections: SI units, masses and forces in the table's coordinates."""

    motor_mass_kg: float
    table_mass_kg: float
    motor_viscous_N_s_per_m: float
    table_viscous_N_s_per_m: float
    stiffness_N_per_m: float
    damping_N_s_per_m: float
    sliding_friction_N: float
    sliding_velocity_m_per_s: float
    lead_m: float


class CascadeLoop(NamedTuple):
    """Position and velocity cascade with an integral part, as a drive has it."""

    position_gain_per_s: float
    velocity_gain_N_s_per_m: float
    integral_gain_N_per_m: float
    force_limit_N: float
    reads_table: float


class Disturbances(NamedTuple):
    """Standard deviations of what disturbs readings and axis.

    ``colour`` is the correlation of neighbours (0: white), ``latency`` the share of a control period after which a
    computed force acts.
    """

    position_noise_m: float
    force_noise_N: float
    process_force_N: float
    colour: float
    latency: float


class Imperfections(NamedTuple):
    """Every imperfection at the size that makes it vanish; see `march` for the formulae."""

    falling_force_N: float = 0.0
    falling_velocity_m_per_s: float = 1e-3
    presliding_distance_m: float = 0.0
    presliding_damping_N_s_per_m: float = 0.0
    breakaway_ratio: float = 1.0
    uneven_viscous_N_s_per_m: float = 0.0
    uneven_friction_N: float = 0.0
    place_force_N: float = 0.0
    place_period_m: float = 0.1
    place_phase_rad: float = 0.0
    load_coefficient: float = 0.0
    cold_force_N: float = 0.0
    cold_time_s: float = 10.0
    drag_N_at_1_m_per_s: float = 0.0
    gap_m: float = 0.0
    softening: float = 0.0
    carried_mass_kg: float = 0.0
    carried_frequency_Hz: float = 60.0
    carried_damping_ratio: float = 0.03
    screw_error_m: float = 0.0
    screw_slope: float = 0.0
    screw_phase_rad: float = 0.0
    warming_K: float = 0.0
    warming_time_s: float = 10.0
    warming_origin_m: float = -0.2
    detent_force_N: float = 0.0
    detent_order: float = 6.0
    detent_phase_rad: float = 0.0
    ripple: float = 0.0
    ripple_order: float = 6.0
    ripple_phase_rad: float = 0.0
    iron_force_N: float = 0.0
    current_rise_s: float = 0.0
    late_s: float = 0.0
    step_m: float = 0.0
    division_error_m: float = 0.0
    division_period_m: float = 2e-5
    division_phase_rad: float = 0.0
    chain_stiffness_N_per_m: float = 0.0
    chain_force_N: float = 0.0
    chain_distance_m: float = 5e-3
    weight_N: float = 0.0
    payload_kg: float = 0.0
    grease_N_s_per_m: float = 0.0
    preload_friction_N: float = 0.0
    line_force_N: float = 0.0
    line_frequency_Hz: float = 50.0
    line_phase_rad: float = 0.0
    loop_force_N: float = 0.0
    loop_distance_m: float = 5e-5
    bump_force_N: float = 0.0
    bump_place_m: float = 0.05
    bump_width_m: float = 2e-3
    filter_s: float = 0.0
    scale_delay_s: float = 0.0
    feedforward_loss: float = 0.0


def simulate(
    machine: IdealAxis,
    loop: CascadeLoop,
    sensors: Disturbances,
    wrong: Imperfections,
    reference: FloatArray,
    period_s: float,
    rng: np.random.Generator,
    friction_change: float = 0.0,
) -> dict[str, FloatArray]:
    """Return what a logger would write: position of motor and table (m) and the force asked of the motor (N).

    Parameters
    ----------
    machine, loop, sensors, wrong : named tuples
    reference : (n_samples, 3) array
        Commanded position (m), velocity (m/s) and acceleration (m/s^2).
    period_s : float
    rng : numpy Generator
    friction_change : float
        By how much all friction differs in this run, as a share.
    """
    n = len(reference)
    noise = np.stack([coloured(rng, n, sensors.colour) for _ in range(4)], axis=1)
    noise *= (sensors.position_noise_m, sensors.position_noise_m, sensors.force_noise_N, sensors.process_force_N)
    stiffness, limit = _hysteresis(machine, wrong)
    scale = 1.0 + friction_change
    return dict(
        zip(
            ("motor_position_m", "table_position_m", "motor_force_N"),
            march(
                machine,
                loop,
                wrong,
                np.ascontiguousarray(reference),
                period_s,
                noise,
                sensors.latency,
                stiffness,
                limit * scale,
                scale,
            ).T,
            strict=True,
        )
    )


def coloured(rng: np.random.Generator, n: int, colour: float) -> FloatArray:
    """Return n samples of unit variance whose neighbours have the correlation ``colour``."""
    fresh = rng.standard_normal(n) * np.sqrt(1.0 - colour**2)
    result = np.empty(n)
    last = float(rng.standard_normal())
    for index, value in enumerate(fresh):
        last = colour * last + float(value)
        result[index] = last
    return result


def _hysteresis(machine: IdealAxis, wrong: Imperfections) -> tuple[FloatArray, FloatArray]:
    """Return stiffness (N/m) and slip limit (N) of the stop elements; elements of no limit are none."""
    stiffness, limit = np.zeros(N_STOPS), np.zeros(N_STOPS)
    if wrong.presliding_distance_m > 0.0:
        spread = np.geomspace(0.25, 2.5, CABLE - GUIDE)
        limit[GUIDE:CABLE] = (machine.sliding_friction_N - wrong.loop_force_N) / len(spread)
        stiffness[GUIDE:CABLE] = limit[GUIDE:CABLE] / (wrong.presliding_distance_m * spread)
    if wrong.chain_force_N > 0.0:
        spread = np.array([0.4, 1.0, 2.0])
        limit[CABLE:OTHER] = wrong.chain_force_N * np.array([0.3, 0.4, 0.3])
        stiffness[CABLE:OTHER] = limit[CABLE:OTHER] / (wrong.chain_distance_m * spread)
    if wrong.loop_force_N > 0.0:
        limit[OTHER:] = wrong.loop_force_N * np.array([0.6, 0.4])
        stiffness[OTHER:] = limit[OTHER:] / (wrong.loop_distance_m * np.array([0.5, 1.5]))
    return stiffness, limit


@njit(cache=True, error_model="numpy")
def _bend(v: float, v_0: float) -> float:
    """Return a smooth sign of the velocity."""
    ratio: float = v / np.sqrt(v * v + v_0 * v_0)
    return ratio


@njit(cache=True, error_model="numpy")
def _wobble(turn: float, phase: float) -> float:
    """Return the periodic error of the screw for an amplitude of 1."""
    wobble: float = np.sin(turn + phase) - np.sin(phase) + 0.25 * np.sin(2.0 * turn)
    return wobble


@njit(cache=True, error_model="numpy")
def _contact(u: float, gap: float) -> tuple[float, float]:
    """Return what a rounded dead zone passes on of a stretch, and its derivative."""
    if gap <= 0.0:
        return u, 1.0
    half, r = 0.5 * gap, 0.05 * gap
    a, b = u - half, -u - half
    root_a, root_b = np.sqrt(a * a + r * r), np.sqrt(b * b + r * r)
    return 0.5 * (a + root_a) - 0.5 * (b + root_b), 0.5 * (1.0 + a / root_a) + 0.5 * (1.0 + b / root_b)


@njit(cache=True, error_model="numpy")
def _derivative(t, y, dy, x_0, m, w, force, process, stops, stiffness, limit, s):  # type: ignore[no-untyped-def]
    """Write the time derivative of the state: x_m, v_m, x_t, v_t, current and its rate, carried mass q and p."""
    x_m, v_m, x_t, v_t = y[0], y[1], y[2], y[3]
    # Motor: second-order current loop, force constant that ripples, detent with a third harmonic.
    if w.current_rise_s > 0.0:
        omega = 1.6 / w.current_rise_s
        delivered = y[4]
        dy[4] = y[5]
        dy[5] = omega * omega * (force - y[4]) - 1.6 * omega * y[5]
    else:
        delivered = force
        dy[4] = dy[5] = 0.0
    if w.iron_force_N > 0.0:
        delivered = w.iron_force_N * np.arctan(delivered / w.iron_force_N)
    turn = TURN * x_m / m.lead_m
    if w.ripple != 0.0:
        delivered *= 1.0 + w.ripple * np.sin(w.ripple_order * turn + w.ripple_phase_rad)
    motor = delivered - m.motor_viscous_N_s_per_m * s * v_m
    if w.detent_force_N != 0.0:
        angle = w.detent_order * turn + w.detent_phase_rad
        motor -= w.detent_force_N * (np.sin(angle) + 0.2 * np.sin(3.0 * angle))
    # Screw: wobble with a second harmonic, slope, growth with two time constants, rounded gap, softer with distance.
    grown = w.screw_slope * x_m
    if w.screw_error_m != 0.0:
        grown += w.screw_error_m * _wobble(turn, w.screw_phase_rad)
    if w.warming_K != 0.0:
        warmth = 1.0 - 0.6 * np.exp(-t / w.warming_time_s) - 0.4 * np.exp(-0.3 * t / w.warming_time_s)
        grown += STEEL_PER_K * w.warming_K * warmth * (x_m - w.warming_origin_m)
    stretch, share = _contact(x_m + grown - x_t, w.gap_m)
    compliance = 1.0 + w.softening * (1.0 + 2.0 * x_t)
    screw = m.stiffness_N_per_m * stretch / compliance + m.damping_N_s_per_m * share * (v_m - v_t) / compliance
    # Guideway.
    rub = _bend(v_t, 0.7 * m.sliding_velocity_m_per_s)
    if w.presliding_distance_m > 0.0:
        guide = w.presliding_damping_N_s_per_m * v_t / (1.0 + abs(v_t) / m.sliding_velocity_m_per_s)
        lift = 1.0 + (w.breakaway_ratio - 1.0) / (1.0 + abs(v_t) / 2e-3)
    else:
        guide = s * (m.sliding_friction_N - w.loop_force_N) * np.tanh(v_t / m.sliding_velocity_m_per_s)
        lift = 1.0
    guide += s * m.table_viscous_N_s_per_m * v_t + w.grease_N_s_per_m * v_t / (1.0 + 0.3 * abs(v_t))
    if w.falling_force_N != 0.0:
        guide += w.falling_force_N * np.exp(-abs(v_t) / w.falling_velocity_m_per_s) * rub
    guide += w.preload_friction_N * rub
    guide += w.uneven_friction_N * rub * rub + w.uneven_viscous_N_s_per_m * abs(v_t)
    if w.place_force_N != 0.0:
        place = TURN * x_t / w.place_period_m + w.place_phase_rad
        guide += w.place_force_N * (np.sin(place) + 0.15 * np.sin(2.0 * place)) * rub
    if w.load_coefficient != 0.0:
        guide += w.load_coefficient * np.sqrt(screw * screw + 25.0) * rub
    guide += w.cold_force_N / (1.0 + t / w.cold_time_s) * rub
    if w.drag_N_at_1_m_per_s != 0.0:
        guide += w.drag_N_at_1_m_per_s * abs(v_t) ** 0.75 * v_t
    guide += w.chain_stiffness_N_per_m * x_t + w.weight_N
    if w.line_force_N != 0.0:
        angle = TURN * w.line_frequency_Hz * t + w.line_phase_rad
        guide += w.line_force_N * (np.sin(angle) + 0.15 * np.cos(2.0 * angle))
    if w.bump_force_N != 0.0:
        away = (x_t - w.bump_place_m) / w.bump_width_m
        guide += w.bump_force_N / (1.0 + away * away) ** 2 * rub
    for i in range(stops.shape[0]):
        if limit[i] > 0.0:
            top = limit[i] * lift if i < CABLE else limit[i]
            guide += min(max(stops[i] + stiffness[i] * (x_t - x_0), -top), top)
    # Carried mass: absolute position q and velocity p, held by a spring.
    table_mass = m.table_mass_kg + w.payload_kg
    dy[6] = dy[7] = 0.0
    if w.carried_mass_kg > 0.0:
        omega = TURN * w.carried_frequency_Hz
        pull = w.carried_mass_kg * (omega * omega * (y[6] - x_t) + 2.0 * w.carried_damping_ratio * omega * (y[7] - v_t))
        guide -= pull
        dy[6] = y[7]
        dy[7] = -pull / w.carried_mass_kg
    dy[0] = v_m
    dy[1] = (motor - screw) / m.motor_mass_kg
    dy[2] = v_t
    dy[3] = (screw - guide - process) / table_mass


@njit(cache=True, error_model="numpy")
def march(machine, loop, wrong, reference, period, noise, latency, stiffness, limit, scale):  # type: ignore[no-untyped-def]
    """Return the (n_samples, 3) readings of motor position, table position and asked force."""
    n = reference.shape[0]
    out = np.empty((n, 3))
    h = period / STEPS
    y, trial, slopes = np.zeros(N_STATES), np.empty(N_STATES), np.empty((4, N_STATES))
    stops = np.zeros(stiffness.shape[0])
    y[0] = y[2] = y[6] = reference[0, 0]
    # The screw is at rest at the start, its error included.
    wobble = _wobble(TURN * reference[0, 0] / machine.lead_m, wrong.screw_phase_rad)
    y[2] = y[6] = reference[0, 0] + wrong.screw_error_m * wobble + wrong.screw_slope * reference[0, 0]
    delay = max(1, int(np.ceil((latency * period + wrong.late_s) / h)))
    n_late = delay + STEPS + 1
    asked = np.zeros(n_late)
    n_past = int(np.ceil(wrong.scale_delay_s / h)) + 2
    past = np.full(n_past, y[2])
    back = wrong.scale_delay_s / h
    whole, part = int(back), back - int(back)
    late = (latency * period + wrong.late_s) / h
    late_whole, late_part = int(late), late - int(late)
    integral = filtered = 0.0
    previous = reference[0, 0]
    count = 0
    force = 0.0
    for k in range(n):
        a, b = (count - whole) % n_past, (count - whole - 1) % n_past
        motor = y[0]
        table = past[a] * (1.0 - part) + past[b] * part
        angle = TURN * motor / wrong.division_period_m + wrong.division_phase_rad
        motor += wrong.division_error_m * (np.sin(angle) + 0.3 * np.sin(2.0 * angle))
        motor += noise[k, 0]
        table += noise[k, 1]
        if wrong.step_m > 0.0:
            motor = wrong.step_m * (np.floor(motor / wrong.step_m) + 0.5)
        reading = table if loop.reads_table > 0.5 else motor
        if k == 0:
            previous = reading
        speed = (reading - previous) / period
        previous = reading
        if wrong.filter_s > 0.0:
            filtered += (speed - filtered) * (1.0 - np.exp(-period / wrong.filter_s))
            speed = filtered
        wanted = (1.0 - wrong.feedforward_loss) * reference[k, 1]
        error = wanted + loop.position_gain_per_s * (reference[k, 0] - reading) - speed
        ideal = loop.velocity_gain_N_s_per_m * error + loop.integral_gain_N_per_m * integral
        force = min(max(ideal, -loop.force_limit_N), loop.force_limit_N)
        if force == ideal:
            integral += error * period
        out[k, 0] = motor
        out[k, 1] = table
        out[k, 2] = force + noise[k, 2]
        process = noise[k, 3]
        for _ in range(STEPS):
            asked[count % n_late] = force
            older, oldest = (count - late_whole) % n_late, (count - late_whole - 1) % n_late
            acting = asked[older] * (1.0 - late_part) + asked[oldest] * late_part
            t = count * h
            x_0 = y[2]
            for stage in range(4):
                ahead = (0.0, 0.5 * h, 0.5 * h, h)[stage]
                for i in range(N_STATES):
                    trial[i] = y[i] + ahead * (slopes[stage - 1, i] if stage > 0 else 0.0)
                rate = slopes[stage]
                _derivative(
                    t + ahead, trial, rate, x_0, machine, wrong, acting, process, stops, stiffness, limit, scale
                )
            for i in range(N_STATES):
                y[i] += h / 6.0 * (slopes[0, i] + 2.0 * slopes[1, i] + 2.0 * slopes[2, i] + slopes[3, i])
            lift = 1.0 + (wrong.breakaway_ratio - 1.0) / (1.0 + abs(y[3]) / 2e-3)
            for i in range(stops.shape[0]):
                top = limit[i] * lift if i < CABLE else limit[i]
                stops[i] = min(max(stops[i] + stiffness[i] * (y[2] - x_0), -top), top)
            count += 1
            past[count % n_past] = y[2]
    return out
