"""Linear models of drives: closed forms of loops of first and second order, and the simulated axis itself."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from rig import BALL_SCREW, axis, column, effect, elastic, rigid

from fdbench.effects import Effect
from fdbench.errors import SpecError
from fdbench.motions.schroeder_multisine import SchroederMultisine
from fdbench.motions.standstill import Standstill
from fdbench.plants._controllers import Cascade, OpenLoop, VelocityLoop
from fdbench.plants.feed_drive import FeedDrive, Following, LinearMotor, Screw
from fdbench.plants.servo_stage import ServoStage
from fdbench.scenario import load_scenario
from fdbench.simulate.stability import gain_margin, is_stable
from fdbench.simulate.system import Setup, Timing

PERIOD_S = 1e-3
CASCADE = Cascade(
    position_gain_per_s=60.0,
    velocity_gain_N_s_per_m=1.2e4,
    integral_gain_N_per_m=3e5,
    velocity_feedforward=0.7,
    acceleration_feedforward_kg=20.0,
    force_limit_N=1e9,
    feedback="motor",
    difference_span=1,
)
SLOW = dataclasses.replace(CASCADE, velocity_gain_N_s_per_m=4e3, integral_gain_N_per_m=1e5)
MULTISINE = SchroederMultisine(
    mean_velocity_m_per_s=0.0,
    scale_m_per_s=0.02,
    harmonics=200,
    fundamental_rad_per_s=2.0 * math.pi,
    first_phase_rad=0.3,
)
TACHOMETER = VelocityLoop(gain_N_s_per_m=2e4, force_limit_N=1e9)


def damped(**changes: Any) -> FeedDrive:
    """Return 30 kg and 20 kg on a spring of 10 N/um with 3 % damping, in a cascade."""
    drive = elastic(controller=CASCADE)
    return dataclasses.replace(drive, screw=Screw(stiffness_N_per_m=1e7, damping_N_s_per_m=700.0), **changes)


# ---- closed forms ----


def test_modes_of_two_masses_on_a_spring() -> None:
    """Free: one rigid-body pair, and omega^2 = k (1/m_1 + 1/m_2) with 2 zeta omega = c (1/m_1 + 1/m_2)."""
    modes = damped().linear_system(PERIOD_S).modes()
    omega = math.sqrt(1e7 * (1.0 / 30.0 + 1.0 / 20.0))
    assert modes[-1].frequency_Hz == pytest.approx(omega / (2.0 * math.pi), rel=1e-9)
    assert modes[-1].damping_ratio == pytest.approx(700.0 * (1.0 / 30.0 + 1.0 / 20.0) / (2.0 * omega), rel=1e-9)


def test_second_order_servo_stage() -> None:
    stage: Any = load_scenario("ServoStaircase-v0").plant
    assert isinstance(stage, ServoStage)
    (mode,) = stage.linear_system(PERIOD_S).modes()
    assert mode.frequency_Hz == pytest.approx(math.sqrt(stage.stiffness_N_per_m / stage.mass_kg) / (2.0 * math.pi))
    ratio = stage.damping_N_s_per_m / (2.0 * math.sqrt(stage.stiffness_N_per_m * stage.mass_kg))
    assert mode.damping_ratio == pytest.approx(ratio)


def test_sampled_loop_of_first_order() -> None:
    """L = b / (z - p): unstable from the gain (1 + p) / b on; |L| = 1 at cos theta = (1 + p^2 - b^2) / 2 p."""
    drive = rigid(viscous=100.0, controller=TACHOMETER, effects=())
    p = math.exp(-100.0 / 50.0 * PERIOD_S)
    b = 2e4 / 100.0 * (1.0 - p)
    system = drive.linear_system(PERIOD_S)
    found = system.margins("velocity")
    theta = math.acos((1.0 + p**2 - b**2) / (2.0 * p))
    phase = float(np.angle(b / (np.exp(1j * theta) - p)))
    assert found.stable
    assert found.gain_margin == pytest.approx((1.0 + p) / b, rel=1e-5)
    assert found.crossover_Hz == pytest.approx(theta / (2.0 * math.pi * PERIOD_S), rel=1e-4)
    assert found.phase_margin_rad == pytest.approx(math.pi + phase, rel=1e-4)
    assert found.delay_margin_s == pytest.approx((math.pi + phase) * PERIOD_S / theta, rel=1e-4)


def test_loop_of_second_order_sampled_fast_is_the_continuous_one() -> None:
    """Rigid mass with P-position over P-velocity: s^2 + (K/m) s + (K/m) K_x, here omega = 20 rad/s and zeta = 0.5."""
    slow = dataclasses.replace(
        CASCADE,
        position_gain_per_s=20.0,
        velocity_gain_N_s_per_m=1000.0,
        integral_gain_N_per_m=0.0,
        velocity_feedforward=0.0,
        acceleration_feedforward_kg=0.0,
        difference_span=0,
    )
    system = rigid(controller=slow, effects=()).linear_system(1e-5)
    for mode in system.closed_modes():
        assert mode.frequency_Hz == pytest.approx(20.0 / (2.0 * math.pi), rel=1e-3)
        assert mode.damping_ratio == pytest.approx(0.5, rel=1e-3)
    time_s, answer = system.step("position")
    overshoot = math.exp(-math.pi * 0.5 / math.sqrt(0.75))
    assert answer.max() == pytest.approx(1.0 + overshoot, rel=1e-3)
    assert time_s[answer.argmax()] == pytest.approx(math.pi / (20.0 * math.sqrt(0.75)), rel=2e-3)
    # omega^2 / (s^2 + 2 zeta omega s + omega^2) falls by 3 dB at omega sqrt(1/2 + sqrt(5)/2) for zeta = 1/2.
    bandwidth = 20.0 * math.sqrt(0.5 + math.sqrt(5.0) / 2.0) / (2.0 * math.pi)
    assert system.margins("position").bandwidth_Hz == pytest.approx(bandwidth, rel=1e-2)


@pytest.mark.parametrize("delay_s", [0.0, 0.3e-3, 1e-3, 1.6e-3])
def test_dead_time_of_any_length_is_sampled_exactly(delay_s: float) -> None:
    """A step of force on a free mass: v_k = max(0, k T - t_d) / m."""
    drive = rigid(effects=(effect("dead_time", dead_time_s=delay_s),))
    A, B, C = drive.control_loop(PERIOD_S).plant.sampled(PERIOD_S)
    state, found = np.zeros(len(A)), []
    for _ in range(5):
        found.append(float(C[1] @ state))
        state = A @ state + B
    expected = np.maximum(np.arange(5) * PERIOD_S - delay_s, 0.0) / 50.0
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15)


def test_gain_margin_inside_and_outside() -> None:
    """L = b / (z - p), unstable beyond (1 + p) / b, and for p > 1 below (p - 1) / b too."""
    one = np.array([1.0])
    assert gain_margin(np.array([[0.5]]), np.array([3.0]), one) == pytest.approx(0.5, rel=1e-5)
    assert gain_margin(np.array([[1.5]]), np.array([0.25]), one) == pytest.approx(2.0, rel=1e-5)
    assert gain_margin(np.array([[0.5]]), np.array([0.0]), one) == math.inf
    assert is_stable(np.array([[1.0, 1.0], [0.0, 1.0]]))


# ---- the simulated axis ----

LINEAR: list[tuple[str, FeedDrive, tuple[Effect, ...]]] = [
    ("elastic", damped(), ()),
    ("rigid", rigid(viscous=300.0, controller=CASCADE), ()),
    ("table", damped(controller=dataclasses.replace(CASCADE, feedback="table", velocity_gain_N_s_per_m=4e3)), ()),
    ("tachometer", damped(controller=dataclasses.replace(CASCADE, difference_span=0)), ()),
    ("two samples", damped(controller=dataclasses.replace(CASCADE, difference_span=2)), ()),
    ("velocity filter", damped(controller=dataclasses.replace(CASCADE, velocity_filter_s=0.7e-3)), ()),
    (
        "filtered tachometer",
        damped(controller=dataclasses.replace(SLOW, difference_span=0, velocity_filter_s=2e-3)),
        (),
    ),
    ("two sensors", damped(controller=dataclasses.replace(CASCADE, feedback="table", velocity_feedback="motor")), ()),
    (
        "two sensors, two samples",
        damped(controller=dataclasses.replace(SLOW, velocity_feedback="table", difference_span=2)),
        (),
    ),
    ("dead_time", damped(), (effect("dead_time", dead_time_s=0.7e-3),)),
    ("current_loop_lag", damped(), (effect("current_loop_lag", time_constant_s=0.8e-3, inverter_ratio=0.0),)),
    (
        "inverter",
        damped(controller=SLOW),
        (effect("current_loop_lag", time_constant_s=0.8e-3, inverter_ratio=0.4),),
    ),
    (
        "both",
        damped(controller=SLOW),
        (effect("dead_time", dead_time_s=1.2e-3), effect("current_loop_lag", time_constant_s=0.2e-3)),
    ),
    ("structural_mode", damped(), (effect("structural_mode", moving_mass_kg=8.0, natural_frequency_Hz=45.0),)),
    ("inertia_mismatch", damped(), (effect("inertia_mismatch", extra_mass_kg=15.0),)),
    ("viscous_friction", damped(), (effect("viscous_friction", viscous_friction_N_s_per_m=2000.0),)),
    ("axial_compliance", damped(), (effect("axial_compliance", stiffness_loss_percent=40.0),)),
    ("cable_stiffness", damped(), (effect("cable_stiffness", spring_stiffness_N_per_m=9e4, dahl_force_N=0.0),)),
]


@pytest.mark.parametrize(("drive", "on"), [case[1:] for case in LINEAR], ids=[case[0] for case in LINEAR])
def test_simulated_axis_follows_as_the_linear_model_says(drive: FeedDrive, on: tuple[Effect, ...]) -> None:
    """Tracking at 1 to 200 Hz by a multisine, complex, within 1 % of what the nominal loop predicts."""
    made = axis(drive, *on, motion=MULTISINE, duration_s=6.0)
    rows = made.advance(made.n_samples)[-1000:]
    command = np.fft.rfft(column(made, rows, "reference_position_m"))[1:201]
    found = np.fft.rfft(column(made, rows, "position_m"))[1:201] / command
    # The mechanics under test have no nominal friction; what the rig's axes know of it is switched off in both.
    expected = dataclasses.replace(drive, effects=on).linear_system(PERIOD_S).tracking(np.arange(1.0, 201.0))
    assert expected is not None
    np.testing.assert_array_less(np.abs(found - expected), 0.01 * np.abs(expected))


def test_gain_that_is_named_is_where_the_simulated_loop_turns_unstable() -> None:
    """Noise of 1 nm stays small 3 % below the gain margin and reaches the limit of the axis 3 % above."""
    drive = damped(effects=())
    margin = gain_margin(*drive.control_loop(PERIOD_S).broken_at_force())
    assert 1.0 < margin < 100.0

    def scaled(gain: float) -> FeedDrive:
        loop = dataclasses.replace(
            CASCADE,
            velocity_gain_N_s_per_m=gain * CASCADE.velocity_gain_N_s_per_m,
            integral_gain_N_per_m=gain * CASCADE.integral_gain_N_per_m,
        )
        return dataclasses.replace(drive, controller=loop)

    setup = Setup(timing=Timing(sampling_time_s=PERIOD_S, duration_s=1.0, substeps=10), motion=Standstill())
    assert scaled(0.97 * margin).system(setup).n_samples == 1000
    with pytest.raises(
        SpecError, match=r"plant\.controller: the loop is unstable at a sampling time of 1 ms: spectral"
    ):
        scaled(1.03 * margin).system(setup)
    A, B, C = scaled(1.03 * margin).control_loop(PERIOD_S).broken_at_force()
    state = np.full(len(A), 1e-9)
    for _ in range(5000):
        state = (A - np.outer(B, C)) @ state
    assert np.abs(state).max() > 1.0


@pytest.mark.parametrize("cycles", [2, 5])
def test_a_slower_position_loop_is_the_velocity_loop_around_which_it_acts(cycles: int) -> None:
    """Positions at its own cycles, under a multisine, as the recursion from one to the next has them."""
    loop = dataclasses.replace(CASCADE, velocity_feedforward=0.0, acceleration_feedforward_kg=0.0)
    drive = damped(controller=dataclasses.replace(loop, position_loop_cycles=cycles), effects=())
    made = axis(drive, motion=MULTISINE, duration_s=1.0)
    rows = made.advance(made.n_samples)
    found, wanted = (column(made, rows, name)[::cycles] for name in ("position_m", "reference_position_m"))
    A, B, c = drive.control_loop(PERIOD_S).broken_at_velocity()
    state, expected = np.zeros(len(A)), np.empty(len(found))
    for place in range(len(found)):
        expected[place] = state[0]
        state = A @ state + B * (CASCADE.position_gain_per_s * (wanted[place] - wanted[0]) - c @ state)
    np.testing.assert_allclose(found - found[0], expected, atol=1e-3 * np.ptp(expected))
    with pytest.raises(SpecError, match="position_loop_cycles"):
        drive.linear_system(PERIOD_S)


def test_a_slower_position_loop_is_refused_where_it_is_unstable() -> None:
    cascade = dataclasses.replace(CASCADE, position_gain_per_s=180.0)
    damped(controller=cascade).check_loop(PERIOD_S)
    with pytest.raises(SpecError, match=r"plant\.controller: the loop is unstable at a sampling time of 20 ms"):
        damped(controller=dataclasses.replace(cascade, position_loop_cycles=20)).check_loop(PERIOD_S)


def test_an_unknown_side_of_the_velocity_is_refused() -> None:
    with pytest.raises(SpecError, match="velocity_feedback: unknown side 'tabel'"):
        dataclasses.replace(CASCADE, velocity_feedback="tabel")


def test_an_unstable_loop_is_refused_by_how_much() -> None:
    loop = dataclasses.replace(BALL_SCREW.controller, velocity_gain_N_s_per_m=4e5, integral_gain_N_per_m=0.0)
    drive = dataclasses.replace(BALL_SCREW, controller=loop)
    with pytest.raises(SpecError) as refused:
        drive.system(load_scenario("BallScrewAxis-v0").setup)
    words = str(refused.value)
    assert "spectral radius" in words
    assert "of a pole at" in words
    factor = float(words.split("With all gains times ")[1].split(" ")[0])
    fitting = dataclasses.replace(loop, velocity_gain_N_s_per_m=0.999 * factor * 4e5)
    dataclasses.replace(drive, controller=fitting).system(load_scenario("BallScrewAxis-v0").setup)
    beyond = dataclasses.replace(loop, velocity_gain_N_s_per_m=1.005 * factor * 4e5)
    with pytest.raises(SpecError, match="just stable"):
        dataclasses.replace(drive, controller=beyond).system(load_scenario("BallScrewAxis-v0").setup)


def test_without_feedback_there_is_no_loop() -> None:
    free = rigid(controller=OpenLoop(acceleration_feedforward_kg=1.0, force_limit_N=1.0)).linear_system(PERIOD_S)
    assert (dict(free.loops), free.closed, free.tracking(np.ones(1)), free.closed_modes()) == ({}, None, None, [])
    unknown = rigid(controller=Following(), motor=LinearMotor(mass_kg=9.0, viscous_friction_N_s_per_m=0.0))
    assert dict(unknown.linear_system(PERIOD_S).loops) == {}
