"""The integrator against a slow twin, closed forms and conservation laws."""

import dataclasses

import numpy as np
import pytest
from naive import TwoMassAxis
from rig import BALL_SCREW, LIBRARY, MASS_KG, axis, column, effect, elastic, push, rigid, switch

from fdbench.errors import SimulationDiverged, SpecError
from fdbench.motions.jerk_limited_moves import JerkLimitedMoves
from fdbench.plants._controllers import Cascade
from fdbench.plants.feed_drive import Table
from fdbench.scenario import load_scenario
from fdbench.simulate.axis import Axis

CASCADE = Cascade(
    position_gain_per_s=40.0,
    velocity_gain_N_s_per_m=2e4,
    integral_gain_N_per_m=2e5,
    velocity_feedforward=1.0,
    acceleration_feedforward_kg=0.0,
    force_limit_N=6000.0,
    difference_span=0,
)
DRIVE = dataclasses.replace(BALL_SCREW, controller=CASCADE)
LUGRE = effect("lugre_friction")
SLOW, FAST = 0.06, 0.6


def moves(velocity: float) -> JerkLimitedMoves:
    stops = (0.0, 0.01, 0.002, 0.003) if velocity < 0.1 else (0.0, 0.12, 0.05, 0.07)
    return JerkLimitedMoves(
        stops_m=stops, velocity_m_per_s=velocity, acceleration_m_per_s2=5.0, jerk_m_per_s3=200.0, dwell_s=0.03
    )


def twin() -> TwoMassAxis:
    motor, table, screw = DRIVE.motor, DRIVE.table, DRIVE.screw
    assert table is not None
    assert screw is not None
    return TwoMassAxis(
        motor_mass=3e-4 * (2.0 * np.pi / 0.01) ** 2,
        table_mass=table.mass_kg,
        motor_viscous=motor.viscous_friction_N_s_per_m,
        table_viscous=table.viscous_friction_N_s_per_m,
        stiffness=screw.stiffness_N_per_m,
        damping=screw.damping_N_s_per_m,
        coulomb=120.0,
        static=150.0,
        stribeck_velocity=3e-3,
        bristle_stiffness=2e7,
        bristle_damping=1e4,
        constant=15.0,
        position_gain=40.0,
        velocity_gain=2e4,
        integral_gain=2e5,
        velocity_feedforward=1.0,
        force_limit=6000.0,
    )


@pytest.mark.parametrize("velocity", [SLOW, FAST])
def test_second_order_against_the_slow_twin(velocity: float) -> None:
    errors = {}
    for substeps in (10, 20, 40):
        made = axis(
            DRIVE,
            LUGRE,
            effect("constant_force", constant_force_N=15.0),
            motion=moves(velocity),
            duration_s=0.9,
            substeps=substeps,
        )
        rows = made.advance(made.n_samples)
        if not errors:
            oracle = twin().run(made.reference, 1e-3, 1e-6)
        position = column(made, rows, "motor_position_m") - oracle[:, 0]
        table = column(made, rows, "table_position_m") - oracle[:, 1]
        force = column(made, rows, "motor_torque_Nm") * 2.0 * np.pi / 0.01 - oracle[:, 2]
        errors[substeps] = [np.sqrt(np.mean(item**2)) for item in (position, table, force)]
        if substeps == 10:  # 0.1 ms
            assert max(np.abs(position).max(), np.abs(table).max()) < 50e-9
            assert np.abs(force).max() < 0.5
    assert np.abs(oracle[:, 0]).max() > 0.009  # it has moved
    orders = np.log2(np.array(errors[10]) / np.array(errors[40])) / 2.0
    assert orders.min() > 1.8, orders


def test_free_deceleration_under_viscous_and_coulomb_friction() -> None:
    B, F_c = 100.0, 40.0
    made = axis(rigid(viscous=B), effect("coulomb_friction", coulomb_force_N=F_c), duration_s=3.0)
    push(made, np.full(200, 300.0))
    v = column(made, push(made, np.zeros(800)), "velocity_m_per_s")
    t = np.arange(len(v)) * 1e-3
    closed = (v[0] + F_c / B) * np.exp(-B * t / MASS_KG) - F_c / B
    moving = closed > 0.01
    assert v[0] > 0.5
    assert not moving[-1]
    assert np.abs(v - closed)[moving].max() < 1e-7
    stop_s = MASS_KG / B * np.log1p(B * v[0] / F_c)
    assert np.abs(v[t > stop_s + 0.02]).max() < 1e-5


def test_energy_is_kept_without_damping() -> None:
    made = axis(elastic(), duration_s=2.0)
    push(made, np.array([1000.0]))
    rows = push(made, np.zeros(1500))
    x_m, x_t, v_m = (column(made, rows, name) for name in ("motor_position_m", "table_position_m", "velocity_m_per_s"))
    v_t = (1.0 - 30.0 * v_m) / 20.0  # 1000 N over 1 ms are 1 N s
    energy = 0.5 * (30.0 * v_m**2 + 20.0 * v_t**2 + 1e6 * (x_m - x_t) ** 2)
    assert np.ptp(x_m - x_t) > 1e-4
    assert np.ptp(energy) < 1e-9 * energy[0]


def test_energy_is_kept_in_a_potential() -> None:
    A, pitch = 200.0, 0.02
    made = axis(rigid(), effect("cogging", cogging_force_N=A, pitch_m=pitch), duration_s=5.0)
    push(made, np.full(20, 100.0))
    rows = push(made, np.zeros(4000))
    x, v = column(made, rows, "motor_position_m"), column(made, rows, "velocity_m_per_s")
    potential = -A * pitch / (2.0 * np.pi) * np.cos(2.0 * np.pi * x / pitch)
    energy = 0.5 * MASS_KG * v**2 + potential
    assert np.ptp(potential) > 0.01
    assert np.ptp(energy) < 1e-4 * np.ptp(potential)


@pytest.mark.parametrize("substeps", [10, 20])
def test_an_added_mass_is_a_heavier_table(substeps: int) -> None:
    assert DRIVE.table is not None
    heavier = dataclasses.replace(DRIVE, table=dataclasses.replace(DRIVE.table, mass_kg=DRIVE.table.mass_kg + 12.0))
    made = axis(DRIVE, LUGRE, motion=moves(0.2), duration_s=0.5, substeps=substeps, n_lanes=2)
    switch(made, effect("inertia_mismatch", extra_mass_kg=12.0), lanes=np.array([0]))
    made.set_mechanics([heavier.mechanics()], np.array([1]))
    made.start([0, 0])
    rows = made.advance(made.n_samples)
    plain = axis(DRIVE, LUGRE, motion=moves(0.2), duration_s=0.5, substeps=substeps).advance(500)
    gap = np.abs(rows[:, :, 0] - rows[:, :, 1]).max(axis=0)
    effect_size = np.abs(rows[:, :, 1] - plain[:, :, 0]).max(axis=0)
    table = made.columns.index("table_position_m")
    assert effect_size[table] > 1e-5
    assert gap[table] < 1e-9 * (10.0 / substeps) ** 1.5


def test_an_added_mass_on_a_rigid_axis_is_exact() -> None:
    forces = np.random.default_rng(1).uniform(-500.0, 500.0, 200)
    light = axis(rigid(), effect("inertia_mismatch", extra_mass_kg=25.0))
    heavy = axis(rigid(motor=dataclasses.replace(rigid().motor, mass_kg=MASS_KG + 25.0)))
    a, b = (column(made, push(made, forces), "velocity_m_per_s") for made in (light, heavy))
    assert np.abs(b).max() > 0.01
    assert np.abs(a - b).max() < 1e-12


def test_lost_stiffness_is_a_softer_screw() -> None:
    assert DRIVE.screw is not None
    softer = dataclasses.replace(
        DRIVE.screw,
        stiffness_N_per_m=0.75 * DRIVE.screw.stiffness_N_per_m,
        damping_N_s_per_m=0.75 * DRIVE.screw.damping_N_s_per_m,
    )
    made = axis(DRIVE, LUGRE, motion=moves(0.2), duration_s=0.5, n_lanes=3)
    switch(made, effect("axial_compliance", stiffness_loss_percent=25.0), lanes=np.array([0]))
    made.set_mechanics([dataclasses.replace(DRIVE, screw=softer).mechanics()], np.array([1]))
    made.start([0, 0, 0])
    rows = made.advance(made.n_samples)
    table = made.columns.index("table_position_m")
    assert np.abs(rows[:, table, 1] - rows[:, table, 2]).max() > 1e-6
    assert np.abs(rows[:, table, 0] - rows[:, table, 1]).max() < 20e-9


def test_an_axis_driven_out_of_its_travel_has_diverged() -> None:
    scenario = load_scenario("BallScrewAxis-v0")
    timing = dataclasses.replace(scenario.setup.timing, duration_s=2.0)
    short = dataclasses.replace(
        scenario,
        plant=dataclasses.replace(scenario.plant, travel_m=0.01),
        timing=timing,  # type: ignore[type-var]
    )
    with pytest.raises(SimulationDiverged, match="left its travel"):
        short.observe(0)
    assert np.isfinite(dataclasses.replace(scenario, timing=timing).observe(0)[0]["motor_position_m"]).all()


def test_numbers_that_are_none_are_flagged() -> None:
    """Twenty changes of the command within a dead time of 2 ms are more than the effect can keep."""
    made = axis(rigid(), effect("dead_time", dead_time_s=2e-3), duration_s=0.01, sampling_time_s=1e-4)
    push(made, np.arange(1.0, 40.0))
    assert made.diverged.all()


def test_lanes_have_parameters_and_mechanics_of_their_own() -> None:
    """Each of 70 lanes equals an axis of its own, also after a restart."""
    rng = np.random.default_rng(3)
    made = axis(DRIVE, LUGRE, motion=moves(0.2), duration_s=0.2, n_lanes=70)
    forces = rng.uniform(1.0, 30.0, 70)
    tables = [Table(mass_kg=mass, viscous_friction_N_s_per_m=200.0) for mass in rng.uniform(50.0, 70.0, 70)]
    number = len(made.effects) - len(LIBRARY) + LIBRARY.index(type(effect("constant_force")))
    made.set_parameters(number, forces[None, :])
    made.enable(number, np.arange(70) % 3 == 0)
    made.set_mechanics([dataclasses.replace(DRIVE, table=table).mechanics() for table in tables])
    for _ in range(2):
        made.start(range(70))
        rows = made.advance(made.n_samples)
    for lane in (0, 1, 66, 69):
        on = [effect("constant_force", constant_force_N=forces[lane])] if lane % 3 == 0 else []
        drive = dataclasses.replace(DRIVE, table=tables[lane])
        alone = axis(drive, LUGRE, *on, motion=moves(0.2), duration_s=0.2)
        assert np.array_equal(alone.advance(alone.n_samples)[:, :, 0], rows[:, :, lane])


def test_lane_settings_are_checked() -> None:
    made = axis(DRIVE)
    with pytest.raises(SpecError, match=r"axial_compliance\.stiffness_loss_percent: 99 is outside \[-50, 80\] %"):
        made.set_parameters(len(made.effects) - len(LIBRARY), np.array([99.0]))
    with pytest.raises(SpecError, match="an elastic axis is expected in every lane"):
        made.set_mechanics([rigid().mechanics()])


def test_a_whole_number_that_lanes_no_longer_share_is_their_own() -> None:
    scenario = load_scenario("MillingIncreasing-v0")
    several, single = scenario.system(70), scenario.system(1)
    assert isinstance(several, Axis)
    assert isinstance(single, Axis)
    number = [effect.name for effect in several.effects].index("tooth_passing_force")
    values = several.effects[number].changed(teeth=5.0).values()
    several.start(list(range(70)))
    several.advance(900)
    several.set_parameters(number, np.array(values)[:, None], np.array([66]))
    found = several.advance(100)
    for lane in (65, 66):
        single.set_parameters(number, np.array(single.effects[number].values()))
        single.start([lane])
        single.advance(900)
        if lane == 66:
            single.set_parameters(number, np.array(values))
        np.testing.assert_array_equal(found[:, :, lane], single.advance(100)[:, :, 0])
    assert np.ptp(found[:, -3, 65]) != np.ptp(found[:, -3, 66])
