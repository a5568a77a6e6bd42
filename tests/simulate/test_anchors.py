"""Effects on an axis against their closed forms."""

import dataclasses

import numpy as np
import pytest
import scipy.signal
from numpy.typing import NDArray
from rig import BALL_SCREW, MASS_KG, axis, column, effect, push, rigid, switch
from scipy.linalg import expm

from fdbench.effects import effects
from fdbench.motions.held_levels import HeldLevels
from fdbench.plants._controllers import Cascade
from fdbench.plants.feed_drive import FeedDrive
from fdbench.simulate.compose import compose
from fdbench.simulate.system import Noise

FloatArray = NDArray[np.float64]
PERIOD_S = 1e-3
STEP_N = 100.0
THERE_AND_BACK = HeldLevels(levels_m_per_s=(0.01, -0.01), hold_s=1.0, acceleration_limit_m_per_s2=2.0)
MOTOR_SIDE = Cascade(
    position_gain_per_s=40.0,
    velocity_gain_N_s_per_m=2e4,
    integral_gain_N_per_m=2e5,
    velocity_feedforward=1.0,
    acceleration_feedforward_kg=0.0,
    force_limit_N=6000.0,
    difference_span=0,
)
TABLE_SIDE = dataclasses.replace(MOTOR_SIDE, feedback="table", integral_gain_N_per_m=0.0)


def screw_axis() -> FeedDrive:
    """Return the ball screw axis without viscous friction on the table, so that friction alone stretches the screw."""
    assert BALL_SCREW.table is not None
    table = dataclasses.replace(BALL_SCREW.table, viscous_friction_N_s_per_m=0.0)
    return dataclasses.replace(BALL_SCREW, table=table, controller=MOTOR_SIDE)


def rigid_axis_with_scale() -> FeedDrive:
    """Return a rigid axis whose loop is closed, and whose ``position_m`` is read, at the table."""
    return rigid(viscous=200.0, controller=TABLE_SIDE)


def velocity_after(forces: FloatArray, *on: object, period_s: float = PERIOD_S, **changes: float) -> FloatArray:
    """Return the velocity of the free mass at the samples."""
    made = axis(rigid(**changes), *on, sampling_time_s=period_s)  # type: ignore[arg-type]
    return column(made, push(made, forces), "velocity_m_per_s")


def test_current_loop_lag_answers_a_step_in_closed_form() -> None:
    tau = 7e-4
    v = velocity_after(np.full(30, STEP_N), effect("current_loop_lag", time_constant_s=tau, inverter_ratio=0.0))
    t = np.arange(30) * PERIOD_S
    assert np.abs(v - STEP_N / MASS_KG * (t - tau * (1.0 - np.exp(-t / tau)))).max() < 1e-13


@pytest.mark.parametrize("ratio", [0.01, 0.16, 0.25, 0.39, 0.5])
def test_a_loop_with_a_slow_inverter_answers_a_step_as_its_transfer_function_does(ratio: float) -> None:
    """The velocity after a step of the force is the step response of 1 / (s (rho tau^2 s^2 + tau s + 1))."""
    tau, t = 7e-4, np.arange(30) * PERIOD_S
    v = velocity_after(np.full(30, STEP_N), effect("current_loop_lag", time_constant_s=tau, inverter_ratio=ratio))
    _, expected = scipy.signal.step(([1.0], [ratio * tau**2, tau, 1.0, 0.0]), T=t)
    assert np.abs(v - STEP_N / MASS_KG * expected).max() < 1e-9 * np.abs(v).max()


@pytest.mark.parametrize("delay_s", [0.3e-3, 0.5e-3, 1e-3, 1.2345e-3, 2e-3])
def test_dead_time_shifts_the_held_command_exactly(delay_s: float) -> None:
    forces = np.random.default_rng(7).uniform(-STEP_N, STEP_N, 60)
    v = velocity_after(forces, effect("dead_time", dead_time_s=delay_s))
    t = np.arange(60) * PERIOD_S
    knots = np.concatenate(([0.0], np.cumsum(forces))) * PERIOD_S  # impulse of the command at the samples
    impulse = np.interp(t - delay_s, np.arange(61) * PERIOD_S, knots)
    assert np.abs(v - impulse / MASS_KG).max() < 1e-13


def test_dead_time_and_lag_act_one_after_the_other() -> None:
    tau, delay = 1e-3, 1.25e-3
    on = effect("current_loop_lag", time_constant_s=tau, inverter_ratio=0.0), effect("dead_time", dead_time_s=delay)
    v = velocity_after(np.full(30, STEP_N), *on)
    late = np.maximum(np.arange(30) * PERIOD_S - delay, 0.0)
    assert np.abs(v - STEP_N / MASS_KG * (late - tau * (1.0 - np.exp(-late / tau)))).max() < 1e-5


def test_force_saturation_is_what_the_mass_feels() -> None:
    v = velocity_after(np.full(30, 2000.0), effect("force_saturation", saturation_per_N=5e-4))
    assert v[-1] == pytest.approx(2000.0 / np.sqrt(2.0) / MASS_KG * 29 * PERIOD_S, rel=1e-12)


def test_quadratic_drag_slows_down_as_one_over_time() -> None:
    c = 100.0
    made = axis(rigid(), effect("quadratic_drag", quadratic_drag_N_s2_per_m2=c), duration_s=2.0)
    push(made, np.full(100, 1000.0))
    v = column(made, push(made, np.zeros(1000)), "velocity_m_per_s")
    t = np.arange(1000) * PERIOD_S
    assert v[0] > 1.0
    assert np.abs(v - v[0] / (1.0 + c * v[0] / MASS_KG * t)).max() < 1e-7


def test_periodic_force_moves_a_free_mass() -> None:
    A, f, phi = 50.0, 30.0, 0.4
    on = effect("periodic_force", force_amplitude_N=A, frequency_Hz=f, phase_rad=phi)
    v = velocity_after(np.zeros(300), on)
    omega, t = 2.0 * np.pi * f, np.arange(300) * PERIOD_S
    closed = A / (MASS_KG * omega) * (np.cos(omega * t + phi) - np.cos(phi))
    assert np.abs(v - closed).max() < 1e-4 * A / (MASS_KG * omega)


def test_structural_mode_is_the_linear_system_of_two_masses() -> None:
    m, f, zeta = 8.0, 60.0, 0.05
    omega = 2.0 * np.pi * f
    k, c = m * omega**2, 2.0 * m * zeta * omega
    A = np.zeros((4, 4))  # table x, v; mass on the table x, v
    A[0, 1] = A[2, 3] = 1.0
    A[1] = np.array([-k, -c, k, c]) / MASS_KG
    A[3] = np.array([k, c, -k, -c]) / m
    B = np.array([0.0, 1.0 / MASS_KG, 0.0, 0.0])
    flow = expm(np.block([[A, B[:, None]], [np.zeros((1, 5))]]) * PERIOD_S)
    forces = np.random.default_rng(2).uniform(-STEP_N, STEP_N, 400)
    state, closed = np.zeros(4), []
    for force in forces:
        closed.append(state[1])
        state = flow[:4, :4] @ state + flow[:4, 4] * force
    on = effect("structural_mode", moving_mass_kg=m, natural_frequency_Hz=f, damping_ratio=zeta)
    errors = []
    for substeps in (10, 20):
        made = axis(rigid(), on, substeps=substeps)
        errors.append(np.abs(column(made, push(made, forces), "velocity_m_per_s") - closed).max())
    assert errors[0] < 1e-3 * np.abs(closed).max()
    assert errors[0] / errors[1] > 2.0**1.8


def test_structural_mode_holds_the_table_still_at_its_frequency() -> None:
    f, zeta, seconds = 60.0, 0.02, 1.5
    frequencies = np.arange(50.0, 70.5, 1.0)
    on = effect("structural_mode", moving_mass_kg=20.0, natural_frequency_Hz=f, damping_ratio=zeta)
    made = axis(rigid(), on, duration_s=seconds, sampling_time_s=5e-4, n_lanes=len(frequencies))
    t = np.arange(made.n_samples) * 5e-4
    rows = [made.advance(1, STEP_N * np.sin(2.0 * np.pi * frequencies * now)) for now in t]
    v = np.concatenate(rows)[:, made.columns.index("velocity_m_per_s")]
    late = t > 1.0
    amplitudes = []
    for lane, frequency in enumerate(frequencies):
        phase = 2.0 * np.pi * frequency * t[late]
        design = np.column_stack((np.sin(phase), np.cos(phase), np.ones(late.sum())))
        amplitudes.append(np.hypot(*np.linalg.lstsq(design, v[late, lane], rcond=None)[0][:2]))
    s = 2j * np.pi * frequencies
    omega = 2.0 * np.pi * f
    carried = 20.0 * (omega**2 + 2.0 * zeta * omega * s) / (s**2 + 2.0 * zeta * omega * s + omega**2)
    held = np.sinc(frequencies * 5e-4)
    assert frequencies[int(np.argmin(amplitudes))] == f
    assert np.allclose(amplitudes, held * np.abs(STEP_N / (s * (MASS_KG + carried))), rtol=0.01, atol=2e-5)


def lead_error_of(x: FloatArray) -> FloatArray:
    return 4e-6 * (np.sin(2.0 * np.pi * x / 0.01 + 0.7) - np.sin(0.7)) + 3e-5 * x


LEAD_ERROR = effect("lead_error", periodic_error_m=4e-6, linear_error=3e-5, period_m=0.01, phase_rad=0.7)


def test_lead_error_is_what_encoder_and_scale_differ_by() -> None:
    made = axis(screw_axis(), LEAD_ERROR, motion=THERE_AND_BACK, duration_s=2.0)
    rows = made.advance(made.n_samples)
    x_m, x_t = column(made, rows, "motor_position_m"), column(made, rows, "table_position_m")
    steady = np.r_[300:950, 1300:1900]
    assert np.abs((x_t - x_m - lead_error_of(x_m))[steady]).max() < 1e-9


def test_lead_error_of_a_rigid_axis_shows_at_its_scale() -> None:
    made = axis(rigid_axis_with_scale(), LEAD_ERROR, motion=THERE_AND_BACK, duration_s=2.0)
    rows = made.advance(made.n_samples)
    x_m, x_t = column(made, rows, "motor_position_m"), column(made, rows, "position_m")
    assert np.ptp(x_t - x_m) > 6e-6
    assert np.abs(x_t - x_m - lead_error_of(x_m)).max() < 5e-9


def test_thermal_expansion_grows_with_time_and_distance() -> None:
    on = effect("thermal_expansion", temperature_rise_K=5.0, warm_up_time_s=0.8, fixed_bearing_m=-0.3)
    made = axis(screw_axis(), on, motion=THERE_AND_BACK, duration_s=2.0)
    rows = made.advance(made.n_samples)
    x_m, x_t = column(made, rows, "motor_position_m"), column(made, rows, "table_position_m")
    t = np.arange(made.n_samples) * PERIOD_S
    closed = 1.15e-5 * 5.0 * (1.0 - np.exp(-t / 0.8)) * (x_m + 0.3)
    steady = np.r_[300:950, 1300:1900]
    assert np.abs((x_t - x_m - closed)[steady]).max() < 5e-9


def lost_motion(made: object, rows: FloatArray, table: str) -> float:
    """Return encoder minus scale on the way there, less the same on the way back."""
    behind = column(made, rows, "motor_position_m") - column(made, rows, table)  # type: ignore[arg-type]
    return float(behind[800:950].mean() - behind[1700:1900].mean())


def test_backlash_loses_the_gap_and_twice_the_stretch_under_friction() -> None:
    gap, friction = 8e-6, 120.0
    on = effect("backlash", gap_m=gap), effect("coulomb_friction", coulomb_force_N=friction)
    made = axis(screw_axis(), *on, motion=THERE_AND_BACK, duration_s=2.0)
    lost = lost_motion(made, made.advance(made.n_samples), "table_position_m")
    assert lost == pytest.approx(gap + 2.0 * friction / 6e7, abs=1e-10)


def test_backlash_of_a_rigid_axis_is_play_at_its_scale() -> None:
    gap = 8e-6
    made = axis(rigid_axis_with_scale(), effect("backlash", gap_m=gap), motion=THERE_AND_BACK, duration_s=2.0)
    rows = made.advance(made.n_samples)
    assert lost_motion(made, rows, "position_m") == pytest.approx(gap, abs=1e-12)
    behind = column(made, rows, "motor_position_m") - column(made, rows, "position_m")
    assert np.abs(behind).max() <= 0.5 * gap + 1e-15


def test_backlash_is_what_is_left_of_the_stretch_beside_the_lead_error() -> None:
    on = effect("backlash", gap_m=8e-6), LEAD_ERROR, effect("coulomb_friction", coulomb_force_N=60.0)
    made = axis(screw_axis(), *on, motion=THERE_AND_BACK, duration_s=2.0)
    rows = made.advance(made.n_samples)
    x_m, x_t = column(made, rows, "motor_position_m"), column(made, rows, "table_position_m")
    behind = x_m - x_t + lead_error_of(x_m)
    assert behind[800:950].mean() - behind[1700:1900].mean() == pytest.approx(8e-6 + 2.0 * 60.0 / 6e7, abs=1e-9)


@pytest.mark.parametrize("names", [("lead_error", "backlash"), ("dead_time", "current_loop_lag")])
def test_a_chain_does_not_hang_on_the_order_in_a_scenario(names: tuple[str, str]) -> None:
    first, second = (effects.get(name) for name in names)
    for kinds in ((first, second), (second, first)):
        for lanes in (1, 64):
            stepper = compose(kinds, lanes)
            calls, _ = stepper.calls(np.ones(2, dtype=np.bool_))
            assert [kinds[number] for number in stepper.order] == [first, second]
            np.testing.assert_array_equal(calls, stepper.table)


def test_a_rigid_axis_has_no_stiffness_to_lose() -> None:
    made = axis(rigid_axis_with_scale(), motion=THERE_AND_BACK, duration_s=0.5, n_lanes=2)
    switch(made, effect("axial_compliance", stiffness_loss_percent=50.0), lanes=np.array([0]))
    made.start([0, 0])
    rows = made.advance(made.n_samples)
    assert np.array_equal(rows[:, :, 0], rows[:, :, 1])


def steady_force(velocity: float, *on: object) -> float:
    """Return the force that holds a rigid axis at a constant velocity (N)."""
    motion = HeldLevels(levels_m_per_s=(velocity,), hold_s=10.0, acceleration_limit_m_per_s2=2.0)
    made = axis(rigid(controller=MOTOR_SIDE), *on, motion=motion, duration_s=2.5)  # type: ignore[arg-type]
    rows = made.advance(made.n_samples)
    return float(column(made, rows, "motor_force_N")[-100:].mean())


def test_direction_dependent_friction_takes_its_force_both_ways() -> None:
    on = effect("direction_dependent_friction", viscous_asymmetry_N_s_per_m=80.0, coulomb_asymmetry_N=6.0)
    assert steady_force(0.2, on) == pytest.approx(80.0 * 0.2 + 6.0, rel=1e-5)
    assert steady_force(-0.2, on) == pytest.approx(80.0 * 0.2 + 6.0, rel=1e-5)


def test_load_dependent_friction_takes_its_share_of_a_load() -> None:
    """On a rigid axis F = load + mu F, so that the motor gives load / (1 - mu)."""
    on = effect("load_dependent_friction", friction_coefficient=0.1), effect("constant_force", constant_force_N=900.0)
    assert steady_force(0.2, *on) == pytest.approx(900.0 / 0.9, rel=1e-5)


@pytest.mark.parametrize("kappa", [0.0, 300.0])
def test_cable_pulls_back_and_rubs(kappa: float) -> None:
    """Far beyond the Dahl distance the force is k x + kappa x|x| + F_d."""
    sizes = {"spring_stiffness_N_per_m": 200.0, "stiffening_N_per_m2": kappa, "dahl_force_N": 8.0}
    on = effect("cable_stiffness", dahl_distance_m=0.005, **sizes)
    motion = HeldLevels(levels_m_per_s=(0.1,), hold_s=10.0, acceleration_limit_m_per_s2=2.0)
    made = axis(rigid(controller=MOTOR_SIDE), on, motion=motion, duration_s=3.0)
    rows = made.advance(made.n_samples)
    force, x = column(made, rows, "motor_force_N"), column(made, rows, "motor_position_m")
    assert np.abs(force - ((200.0 + kappa * np.abs(x)) * x + 8.0))[-500:].max() < 0.03


def test_torque_ripple_scales_with_the_command_and_cogging_does_not() -> None:
    """A free mass pushed by F gains the work of F (1 + a sin) or of F - A sin along the way."""
    pitch, F = 0.004, 200.0
    for on, share in (
        (effect("torque_ripple", relative_ripple=0.2, pitch_m=pitch), 0.2 * F),
        (effect("cogging", cogging_force_N=40.0, pitch_m=pitch), -40.0),
    ):
        made = axis(rigid(), on)
        rows = push(made, np.full(150, F))
        x, v = column(made, rows, "motor_position_m"), column(made, rows, "velocity_m_per_s")
        work = F * x + share * pitch / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * x / pitch))
        assert np.abs(0.5 * MASS_KG * v**2 - work).max() < 1e-4 * abs(share) * pitch


def test_encoder_interpolation_error_repeats_with_the_signal_period() -> None:
    A, p = 2e-7, 2e-5
    on = effect("encoder_interpolation_error", error_amplitude_m=A, signal_period_m=p, phase_rad=0.3)
    plain, wrong = (axis(rigid(), *switched) for switched in ((), (on,)))
    x, y = (column(made, push(made, np.full(50, 20.0)), "motor_position_m") for made in (plain, wrong))
    assert np.abs(y - x - A * np.sin(2.0 * np.pi * x / p + 0.3)).max() < 1e-15


def test_friction_drift_dies_away() -> None:
    on = effect("friction_drift", cold_force_N=30.0, warm_up_time_s=0.8)
    motion = HeldLevels(levels_m_per_s=(0.1,), hold_s=10.0, acceleration_limit_m_per_s2=2.0)
    made = axis(rigid(controller=MOTOR_SIDE), on, motion=motion, duration_s=3.0)
    force = column(made, made.advance(made.n_samples), "motor_force_N")
    t = np.arange(made.n_samples) * PERIOD_S
    assert np.abs(force - 30.0 * np.exp(-t / 0.8))[1500:].max() < 0.1


def test_position_dependent_friction_is_the_same_both_ways() -> None:
    on = effect("position_dependent_friction", friction_amplitude_N=20.0, period_m=0.05, phase_rad=0.0)
    slow = HeldLevels(levels_m_per_s=(0.02, -0.02), hold_s=2.0, acceleration_limit_m_per_s2=2.0)
    made = axis(rigid(controller=MOTOR_SIDE), on, motion=slow, duration_s=4.0)
    rows = made.advance(made.n_samples)
    force, x = column(made, rows, "motor_force_N"), column(made, rows, "motor_position_m")
    expected = 20.0 * np.sin(2.0 * np.pi * x / 0.05)
    assert np.abs(force - expected)[300:1950].max() < 0.5
    assert np.abs(force + expected)[2300:3950].max() < 0.5


@pytest.mark.parametrize(("name", "read"), [("encoder_quantisation", "motor"), ("scale_quantisation", "table")])
def test_noise_through_an_encoder_leaves_readings_on_its_grid(name: str, read: str) -> None:
    step, deviation_m = 1e-6, 2e-6
    off = {}
    for through in (False, True):
        noise = Noise(motor_position_m=deviation_m, table_position_m=deviation_m, through_encoders=through)
        made = axis(screw_axis(), effect(name, resolution_m=step), motion=THERE_AND_BACK, noise=noise)
        steps = column(made, made.advance(500), f"{read}_position_m") / step
        off[through] = np.abs(steps - np.round(steps)).max()
        assert np.std(np.diff(steps, 2)) == pytest.approx(np.sqrt(6.0) * deviation_m / step, rel=0.2)
    assert off[True] < 1e-6
    assert off[False] > 0.4


def test_noise_without_an_encoder_is_the_same_on_both_ways() -> None:
    found = []
    for through in (False, True):
        noise = Noise(motor_position_m=2e-6, table_position_m=2e-6, through_encoders=through)
        found.append(axis(screw_axis(), motion=THERE_AND_BACK, noise=noise).advance(500))
    np.testing.assert_array_equal(*found)
