"""Spindle, sensor network and current-driven feed drive: closed forms, naive twins, lanes, published figures."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fdbench.effects import effects
from fdbench.errors import SpecError
from fdbench.plants import NetworkPlant, StateSpacePlant
from fdbench.plants._spindle_modal import ComplianceMode
from fdbench.plants.spindle import Spindle
from fdbench.record import FloatArray
from fdbench.reproduce import salehi
from fdbench.reproduce._row import Row
from fdbench.scenario import Scenario, load_scenario
from fdbench.simulate.system import Noise

SPINDLES = ("SpindleStep-v0", "SpindleMilling-v0", "SensorNetwork-v0")
FREQUENCIES_HZ, DAMPING, GAINS = (753.0, 965.0, 1168.0), (0.0297, 0.0288, 0.0303), (25.756, 130.369, 6.284)
STATIC = 4.81346e-6


def with_timing(name: str, **changes: Any) -> Scenario:
    scenario = load_scenario(name)
    assert scenario.timing is not None
    return replace(scenario, timing=replace(scenario.timing, **changes))


def quiet(scenario: Scenario) -> Scenario:
    return replace(scenario, reality=replace(scenario.reality, noise=Noise()))


def with_effect(scenario: Scenario, name: str, **parameters: float) -> Scenario:
    effect = effects.get(name).typical(**parameters)
    return replace(scenario, reality=replace(scenario.reality, effects=(effect,)))


def spindle() -> Spindle:
    plant = load_scenario("SpindleStep-v0").plant
    assert isinstance(plant, Spindle)
    return plant


# ---- the nominal spindle ----


def test_static_compliance() -> None:
    assert spindle().static_compliance_m_per_N == pytest.approx(STATIC, rel=1e-5)


def test_state_space_is_the_sum_of_the_modes() -> None:
    space = spindle().state_space(1e-4)
    for frequency in (0.0, 50.0, 753.0, 900.0, 5000.0):
        s = 2j * np.pi * frequency
        expected = sum(
            gain / (s**2 + 2 * zeta * 2 * np.pi * f * s + (2 * np.pi * f) ** 2)
            for f, zeta, gain in zip(FREQUENCIES_HZ, DAMPING, GAINS, strict=True)
        )
        found = space.C[0] @ np.linalg.solve(s * np.eye(6) - space.A, space.E)
        assert found == pytest.approx(expected, rel=1e-11)


def test_the_plants_are_known_by_their_protocols() -> None:
    assert isinstance(spindle(), StateSpacePlant)
    assert not isinstance(spindle(), NetworkPlant)
    assert isinstance(load_scenario("SensorNetwork-v0").plant, NetworkPlant)


def test_regression_has_readings_and_no_regressors() -> None:
    scenario = load_scenario("DriveCurrentClosed-v0")
    record = scenario.record(0)
    regression = scenario.context().regression(record)
    assert regression.regressors.shape == (record.n_samples - 1, 0)
    assert regression.readings is not None
    columns = (record["motor_current_A"][:-1], record["velocity_m_per_s"][1:], record["motor_position_m"][1:])
    np.testing.assert_array_equal(regression.readings, np.column_stack(columns))
    np.testing.assert_array_equal(regression.target, record["velocity_m_per_s"][1:])
    # A newton for 1 ms slows J (2 pi / lead)^2 = 3947.8 kg by this.
    assert regression.disturbance_gain == pytest.approx(-1e-3 / (0.01 * (2 * np.pi / 0.01) ** 2), rel=1e-12)

    scenario = load_scenario("SpindleStep-v0")
    record = scenario.record(0)
    regression = scenario.context().regression(record)
    assert regression.readings is not None
    np.testing.assert_array_equal(regression.readings[:, 0], record["displacement_m"][1:])
    assert regression.disturbance_gain == pytest.approx(STATIC, rel=1e-5)
    assert (regression.names, dict(scenario.linear_model.nominal_parameters(1e-4))) == ((), {})


# ---- the spindle as it is simulated ----


def step_displacement(time_s: FloatArray) -> FloatArray:
    """Return the closed form of the displacement under one newton from time zero on."""
    total = np.zeros(len(time_s))
    for f, zeta, gain in zip(FREQUENCIES_HZ, DAMPING, GAINS, strict=True):
        w = 2 * np.pi * f
        root = np.sqrt(1 - zeta**2)
        swing = np.cos(w * root * time_s) + zeta / root * np.sin(w * root * time_s)
        total += gain / w**2 * (1 - np.exp(-zeta * w * time_s) * swing) * (time_s > 0)
    return total


@pytest.mark.parametrize("substeps", [1, 7, 10])
def test_step_has_its_closed_form(substeps: int) -> None:
    scenario = quiet(with_timing("SpindleStep-v0", substeps=substeps))
    record, truth = scenario.observe(0)
    expected = 100.0 * step_displacement(np.maximum(record["time_s"] - 0.1, 0.0))
    np.testing.assert_allclose(record["displacement_m"], expected, rtol=0, atol=1e-12)
    assert truth.disturbance_N is not None
    # The time of a substep is rounded to 1e-17 s, so its share of the step to 1e-12.
    np.testing.assert_allclose(truth.disturbance_N, 100.0 * (np.arange(3000) >= 1000), rtol=0, atol=1e-9)


def cutting_forces(time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Fx and Fy of five teeth, 90 to 180 degrees, in mm and MPa as in the thesis."""
    along, across = np.zeros(len(time_s)), np.zeros(len(time_s))
    for tooth in range(5):
        phi = 2 * np.pi * ((650.0 / 60.0 * time_s + tooth / 5) % 1.0)
        chip = 0.25 * np.sin(phi)
        tangential = (2598.0 * chip + 9.0) * 0.2
        radial = (1309.0 * chip + 5.0) * 0.2
        engaged = (phi > np.pi / 2) & (phi < np.pi)
        along += engaged * (-tangential * np.cos(phi) - radial * np.sin(phi))
        across += engaged * (tangential * np.sin(phi) - radial * np.cos(phi))
    return along, across


@pytest.mark.parametrize("axis", [0, 1])
def test_milling_force_is_that_of_the_thesis(axis: int) -> None:
    scenario = with_timing("SpindleMilling-v0", sampling_time_s=1e-5, substeps=1)
    scenario = salehi.across_the_feed(scenario) if axis else scenario
    record, truth = scenario.observe(0)
    cutting = record["feedrate_m_per_s"] > 0.25e-3 * 5 * 650.0 / 60.0 * (1 - 1e-12)
    assert cutting.sum() > 40000
    expected = cutting_forces(record["time_s"] + 0.5e-5)[axis]
    assert truth.disturbance_N is not None
    np.testing.assert_allclose(truth.disturbance_N[cutting], expected[cutting], rtol=0, atol=1e-9)


def test_milling_equals_a_naive_twin() -> None:
    scenario = quiet(with_timing("SpindleMilling-v0", duration_s=0.05))
    from scipy.linalg import expm

    space = spindle().state_space(1e-4)
    flow = expm(np.block([[space.A, space.E[:, None]], [np.zeros((1, 7))]]) * 1e-5)
    motion = scenario.setup.motion.reference(1e-4, 500)
    effect = scenario.reality.effects[0]
    state, expected, forces = np.zeros(6), [], []
    for k in range(500):
        expected.append(space.C[0] @ state)
        for step in range(10):
            time_s = k * 1e-4 + (step + 0.5) * 1e-5
            forces.append(type(effect).kernel(time_s, 1e-5, motion[k, 0], motion[k, 1], 0.0, *effect.values())[0])
            state = flow[:6, :6] @ state + flow[:6, 6] * forces[-1]
    record, truth = scenario.observe(0)
    np.testing.assert_allclose(record["displacement_m"], expected, rtol=0, atol=1e-15)
    assert truth.disturbance_N is not None
    np.testing.assert_allclose(truth.disturbance_N, np.reshape(forces, (500, 10)).mean(axis=1), rtol=0, atol=1e-11)


def test_step_force_acts_over_its_part_of_a_substep() -> None:
    scenario = with_effect(with_timing("SpindleStep-v0", substeps=1), "step_force", start_s=0.01003)
    truth = scenario.observe(0)[1].disturbance_N
    assert truth is not None
    np.testing.assert_allclose(truth[99:102], [0.0, 70.0, 100.0], rtol=0, atol=1e-9)


def test_noise_is_that_of_the_scenario_and_no_part_of_the_motion() -> None:
    scenario = load_scenario("SpindleStep-v0")
    noisy, exact = scenario.record(4)["displacement_m"], quiet(scenario).record(4)["displacement_m"]
    noise = noisy - exact
    assert noise.std() == pytest.approx(0.1 * STATIC, rel=0.05)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.06
    np.testing.assert_array_equal(scenario.record(4)["displacement_m"], noisy)
    assert not np.array_equal(scenario.record(5)["displacement_m"], noisy)


@pytest.mark.parametrize("name", SPINDLES)
def test_a_lane_has_the_bits_of_a_single_one(name: str) -> None:
    scenario = load_scenario(name)
    scale = scenario.environment.action_scale if scenario.environment else 0.0
    together = scenario.system(5)
    together.start([11, 12, 13, 14, 15])
    together.advance(200)
    together.start([77], np.array([2]))
    pieces = [together.advance(n, scale * np.linspace(-1, 1, 5)) for n in (1, 299, 60, 1)]
    for lane, (seed, before) in {0: (11, 200), 2: (77, 0), 4: (15, 200)}.items():
        alone = scenario.system()
        alone.start([seed])
        if before:
            alone.advance(before)
        found = alone.advance(361, scale * np.linspace(-1, 1, 5)[lane : lane + 1])
        np.testing.assert_array_equal(found[:, :, 0], np.concatenate(pieces)[:, :, lane])


def test_split_advances_give_the_same_bits() -> None:
    system = load_scenario("SensorNetwork-v0").system(2)
    system.start([1, 2])
    whole = system.advance(1000)
    system.start([1, 2])
    pieces = [system.advance(n) for n in (1, 255, 256, 1, 300, 187)]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_actions_are_force_or_feed() -> None:
    scenario = quiet(load_scenario("SpindleStep-v0"))
    system = scenario.system(2)
    assert system.action_names == ("force_N",)
    system.start([0, 0])
    rows = system.advance(900, np.array([0.0, 20.0]))
    columns = (*system.columns, *system.truth_columns)
    np.testing.assert_array_equal(rows[:, columns.index("disturbance_N"), 1], 20.0)
    settled = rows[-1, columns.index("displacement_m")]
    np.testing.assert_allclose(settled, [0.0, 20.0 * STATIC], rtol=1e-4, atol=1e-12)

    system = load_scenario("SpindleMilling-v0").system(2)
    assert system.action_names == ("feedrate_m_per_s",)
    system.start([0, 0])
    rows = system.advance(500, np.array([0.0, 0.005]))
    columns = (*system.columns, *system.truth_columns)
    np.testing.assert_allclose(np.ptp(rows[:, columns.index("feedrate_m_per_s")], axis=1), 0.005, rtol=1e-12)
    force = rows[200:, columns.index("disturbance_N")]
    assert force[:, 1].std() > 1.2 * force[:, 0].std()


def test_leaving_the_limits_is_told() -> None:
    system = load_scenario("SpindleStep-v0").system(2)
    system.start([0, 0])
    rows = system.advance(100, np.array([0.0, 2000.0]))
    np.testing.assert_array_equal(system.diverged, [False, True])
    flag = rows[:, len(system.columns) + system.truth_columns.index("diverged")]
    assert (flag[0, 1], flag[-1, 1], flag[-1, 0]) == (0.0, 1.0, 0.0)
    system = load_scenario("SpindleMilling-v0").system(2)
    system.start([0, 0])
    system.advance(1, np.array([0.0, -0.06]))
    np.testing.assert_array_equal(system.diverged, [False, True])
    system.start([3], np.array([1]))
    assert not system.diverged.any()


def test_an_adaptive_control_has_a_reference() -> None:
    record = load_scenario("SpindleMilling-v0").record(0)
    np.testing.assert_allclose(record["reference_displacement_m"], 11.5 * STATIC, rtol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: with_effect(s, "lugre_friction"), "lugre_friction acts on .* with internal states"),
        (lambda s: with_effect(s, "encoder_quantisation"), "encoder_quantisation acts on a feed drive's motor_encoder"),
        (lambda s: replace(s, reality=replace(s.reality, noise=Noise(velocity_m_per_s=1.0))), "noise.velocity_m_per_s"),
    ],
)
def test_what_a_spindle_has_not_is_refused(change: Callable[[Scenario], Scenario], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        change(load_scenario("SpindleStep-v0")).observe(0)


def test_faulty_plants_are_refused() -> None:
    plant, mode = spindle(), ComplianceMode(frequency_Hz=100.0, damping_ratio=0.1, modal_gain_per_kg=1.0)
    with pytest.raises(SpecError, match=r"action: unknown action 'force'\. Did you mean force_N"):
        replace(plant, action="force")
    with pytest.raises(SpecError, match="at least one mode"):
        replace(plant, modes=())
    with pytest.raises(SpecError, match="damping_ratio"):
        replace(mode, damping_ratio=1.2)
    network: Any = load_scenario("SensorNetwork-v0").plant
    with pytest.raises(SpecError, match=r"links: unknown node 'displacement'\. Did you mean displacement_m"):
        replace(network, links=(("displacement", "motor_position_m"),))
    for other in (plant, network):
        with pytest.raises(SpecError, match="Did you mean state_space"):
            other.linear_model("state_spac")
    system = plant.system(load_scenario("SpindleStep-v0").setup)
    with pytest.raises(SpecError, match="seeds: 1 are expected"):
        system.start([1, 2])
    system.start([1])
    with pytest.raises(SpecError, match="ends after 3000 samples"):
        system.advance(3001)


# ---- the sensor network ----


def test_links_are_the_graph() -> None:
    full, line = (load_scenario(f"SensorNetwork{kind}-v0").plant for kind in ("", "Line"))
    assert isinstance(full, NetworkPlant)
    assert isinstance(line, NetworkPlant)
    assert full.neighbours().all()
    np.testing.assert_array_equal(line.neighbours(), [[1, 1, 0], [1, 1, 1], [0, 1, 1]])


def test_drive_of_the_network_has_its_closed_form() -> None:
    scenario = with_effect(quiet(load_scenario("SensorNetwork-v0")), "step_force", start_s=0.0)
    record = scenario.record(0)
    mass = 0.01 * (2 * np.pi / 0.01) ** 2
    time_s = record["time_s"]
    velocity = -100.0 / (2.0 * mass) * (1.0 - np.exp(-2.0 * time_s))
    position = -100.0 / (2.0 * mass) * (time_s - (1.0 - np.exp(-2.0 * time_s)) / 2.0)
    # 80 000 substeps, each rounded.
    np.testing.assert_allclose(record["motor_velocity_m_per_s"], velocity, rtol=0, atol=1e-13)
    np.testing.assert_allclose(record["motor_position_m"], position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(record["displacement_m"], 100.0 * step_displacement(time_s), rtol=0, atol=1e-12)


# ---- the drive with current input ----


def test_current_balances_the_force() -> None:
    record = quiet(load_scenario("DriveCurrentClosed-v0")).record(0)
    assert "motor_torque_Nm" not in record
    # F lead / (2 pi) / k_t; the integral part of the controller settles with about 50 ms.
    assert record["motor_current_A"][-1] == pytest.approx(100.0 * 0.01 / (2 * np.pi), rel=1e-6)
    assert record["motor_position_m"][-1] == pytest.approx(0.0, abs=1e-12)


def test_drive_of_the_thesis_equals_a_naive_twin() -> None:
    """Rotary values and a controller in amperes, as the digest states them."""
    record = quiet(load_scenario("DriveCurrentClosed-v0")).record(0)
    inertia, arm, period = 0.01, 0.01 / (2 * np.pi), 1e-3
    speed = angle = integral = 0.0
    currents, speeds = [], []
    for k in range(700):
        error = 40.0 * (0.0 - angle) - speed
        current = 1.5 * error + 30.0 * integral
        integral += error * period
        currents.append(current)
        speeds.append(speed)
        acceleration = (current - arm * 100.0 * (k >= 500)) / inertia
        angle += period * (speed + 0.5 * period * acceleration)
        speed += period * acceleration
    # The axis extrapolates forces to the middle of a substep, so a step is felt half a substep late or early.
    np.testing.assert_allclose(record["motor_current_A"][:700], currents, rtol=0, atol=2e-3)
    np.testing.assert_allclose(record["velocity_m_per_s"][:700] / arm, speeds, rtol=0, atol=1e-3)


def test_noise_of_the_current_is_in_its_reading_only() -> None:
    scenario = load_scenario("DriveCurrentClosed-v0")
    noise = scenario.reality.noise
    without = replace(scenario, reality=replace(scenario.reality, noise=replace(noise, motor_current_A=0.0)))
    noisy, exact = scenario.record(3), without.record(3)
    for name in ("velocity_m_per_s", "motor_position_m"):
        np.testing.assert_array_equal(noisy[name], exact[name])
    error = noisy["motor_current_A"] - exact["motor_current_A"]
    assert error.std() == pytest.approx(0.01, rel=0.05)


def test_current_of_a_motor_without_torque_constant_is_refused() -> None:
    scenario = load_scenario("DriveCurrentClosed-v0")
    plant: Any = scenario.plant
    motor = replace(plant.motor, torque_constant_Nm_per_A=None)
    with pytest.raises(SpecError, match="current_noise_A: the motor logs no current"):
        replace(plant, motor=motor)
    torque = replace(plant, motor=motor, sensors=None)
    assert "state_space" not in torque.models()
    with pytest.raises(SpecError, match=r"noise\.motor_current_A: this feed drive has no such reading"):
        torque.system(scenario.setup)
    with pytest.raises(SpecError, match="sensors: missing table"):
        torque.state_space(1e-3)
    assert torque.mass_kg == plant.mass_kg


def test_elastic_drive_is_offered_to_observers_too() -> None:
    plant: Any = load_scenario("BallScrewAxis-v0").plant
    sensors: Any = load_scenario("DriveCurrentClosed-v0").plant
    space = replace(plant, sensors=replace(sensors.sensors, current_noise_A=0.0)).state_space(1e-3)
    assert space.A.shape == (4, 4)
    assert space.inputs == ("motor_torque_Nm",)
    # A constant force on both sides moves both masses alike: torque in one newton metre, force against it.
    total = plant.motor.mass_kg + plant.table.mass_kg
    weights = np.array([0.0, plant.motor.mass_kg, 0.0, plant.table.mass_kg]) / total
    assert weights @ space.B[:, 0] == pytest.approx(2 * np.pi / 0.01 / total, rel=1e-12)
    assert weights @ space.E == pytest.approx(-1.0 / total, rel=1e-12)


# ---- the published figures ----

PARTS = salehi.parts()


@pytest.mark.linear_algebra
@pytest.mark.parametrize("part", PARTS.values(), ids=PARTS)
def test_figures_of_salehi(part: Callable[[], Iterable[Row]]) -> None:
    rows = list(part())
    assert rows
    assert [f"{row.item}: {row.value:.6g}, not {row.target:g} +- {row.tolerance:g}" for row in rows if not row.ok] == []


def test_every_part_is_reported() -> None:
    items = [row.item for row in salehi.not_reproducible()]
    assert {row.kind for row in salehi.not_reproducible()} == {"not reproducible"}
    assert len(items) == len(set(items))
