"""Servo stages, the physics model and the hybrid model: Chou, Duan, Okwudire."""

import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest
from conftest import shared_file
from fdbench_baselines._recursive_least_squares import free_run, predict, rls, solve, untrained
from fdbench_baselines.hybrid_rls import HybridRLS
from fdbench_baselines.null import Null
from fdbench_baselines.physics_model import PhysicsModel

from fdbench import reproduce
from fdbench.effects import Effect, effects
from fdbench.errors import PluginError, SpecError
from fdbench.estimator import FloatArray, samples
from fdbench.motions.circular_spiral import CircularSpiral
from fdbench.motions.jerk_limited_moves import JerkLimitedMoves, move_time
from fdbench.plants.servo_stage import ServoStage
from fdbench.plants.xy_stage import XYStage
from fdbench.record import Record
from fdbench.reproduce import chou
from fdbench.scenario import Scenario, load_scenario
from fdbench.simulate.system import Noise, Setup

STAIRCASE, SPIRAL = load_scenario("ServoStaircase-v0"), load_scenario("ServoSpiral-v0")
SILENT = chou.changed(STAIRCASE, noisy=False)


def effect(name: str, **changes: float) -> Effect:
    return effects.get(name).typical(**changes)


def with_timing(scenario: Scenario, **changes: Any) -> Scenario:
    return dataclasses.replace(scenario, timing=dataclasses.replace(scenario.setup.timing, **changes))


def rms_um(values: FloatArray) -> float:
    return 1e6 * float(np.sqrt(np.mean(values**2)))


# ---- plants ----


def test_a_10_mm_move_lasts_143_ms() -> None:
    assert abs(move_time(0.01, 0.08, 8.0, 1000.0) - 0.143) < 1e-9


def test_error_of_the_physics_model() -> None:
    error = chou.errors(SILENT, "physics_model")
    assert rms_um(error) == pytest.approx(33.58, rel=0.005)
    assert 1e6 * np.abs(error).max() == pytest.approx(166.3, rel=0.01)


def test_error_does_not_depend_on_the_substep() -> None:
    found = [chou.errors(with_timing(SILENT, substeps=n), "physics_model") for n in (1, 2, 5, 10, 40)]
    assert np.ptp([rms_um(error) for error in found]) < 1e-3
    distances = [rms_um(error - found[-1]) for error in found[:-1]]
    assert max(distances) < 0.01
    assert distances[1] < distances[0] / 4.0


def test_agrees_with_a_fourth_order_integration_of_equation_13() -> None:
    fine, seconds = 20, 1.2
    short = with_timing(SILENT, duration_s=seconds, substeps=10)
    assert isinstance(short.motion, JerkLimitedMoves)
    h = 2e-3 / fine
    command = short.motion.reference(h / 2.0, round(seconds / h) * 2 + 1)[:, :2].tolist()

    def slope(x: float, v: float, k: int) -> tuple[float, float]:
        x_d, v_d = command[k]
        force = 100.0 * v * abs(v) + 1000.0 * x * abs(x)
        return v, 24674.0 * (x_d - x) + 15.7 * (v_d - v) - force

    x = v = 0.0
    expected = []
    for k in range(0, len(command) - 2, 2):
        if k % fine == 0:
            expected.append(x)
        a, b = slope(x, v, k)
        c, d = slope(x + h / 2 * a, v + h / 2 * b, k + 1)
        e, f = slope(x + h / 2 * c, v + h / 2 * d, k + 1)
        g, i = slope(x + h * e, v + h * f, k + 2)
        x, v = x + h / 6 * (a + 2 * c + 2 * e + g), v + h / 6 * (b + 2 * d + 2 * f + i)
    found = short.record()["position_m"]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-9)


def test_without_effects_and_noise_the_physics_model_is_exact() -> None:
    for scenario in (STAIRCASE, SPIRAL):
        error = chou.errors(chou.changed(scenario, effects=(), noisy=False), "physics_model")
        assert np.abs(error).max() < 1e-13


def test_transfer_functions() -> None:
    plant = STAIRCASE.plant
    assert isinstance(plant, ServoStage)
    m, c, k = plant.mass_kg, plant.damping_N_s_per_m, plant.stiffness_N_per_m
    (axis,) = plant.axes().values()
    for omega in (1.0, 100.0, 1000.0):
        s = 1j * omega
        assert chou.gain_at(axis, omega) == pytest.approx((c * s + k) / (m * s**2 + c * s + k), rel=1e-12)
        forced = dataclasses.replace(axis, B=axis.F)
        assert chou.gain_at(forced, omega) == pytest.approx(-1.0 / (m * s**2 + c * s + k), rel=1e-12)
    stage = SPIRAL.plant
    assert isinstance(stage, XYStage)
    for specification, response in zip((stage.x, stage.y), stage.axes().values(), strict=True):
        for omega in (1.0, 100.0, 1000.0):
            s, expected = 1j * omega, 0.0 + 0.0j
            for mode in specification.modes:
                w = 2.0 * np.pi * mode.frequency_Hz
                numerator = mode.alpha_per_s2 + mode.beta_per_s * s
                expected += numerator / (s**2 + 2.0 * mode.damping_ratio * w * s + w**2)
            assert chou.gain_at(response, omega) == pytest.approx(expected, rel=1e-10)


def test_static_gains_of_the_xy_stage() -> None:
    stage = SPIRAL.plant
    assert isinstance(stage, XYStage)
    assert stage.x.static_gain == pytest.approx(1.000049, abs=1e-6)
    assert stage.y.static_gain == pytest.approx(1.000285, abs=1e-6)
    for axis, response in zip((stage.x, stage.y), stage.axes().values(), strict=True):
        assert response.C @ response.rest == pytest.approx(axis.static_gain, rel=1e-12)


@pytest.mark.parametrize("scenario", [STAIRCASE, SPIRAL], ids=["servo_stage", "xy_stage"])
def test_a_constant_force_moves_the_stage_by_the_compliance(scenario: Scenario) -> None:
    moved = chou.changed(scenario, effects=(effect("constant_force", constant_force_N=10.0),), noisy=False)
    errors = chou.errors(moved, "physics_model")
    plant = scenario.plant
    assert isinstance(plant, ServoStage | XYStage)
    for error, response in zip(errors, plant.axes().values(), strict=True):
        assert error[-1] == pytest.approx(10.0 * response.compliance_m_per_N, rel=1e-3)


def test_stiff_friction_stays_stable() -> None:
    friction = effect("coulomb_friction", coulomb_force_N=10.0, transition_velocity_m_per_s=1e-4)
    rubbed = with_timing(chou.changed(STAIRCASE, effects=(friction,), noisy=False), duration_s=1.5)
    found = [chou.errors(with_timing(rubbed, substeps=n), "physics_model") for n in (1, 4, 40, 400)]
    distances = [rms_um(error - found[-1]) for error in found[:-1]]
    assert distances[0] < 20.0
    assert distances[1] < 2.0
    assert distances[2] < 0.02


@pytest.mark.parametrize("n_lanes", [3, 70], ids=["alone", "side_by_side"])
@pytest.mark.parametrize("scenario", [STAIRCASE, SPIRAL], ids=["servo_stage", "xy_stage"])
def test_lanes_have_the_bits_of_a_single_one(scenario: Scenario, n_lanes: int) -> None:
    single, several = scenario.system(), scenario.system(n_lanes)
    seeds = range(5, 5 + n_lanes)
    several.start(list(seeds))
    several = pickle.loads(pickle.dumps(several))
    action = np.resize([0.0, 1e-4, -1e-4], n_lanes)
    parts = [several.advance(n, action if n == 100 else None) for n in (300, 100, 1, 99)]
    rows = np.concatenate(parts)
    for lane in (0, 1, n_lanes - 2, n_lanes - 1):
        single.start([seeds[lane]])
        expected = [single.advance(300), single.advance(100, action[lane : lane + 1]), single.advance(100)]
        np.testing.assert_array_equal(rows[:, :, lane], np.concatenate(expected)[:, :, 0])
    several.start([8], np.array([1]))
    single.start([8])
    one_by_one = [single.advance_one(0.0)[1] for _ in range(300)]
    np.testing.assert_array_equal(several.advance(300)[:, :, 1], one_by_one)
    assert not several.diverged.any()


def test_each_axis_has_an_action_of_its_own() -> None:
    action = 1e-4 * np.array([[0.0, 1.0, 0.0, 1.0], [0.0, 0.0, -2.0, -2.0]])
    rows = {}
    for name, given in (("own", action), ("x", action[:, :1]), ("common", action[0])):
        n_lanes = 1 if name == "x" else 4
        system = SPIRAL.system(n_lanes)
        system.start([9] * n_lanes)
        rows[name] = system.advance(300, given)
    own = rows["own"]
    for axis, other in ((slice(0, 3), slice(3, 6)), (slice(3, 6), slice(0, 3))):
        moved, still = (1, 2) if axis.start == 0 else (2, 1)
        assert (own[-1, axis, moved] != own[-1, axis, 0]).any()
        np.testing.assert_array_equal(own[:, axis, still], own[:, axis, 0])
        np.testing.assert_array_equal(own[:, axis, 3], own[:, axis, moved])
        np.testing.assert_array_equal(own[:, other, moved], own[:, other, 0])
    np.testing.assert_array_equal(rows["x"][:, :, 0], own[:, :, 0])
    np.testing.assert_array_equal(rows["common"][:, :3], own[:, :3][:, :, [0, 1, 0, 1]])
    one = SPIRAL.system()
    one.start([9])
    np.testing.assert_array_equal([one.advance_one(1e-4)[1] for _ in range(300)], rows["common"][:, :, 1])


def test_actions_move_the_table_and_not_the_reference() -> None:
    system = SILENT.system()
    system.start([0])
    rows = system.advance(400, np.array([2e-3]))[:, :, 0]
    np.testing.assert_array_equal(rows[:, 0], system.commanded["reference_position_m"][:400])
    assert rows[-1, 2] - rows[-1, 0] == pytest.approx(2e-3, abs=1e-4)
    assert not system.diverged[0]
    system.start([0])
    rows = system.advance(400, np.array([0.2]))
    assert system.diverged[0]
    assert rows[-1, -1, 0] == 1.0


def test_a_process_force_is_the_truth() -> None:
    force, shaker = effect("constant_force"), effect("shaker_force")
    truth = chou.changed(STAIRCASE, effects=(force, shaker)).observe(0)[1]
    assert truth.disturbance_N is not None
    assert np.abs(truth.disturbance_N).max() > 0.0
    np.testing.assert_array_equal(chou.changed(STAIRCASE, effects=(force,)).observe(0)[1].disturbance_N, np.zeros(6000))


def test_forces_with_hidden_states_and_of_the_command_converge() -> None:
    bristles = effect(
        "lugre_friction",
        coulomb_force_N=5.0,
        static_force_N=6.0,
        bristle_stiffness_N_per_m=1e5,
        bristle_damping_N_s_per_m=10.0,
    )
    cutting = effect("tooth_passing_force", axial_depth_m=1e-5)
    for force in (bristles, cutting):
        loaded = with_timing(chou.changed(STAIRCASE, effects=(force,), noisy=False), duration_s=1.0)
        found = [chou.errors(with_timing(loaded, substeps=n), "physics_model") for n in (5, 10, 80)]
        coarse, fine = (rms_um(error - found[-1]) for error in found[:-1])
        assert rms_um(found[-1]) > 10.0
        assert coarse < 0.02  # a tooth enters with a jump, which no substep resolves
        assert fine < (coarse / 2.0 if force is bristles else coarse)


def test_what_a_stage_cannot_do_is_refused() -> None:
    setup = STAIRCASE.setup
    with pytest.raises(SpecError, match=r"encoder_quantisation acts on a feed drive's motor_encoder"):
        STAIRCASE.plant.system(dataclasses.replace(setup, unmodelled=(effect("encoder_quantisation"),)))
    with pytest.raises(SpecError, match=r"reality\.noise\.x_position_m: servo_stage has no such reading"):
        STAIRCASE.plant.system(dataclasses.replace(setup, noise=Noise(x_position_m=1e-6)))
    with pytest.raises(SpecError, match=r"moves 1 axes, the plant has 2"):
        SPIRAL.plant.system(Setup(timing=setup.timing, motion=setup.motion))
    with pytest.raises(SpecError, match=r"moves 2 axes, the plant has 1"):
        STAIRCASE.plant.system(dataclasses.replace(setup, motion=SPIRAL.setup.motion))
    with pytest.raises(
        SpecError, match=r"model 'servo' is not offered by this servo_stage\. Did you mean servo_response"
    ):
        STAIRCASE.plant.linear_model("servo")
    with pytest.raises(SpecError, match=r"seeds: 1 are expected"):
        STAIRCASE.system().start([1, 2])
    system = STAIRCASE.system()
    system.start([0])
    with pytest.raises(SpecError, match=r"the episode ends after 6000 samples"):
        system.advance(6001)


# ---- spiral ----


def test_spiral_keeps_its_limits_and_its_shape() -> None:
    motion = SPIRAL.motion
    assert isinstance(motion, CircularSpiral)
    h = 1e-5
    fine = motion.reference(h, 30000)
    for axis in (0, 3):
        np.testing.assert_allclose(np.gradient(fine[:, axis], h)[1:-1], fine[1:-1, axis + 1], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(np.gradient(fine[:, axis + 1], h)[1:-1], fine[1:-1, axis + 2], rtol=0.0, atol=0.05)
    whole = motion.reference(1e-3, 5000)
    x, y = whole[:, 0] + motion.start_radius_m, whole[:, 3]
    angle = np.unwrap(np.arctan2(y, x))
    np.testing.assert_allclose(np.hypot(x, y), motion.start_radius_m + motion.radius_m_per_rad * angle, atol=1e-15)
    assert np.hypot(whole[:, 1], whole[:, 4]).max() == pytest.approx(0.08, rel=1e-12)
    assert angle[-1] == pytest.approx(motion.end_angle_rad, rel=1e-12)
    assert np.abs(whole[0, [0, 1, 3, 4]]).max() < 1e-18
    assert np.abs(whole[-1, [1, 2, 4, 5]]).max() < 1e-15


def test_a_spiral_that_does_not_grow_is_refused() -> None:
    motion = SPIRAL.motion
    assert isinstance(motion, CircularSpiral)
    with pytest.raises(SpecError, match=r"end_radius_m: 0\.0004 m must be above"):
        dataclasses.replace(motion, end_radius_m=4e-4)


# ---- recursive least squares ----


def test_rls_meets_the_oracle() -> None:
    data = np.load(shared_file("oracles", "rls", "rls55.npz"))
    theta, P = np.zeros(55), float(data["delta"]) * np.eye(55)
    first = 0
    for last in (40, 100, 300, 600):
        rls(theta, P, data["X"][first:last], data["y"][first:last], float(data["lam"]))
        first = last
        exact, diagonal = data[f"theta_{last}"], data[f"P_diag_{last}"]
        assert np.abs(theta - exact).max() <= 1e-9 * np.abs(exact).max()
        np.testing.assert_allclose(np.diag(P), diagonal, rtol=1e-9)
        np.testing.assert_array_equal(P, P.T)


def staircase_signals() -> tuple[FloatArray, FloatArray]:
    """Return predicted positions and errors of the staircase, mm."""
    record = STAIRCASE.record(1)
    regression = STAIRCASE.context().regression(record)
    response = regression.regressors[:, 0]
    return 1e3 * response, 1e3 * (regression.target - response)


def feature_rows(response: FloatArray, error: FloatArray, q: int, p: int) -> FloatArray:
    n = len(response)
    columns = [np.ones(n)]
    columns += [np.concatenate((np.zeros(lag), response[: n - lag])) for lag in range(q + 1)]
    columns += [np.concatenate((np.zeros(lag), error[: n - lag])) for lag in range(1, p + 1)]
    return np.column_stack(columns)


def test_batches_and_rls_and_ridge_agree() -> None:
    response, error = staircase_signals()
    rows = feature_rows(response, error, 3, 50)
    state = untrained(3, 50, 1.0)
    predict(state, response, error, 3, 100)
    w = np.empty(55)
    solve(state.A, state.b, w)
    theta, P = np.zeros(55), np.eye(55)
    rls(theta, P, rows, error, 1.0)
    ridge = np.linalg.solve(rows.T @ rows + np.eye(55), rows.T @ error)
    largest = np.abs(ridge).max()
    assert np.abs(w - theta).max() <= 1e-6 * largest
    assert np.abs(w - ridge).max() <= 1e-6 * largest


@pytest.mark.parametrize(("q", "p", "batch"), [(3, 50, 100), (0, 0, 7), (2, 5, 3), (1, 4, 1)])
def test_predictions_are_those_of_the_plain_definition(q: int, p: int, batch: int) -> None:
    response, error = (values[800:1250] for values in staircase_signals())
    rows = feature_rows(response, error, q, p)
    expected = np.zeros(len(error))
    for first in range(0, len(error), batch):
        past, known = rows[:first], error[:first].copy()
        w = np.linalg.solve(past.T @ past + 0.1 * np.eye(2 + q + p), past.T @ error[:first])
        for k in range(first, min(first + batch, len(error))):
            mixed = np.concatenate((known, np.zeros(len(error) - len(known))))
            expected[k] = w @ feature_rows(response, mixed, q, p)[k]
            known = np.append(known, expected[k])
    found = predict(untrained(q, p, 0.1), response, error, q, batch)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_a_batch_is_predicted_without_its_measurements() -> None:
    response, error = staircase_signals()
    changed = error.copy()
    changed[1200:] += 1.0
    whole, other = (predict(untrained(3, 50, 1.0), response, values, 3, 100) for values in (error, changed))
    np.testing.assert_array_equal(whole[:1300], other[:1300])
    assert np.abs(whole[1300:1400] - other[1300:1400]).max() > 0.0


# ---- estimators ----


@pytest.mark.parametrize("scenario", [STAIRCASE, SPIRAL], ids=["servo_stage", "xy_stage"])
def test_streaming_has_the_bits_of_fit(scenario: Scenario) -> None:
    record, context = scenario.record(2), scenario.context()
    regression = context.regression(record)
    estimator = HybridRLS(initialisation_samples=150)
    fitted = estimator.fit(context, record).output
    estimator.start(context)
    for sample in samples(regression):
        estimator.update(sample)
    np.testing.assert_array_equal(estimator.estimate().output, fitted)
    physics = PhysicsModel().fit(context, record).output
    assert fitted is not None
    assert physics is not None
    np.testing.assert_array_equal(physics, regression.regressors.sum(axis=1))
    n = record.n_samples
    for first in range(0, len(fitted), n):
        np.testing.assert_array_equal(fitted[first : first + 150], physics[first : first + 150])
        assert (fitted[first + 150 : first + n] != physics[first + 150 : first + n]).any()


def test_the_second_axis_is_learnt_anew() -> None:
    record, context = SPIRAL.record(), SPIRAL.context()
    regression = context.regression(record)
    output = HybridRLS().fit(context, record).output
    assert output is not None
    n = record.n_samples
    response, target = regression.regressors[n:, 1], regression.target[n:]
    error = predict(untrained(3, 50, 1.0), 1e3 * response, 1e3 * (target - response), 3, 100)
    np.testing.assert_array_equal(output[n:], response + error / 1e3)


def test_hybrid_on_the_staircase() -> None:
    assert chou.hybrid_um(STAIRCASE) == pytest.approx(14.5, abs=0.5)


def test_hybrid_falls_behind_with_regularisation() -> None:
    found = [chou.hybrid_um(STAIRCASE, 2, lam_mm2=lam) for lam in (0.01, 0.1, 1.0, 10.0, 100.0)]
    assert found == sorted(found)
    np.testing.assert_allclose(found, [10.6, 11.7, 14.5, 19.4, 25.3], rtol=0.0, atol=0.5)


def test_hybrid_on_the_spiral() -> None:
    physics, hybrid = (chou.errors(SPIRAL, name) for name in ("physics_model", "hybrid_rls"))
    for axis, target in ((0, 0.40), (1, 0.37)):
        gain = 1.0 - chou.later_um(hybrid[axis]) / chou.later_um(physics[axis])
        assert gain == pytest.approx(target, abs=0.04)


def test_every_published_figure_holds() -> None:
    found = reproduce.run("chou")
    assert len(found) > 60
    assert [(row.item, row.value, row.target) for row in found if not row.ok] == []


def test_physics_and_hybrid_skip_plants_that_are_neither_a_stage_nor_an_equation() -> None:
    context = load_scenario("SpindleStep-v0").context()
    for estimator in (HybridRLS(), PhysicsModel()):
        assert "do not give every state" in (estimator.skip(context) or "")
        assert estimator.skip(STAIRCASE.context()) is None
    with pytest.raises(SpecError, match="hybrid_rls: the readings of a sample"):
        HybridRLS().start(context)


def commands(record: Record) -> Record:
    """Return what is known of a record beforehand."""
    return Record({name: column for name, column in record.items() if name == "time_s" or "reference" in name})


@pytest.mark.parametrize("name", ["ServoStaircase-v0", "ServoSpiral-v0"])
def test_a_free_run_with_what_was_learnt_beats_the_data_sheet(name: str) -> None:
    scenario = load_scenario(name)
    context, record = scenario.context(), scenario.record(0)
    measured, errors = context.regression(record).target, []
    for estimator in (HybridRLS(), Null()):
        run = estimator.predict(context, estimator.fit(context, record), commands(record))
        assert run is not None
        errors.append(np.sqrt(np.mean((run - measured) ** 2)))
    assert errors[0] < 0.8 * errors[1]


def test_a_free_run_by_hand() -> None:
    """A = I: weights b = (1, 2, 0.5) on 1, response and error before; 1 + 2 * 3 = 7, then 7 + 0.5 * 7 = 10.5."""
    state = untrained(0, 1, 1.0)
    state.b[:] = 1.0, 2.0, 0.5
    np.testing.assert_allclose(free_run(state, np.array([3.0, 3.0]), 0), [7.0, 10.5])
    np.testing.assert_array_equal(state.w, 0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"response_lags": -1}, r"response_lags = -1 must be an integer of at least 0"),
        ({"error_lags": 2.0}, r"error_lags = 2\.0 must be an integer"),
        ({"batch_samples": 0}, r"batch_samples = 0 must be an integer of at least 1"),
        ({"initialisation_samples": -3}, r"initialisation_samples = -3 must be"),
        ({"regularisation_m2": 0.0}, r"regularisation_m2 = 0\.0 must be above 0"),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        HybridRLS(**arguments)


def test_update_before_start_is_refused() -> None:
    sample = samples(STAIRCASE.context().regression(STAIRCASE.record()))[0]
    with pytest.raises(PluginError, match=r"start\(context\) must come before"):
        HybridRLS().update(sample)


def test_too_little_regularisation_is_named() -> None:
    with pytest.raises(SpecError, match=r"regularisation_m2 = 1e-40; the features are too alike"):
        HybridRLS(regularisation_m2=1e-40).fit(SILENT.context(), SILENT.record())
