"""The cogging observer: a dense twin, planted cogging within its stated interval, and claims of nothing."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from disturbance_found import error_of
from fdbench_baselines._example import example_cogging, example_drive
from fdbench_baselines._locally_periodic_force import posterior
from fdbench_baselines._position_waves import wave_columns, way_of
from fdbench_baselines._wandering_amplitudes import innovations_found, wandering
from fdbench_baselines.cogging_observer import CoggingObserver
from fdbench_baselines.kalman import Kalman
from fdbench_baselines.least_squares import LeastSquares
from fdbench_baselines.state_space_gp import StateSpaceGp

from fdbench.errors import FdbenchError, SpecError
from fdbench.estimator import Context, Estimate, FloatArray, Regression
from fdbench.record import Record
from fdbench.scenario import load_scenario

pytestmark = pytest.mark.linear_algebra

NAME, PITCH_M, NOISE_M_PER_S = "LinearMotorCogging-v0", 0.032, 1e-4


class Drive(NamedTuple):
    context: Context
    record: Record
    beta: FloatArray  # (4,)
    force_N: FloatArray  # (n_rows,)


def drive(
    seed: int,
    waves: tuple[tuple[float, float], ...] = ((45.0, 0.4), (20.0, -1.1)),
    told_m: float | None = PITCH_M,
    growth: float = 0.0,
    shaker_N: float = 0.0,
) -> Drive:
    """Return the model's own equation over magnets: amplitude (N) and phase of each harmonic, or a shaker of 7 Hz.

    The waves grow by a share of themselves over the record.
    """
    scenario = load_scenario(NAME)
    context, usual = scenario.context(), scenario.record(0)
    gain, step_s = context.regression(usual).disturbance_gain, context.sampling_time_s
    time_s, reference = usual["time_s"], usual["reference_velocity_m_per_s"]
    n = len(time_s)
    noise = (NOISE_M_PER_S * np.random.default_rng(seed).standard_normal(n)).tolist()
    beta = list(context.nominal.values())
    velocity, force, place, v = [0.0], [], 0.0, 0.0
    for k in range(n - 1):
        free = beta[0] * reference[k] + beta[1] * v - beta[2] * (v > 1e-3) + beta[3] * (v < -1e-3) + noise[k]
        d, size = 0.0, 1.0 + growth * (k / n - 0.5)
        # The position in the middle of the row hangs on the force of that row: a contraction, by a hundredth each time.
        for _ in range(4):
            turns = 2.0 * math.pi * (place + 0.25 * step_s * (v + free + gain * d)) / PITCH_M
            d = size * sum(A * math.sin(h * turns + phase) for h, (A, phase) in enumerate(waves, 1))
            d += shaker_N * math.sin(2.0 * math.pi * 7.0 * time_s[k])
        force.append(d)
        velocity.append(free + gain * d)
        place += 0.5 * step_s * (v + velocity[-1])
        v = velocity[-1]
    columns = {"time_s": time_s, "reference_velocity_m_per_s": reference, "velocity_m_per_s": np.array(velocity)}
    return Drive(replace(context, disturbance_pitch_m=told_m), Record(columns), np.array(beta), np.array(force))


def found(planted: Drive, harmonics: int = 4) -> Estimate:
    return CoggingObserver(harmonics).fit(planted.context, planted.record)


def error(estimate: Estimate, planted: Drive) -> float:
    assert estimate.disturbance_N is not None
    difference = estimate.disturbance_N - planted.force_N
    return float(np.linalg.norm(difference) / np.linalg.norm(planted.force_N))


def test_parameters_and_force_are_those_of_the_dense_process() -> None:
    """Generalised least squares and Gaussian conditioning with the covariance written out."""
    random, n = np.random.default_rng(3), 120
    x = np.cumsum(random.uniform(-0.5, 1.0, n))
    columns = np.column_stack([wave(h * x) for h in (1, 2) for wave in (np.cos, np.sin)])
    Z = np.column_stack((np.sin(0.3 * x), random.standard_normal(n)))
    y = Z @ [2.0, -1.0] + columns @ [1.0, 0.5, 0.0, 0.3] * (1.0 + np.arange(n) / n) + 0.2 * random.standard_normal(n)
    loud = np.where(np.arange(n) % 7 == 0, 3.0, 1.0)
    process = wandering(columns, Z, y, loud)
    regression = Regression(
        regressors=Z,
        target=y,
        names=("one", "two"),
        target_name="y",
        time_s=0.1 * np.arange(n),
        rows=np.arange(n),
        disturbance_gain=1.0,
    )
    beta, covariance = innovations_found(process, regression)
    later = np.minimum(np.arange(n)[:, None], np.arange(n))
    start, wandered = process.motion.P[:, 0, 0], process.motion.Q[:, 0, 0]
    K = process.s2 * sum(np.outer(h, h) * (P + Q * later) for h, P, Q in zip(columns.T, start, wandered, strict=True))
    S = K + process.s2 * np.diag(loud)
    dense_covariance = np.linalg.inv(Z.T @ np.linalg.solve(S, Z))
    assert covariance == pytest.approx(dense_covariance, rel=1e-6)
    assert beta == pytest.approx(dense_covariance @ Z.T @ np.linalg.solve(S, y), rel=1e-8)
    said = posterior(process, y - Z @ beta, Z, covariance, 0.1, False)
    moved = K @ np.linalg.solve(S, Z)
    assert said.force == pytest.approx(K @ np.linalg.solve(S, y - Z @ beta), rel=1e-6, abs=1e-8)
    variance = np.diag(K - K @ np.linalg.solve(S, K) + moved @ covariance @ moved.T)
    assert said.variance == pytest.approx(variance, rel=1e-5)


def test_columns_are_means_over_the_row() -> None:
    planted = drive(0)
    way = way_of(planted.context.regression(planted.record))
    fast = int(np.argmax(np.abs(way.moved_m)))
    points = way.middle_m[fast] + way.moved_m[fast] * (np.arange(1000) + 0.5 - 500.0) / 1000.0
    expected = [np.mean(wave(2.0 * np.pi * 2 * points / PITCH_M)) for wave in (np.cos, np.sin)]
    assert wave_columns(way, PITCH_M, 2)[fast, 2:] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("told_m", [PITCH_M, 1.01 * PITCH_M, None])
def test_planted_amplitudes_and_phases_are_found(told_m: float | None) -> None:
    """Amplitudes of 45 and 20 N with the phases 0.4 and -1.1 rad; 0.1 N is four deviations of their estimates."""
    planted = drive(1, told_m=told_m)
    estimator = CoggingObserver()
    force = estimator.fit(planted.context, planted.record).disturbance_N
    assert force is not None
    assert estimator.pitch_m == pytest.approx(PITCH_M, rel=2e-4)
    columns = wave_columns(way_of(planted.context.regression(planted.record)), PITCH_M, 2)
    a_1, b_1, a_2, b_2 = np.linalg.lstsq(columns, force, rcond=None)[0]
    assert (np.hypot(a_1, b_1), np.hypot(a_2, b_2)) == pytest.approx((45.0, 20.0), abs=0.1)
    assert (np.arctan2(a_1, b_1), np.arctan2(a_2, b_2)) == pytest.approx((0.4, -1.1), abs=0.01)


def test_stated_variances_are_those_of_the_errors() -> None:
    """Means of squares over 24 records with some four independent ones in each: 1 within three deviations of 0.15."""
    parameters, force, covered = [], [], []
    for seed in range(24):
        planted = drive(seed)
        estimate = found(planted)
        assert estimate.covariance is not None
        assert estimate.disturbance_N is not None
        assert estimate.disturbance_variance_N2 is not None
        values = np.array(list(estimate.parameters.values()))
        parameters.append((values - planted.beta) ** 2 / np.diag(estimate.covariance))
        squares = (estimate.disturbance_N - planted.force_N) ** 2 / estimate.disturbance_variance_N2
        force.append(squares)
        covered.append(np.mean(squares < 1.96**2))
    assert 0.55 < np.mean(parameters) < 1.45
    assert 0.55 < np.mean(force) < 1.45
    assert 0.88 < np.mean(covered) < 0.99


def test_amplitudes_that_grow_are_followed() -> None:
    """A quarter up and down about the mean: a constant wave errs by 14 % and more, 0.5/sqrt(12)."""
    growing = drive(2, growth=0.5)
    assert error(found(growing), growing) < 0.03


def test_the_fundamental_is_found_under_a_stronger_harmonic() -> None:
    planted = drive(3, waves=((8.0, 0.3), (40.0, 1.0)), told_m=None)
    estimator = CoggingObserver()
    estimate = estimator.fit(planted.context, planted.record)
    assert estimator.pitch_m == pytest.approx(PITCH_M, rel=5e-4)
    assert error(estimate, planted) < 0.01


@pytest.mark.parametrize("told_m", [PITCH_M, None])
def test_nothing_periodic_is_claimed_where_there_is_nothing(told_m: float | None) -> None:
    for seed in range(8):
        estimate = found(drive(seed, waves=(), told_m=told_m))
        assert estimate.disturbance_N is None
        assert set(estimate.parameters) == {"beta_1", "beta_2", "beta_3", "beta_4"}


@pytest.mark.parametrize("told_m", [PITCH_M, None])
def test_a_force_of_time_is_not_taken_for_one_of_position(told_m: float | None) -> None:
    assert found(drive(4, waves=(), told_m=told_m, shaker_N=20.0)).disturbance_N is None


@pytest.mark.parametrize("name", ["ShakerConstant-v2", "ShakerSweep-v2", "MillingIncreasing-v2", "MillingAir-v2"])
def test_forces_of_other_scenarios_are_not_claimed(name: str) -> None:
    """Without the period, for which it skips these scenarios, it looks and finds nothing."""
    scenario = load_scenario(name)
    assert CoggingObserver().skip(scenario.context()) == "the disturbance has a period in time and no pitch"
    context = replace(scenario.context(), disturbance_period_s=None)
    assert CoggingObserver().fit(context, scenario.record(0)).disturbance_N is None


def test_weak_cogging_is_claimed_only_where_it_stands_out() -> None:
    """In 3400 rows of 0.67 N an amplitude has a deviation of 16 mN: one of 0.5 N is found, one of 20 mN is not."""
    for amplitude_N, is_found in ((0.5, True), (0.02, False)):
        estimate = found(drive(5, waves=((amplitude_N, 0.0),), told_m=None))
        assert (estimate.disturbance_N is not None) == is_found


def test_the_force_is_better_than_that_of_others() -> None:
    """A smoother of time follows cogging too, as the drive is slow and its rows are hardly noisy, not as closely."""
    seeds, name = (101, 102, 103, 104), "LinearMotorCogging-v1"
    own = [error_of(CoggingObserver(), name, seed) for seed in seeds]
    assert max(own) < 0.05
    for other, factor in ((LeastSquares(), 10.0), (Kalman(), 10.0), (StateSpaceGp(), 1.5)):
        errors = [error_of(other, name, seed) for seed in seeds]
        assert np.mean(np.log(errors)) > np.mean(np.log(own)) + np.log(factor)


def test_a_period_in_time_does_not_help_a_method_of_time() -> None:
    """Even if it is told that of the cogging at the commonest speed, 0.15 m/s."""
    planted = drive(6)
    context = replace(planted.context, disturbance_pitch_m=None, disturbance_period_s=PITCH_M / 0.15)
    assert error(StateSpaceGp().fit(context, planted.record), planted) > 10.0 * error(found(planted), planted)


def test_parameters_are_not_biased_as_those_of_least_squares() -> None:
    planted = drive(7)
    own, usual = found(planted).parameters, LeastSquares().fit(planted.context, planted.record).parameters
    assert own["beta_1"] == pytest.approx(planted.beta[0], rel=5e-3)
    assert abs(usual["beta_1"] / planted.beta[0] - 1.0) > 0.3


def test_the_free_run_has_the_wave() -> None:
    planted, other = drive(8), drive(9)
    estimator = CoggingObserver()
    estimate = estimator.fit(planted.context, planted.record)
    whole = estimator.predict(planted.context, estimate, other.record)
    alone = planted.context.linear_model.free_run(other.record, estimate.parameters)
    assert whole is not None
    assert alone is not None
    errors = [float(np.std(run - other.record["velocity_m_per_s"][1:])) for run in (whole, alone)]
    assert errors[0] < 0.1 * errors[1]


def test_without_a_wave_the_free_run_is_that_of_the_parameters() -> None:
    planted = drive(0, waves=())
    estimator = CoggingObserver()
    estimate = estimator.fit(planted.context, planted.record)
    run = estimator.predict(planted.context, estimate, planted.record)
    assert run == pytest.approx(planted.context.linear_model.free_run(planted.record, estimate.parameters))


def test_what_cannot_be_is_refused() -> None:
    planted = drive(0)
    context, record = planted.context, planted.record
    with pytest.raises(SpecError, match=r"a pitch of 32 m on a way of 0\.4.* m .* Is it in metres"):
        CoggingObserver().fit(replace(context, disturbance_pitch_m=32.0), record)
    with pytest.raises(SpecError, match="two rows in a pitch"):
        CoggingObserver().fit(replace(context, disturbance_pitch_m=1e-3), record)
    metres_for_millimetres = {name: record[name] * (1e3 if "velocity" in name else 1.0) for name in record}
    with pytest.raises(SpecError, match="are the velocities in m/s"):
        CoggingObserver().fit(context, Record(metres_for_millimetres))
    with pytest.raises(FdbenchError, match="no column velocity_m_per_s"):
        CoggingObserver().fit(context, Record({name: record[name] for name in record if name != "velocity_m_per_s"}))
    still = {name: np.zeros_like(record[name]) if "velocity" in name else record[name] for name in record}
    with pytest.raises(SpecError, match=r"cannot be identified|more rows"):
        CoggingObserver().fit(context, Record(still))
    with pytest.raises(SpecError, match="harmonics = 0"):
        CoggingObserver(harmonics=0)
    with pytest.raises(SpecError, match=r"false_alarm = 1\.5"):
        CoggingObserver(false_alarm=1.5)


def test_other_models_are_skipped() -> None:
    reason = "the model is no velocity loop of a feed drive"
    for name in ("LinearMotorAxis-v1", "DriveCurrentOpen-v1", "SlotMilling-v1"):
        assert CoggingObserver().skip(load_scenario(name).context()) == reason


def test_a_drive_without_friction_and_a_short_record_are_served() -> None:
    context, record = example_cogging(cogging_N=5.0, told_m=0.02)
    assert CoggingObserver().fit(context, record).parameters["beta_1"] == pytest.approx(0.5, rel=2e-3)
    assert CoggingObserver().fit(*example_drive()).disturbance_N is None


def test_units_do_not_matter() -> None:
    """A drive ten times as heavy in a loop ten times as stiff moves alike under ten times the force."""
    planted = drive(0)
    plant = planted.context.plant
    motor, controller = plant.motor, plant.controller  # type: ignore[attr-defined]
    heavy = replace(  # type: ignore[type-var]
        plant,
        motor=replace(motor, mass_kg=10.0 * motor.mass_kg, viscous_friction_N_s_per_m=220.134),
        controller=replace(controller, gain_N_s_per_m=10.0 * controller.gain_N_s_per_m),
        effects=tuple(effect.scaled(10.0) for effect in plant.effects),  # type: ignore[attr-defined]
    )
    usual = found(planted).disturbance_N
    scaled = CoggingObserver().fit(replace(planted.context, plant=heavy), planted.record).disturbance_N
    assert usual is not None
    assert scaled == pytest.approx(10.0 * usual, rel=1e-9)
