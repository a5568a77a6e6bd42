"""The smoother of a drive's motion is the conditional mean of a Gaussian process, and sees through a reversal."""

import numpy as np
import pytest
from conftest import shared_file
from disturbance_found import error_of
from fdbench_baselines._found_drive import simulated_target
from fdbench_baselines._friction_motion import FEED, carried, filled, model_parameters, sheet
from fdbench_baselines._motion_smoother import MOTION, Drift, ForcedMotion, passed, smoothed
from fdbench_baselines.rts_friction import RtsFriction
from fdbench_baselines.state_space_gp import StateSpaceGp
from fdbench_baselines.ukf_lugre import UkfLugre

from fdbench.errors import SpecError
from fdbench.estimator import Estimate, Estimator, FloatArray
from fdbench.record import Record
from fdbench.scenario import load_scenario


def dense(motion: ForcedMotion, drift: Drift, sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the sums given all readings, by the covariance of the whole record."""
    n, m = motion.columns.shape
    M, mean = m + MOTION, np.zeros((n, m + MOTION))
    blocks = np.zeros((n, n, M, M))
    x, P = np.zeros(M), np.diag(np.concatenate(([drift.reading] * MOTION, drift.start)))
    x[motion.place] = motion.reading[0]
    if motion.place == 0:
        P[1, 1] = np.mean(np.diff(motion.reading) ** 2)
    for k in range(n):
        P = P + np.diag(np.concatenate((np.zeros(MOTION), drift.start * (drift.kept_share < 1.0)))) * motion.shock[k]
        mean[k], blocks[k, k] = x, P
        A = np.diag(np.concatenate((np.ones(MOTION), drift.kept_share)))
        A[0, 1], A[0, MOTION:], A[1, MOTION:] = 1.0, 0.5 * motion.columns[k], motion.columns[k]
        x = A @ x + motion.known[k] * np.concatenate(([0.5, 1.0], np.zeros(m)))
        P = A @ P @ A.T + np.diag(np.concatenate(([0.0, drift.kick + motion.jolt[k]], drift.fresh)))
        for j in range(k + 1 if k + 1 < n else 0):
            blocks[k + 1, j] = A @ blocks[k, j]
            blocks[j, k + 1] = blocks[k + 1, j].T
    covariance = blocks.transpose(0, 2, 1, 3).reshape(n * M, n * M)
    read = np.flatnonzero(~motion.missing)
    H, wanted = np.zeros((len(read), n * M)), np.zeros((n, n * M))
    H[np.arange(len(read)), read * M + motion.place] = 1.0
    for k in range(n):
        wanted[k, k * M + MOTION : (k + 1) * M] = sums[k]
    S = H @ covariance @ H.T + drift.reading * np.eye(len(read))
    gain = np.linalg.solve(S, H @ covariance @ wanted.T).T
    force = wanted @ mean.ravel() + gain @ (motion.reading[read] - mean[read, motion.place])
    return force, np.diag(wanted @ covariance @ wanted.T) - np.einsum("ij,ji->i", gain, H @ covariance @ wanted.T)


@pytest.mark.parametrize("place", [0, 1])
def test_it_is_the_mean_of_the_dense_process(place: int) -> None:
    rng, n = np.random.default_rng(4), 40
    columns = np.column_stack((np.ones(n), rng.normal(size=(n, 2))))
    motion = ForcedMotion(
        known=rng.normal(size=n),
        columns=columns,
        reading=np.cumsum(rng.normal(size=n)),
        missing=rng.random(n) < 0.2,
        jolt=np.where(np.arange(n) == 7, 3.0, 0.0),
        shock=np.arange(n) == 11,
        place=place,
    )
    drift = Drift(0.7, 0.2, np.array([1.0, 1.0, 0.9]), np.array([0.0, 0.1, 0.19]), np.array([1.0, 0.5, 1.0]))
    found = smoothed(motion, drift, passed(motion, drift), columns)
    force, variance = dense(motion, drift, columns)
    np.testing.assert_allclose(found.mean, force, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.variance, variance, rtol=0.0, atol=1e-9)


def test_a_jump_of_a_coefficient_that_forgets_stands_out_where_it_is() -> None:
    rng, n = np.random.default_rng(5), 400
    wave = np.cos(0.7 * np.arange(n))
    speed = np.cumsum(wave * np.where(np.arange(n) < 200, 0.0, 2.0) + 0.1 * rng.normal(size=n))
    off = np.zeros(n, dtype=np.bool_)
    motion = ForcedMotion(np.zeros(n), wave[:, None], np.append(0.0, speed[:-1]), off, np.zeros(n), off, 1)
    drift = Drift(1e-6, 0.01, np.array([0.999]), np.array([2e-3]), np.array([1.0]))
    shocks = smoothed(motion, drift, passed(motion, drift), wave[:, None]).shocks
    assert abs(int(np.argmax(shocks)) - 200) <= 2
    assert shocks.max() > 36.0


def test_a_record_may_begin_in_motion() -> None:
    """A drive that coasts from the first sample on, at 600 deviations a sample, is under no force."""
    n, off = 200, np.zeros(200, dtype=np.bool_)
    reading = 600.0 * np.arange(n) + np.random.default_rng(7).normal(size=n)
    motion = ForcedMotion(np.zeros(n), np.ones((n, 1)), reading, off, np.zeros(n), off, 0)
    drift = Drift(1.0, 1e-6, np.ones(1), np.array([1e-6]), np.zeros(1))
    run = passed(motion, drift)
    assert np.abs(run.errors / np.sqrt(run.variances)).max() < 5.0
    assert np.abs(smoothed(motion, drift, run, motion.columns).mean).max() < 0.02


def test_friction_that_turns_gradually_is_found_at_its_level_between_reversals() -> None:
    """Its sheet has it turn within 1 mm/s; here it lags by 10 ms, resists otherwise backwards and ripples."""
    shared_file("data", "emps", "DATA_EMPS.mat")
    h, n = 1e-3, 12000
    angle = 2.0 * np.pi / 3.0 * h * np.arange(n + 1)
    place = 0.05 * np.sin(angle) + 0.005 * np.sin(5.0 * angle)
    v = np.diff(place) / h
    friction, kept = np.full(n, 20.0), np.exp(-h / 0.01)
    for k in range(1, n):
        friction[k] = kept * friction[k - 1] + (1.0 - kept) * 20.0 * np.tanh(v[k] / 1e-3)
    ripple = np.sin(2.0 * np.pi * place[:-1] / 2.5e-3)
    force = 95.0 * np.diff(v, append=v[-1]) / h + 200.0 * v - 30.0 * np.abs(v) + friction - 3.0 + ripple
    noise = 2e-8 * np.random.default_rng(1).normal(size=n)
    read = 5e-8 * np.round((place[:-1] + noise) / 5e-8)
    columns = dict.fromkeys(("position_m", "motor_position_m", "reference_position_m"), read)
    record = Record({"time_s": np.linspace(0.0, h * (n - 1), n), **columns, "motor_force_N": force})
    context = load_scenario("EMPS-v0").context()
    estimate = RtsFriction().fit(context, record)
    found, covariance = estimate.parameters, estimate.covariance
    assert covariance is not None
    assert found["mass_kg"] == pytest.approx(95.0, rel=0.02)
    assert found["viscous_friction_N_s_per_m"] == pytest.approx(200.0, rel=0.05)
    assert found["coulomb_friction_N"] == pytest.approx(20.0, rel=0.05)
    off = np.array(list(found.values())) - [95.0, 200.0, 20.0, -3.0]
    assert np.abs(off / np.sqrt(np.diag(covariance))).max() < 2.0


def test_bristles_bend_before_the_drive_slides() -> None:
    """After a reversal the friction comes back over 2 F_c / sigma_0, 11.25 um; a sign has it at once."""
    drive = load_scenario("LinearMotorAxis-v1").plant
    velocity = np.concatenate((np.full(50, 0.01), np.full(50, -0.001)))
    force = carried(drive, velocity, 5e-4)  # type: ignore[arg-type]
    way = 0.001 * 5e-4 * np.arange(1, 51)
    assert force[49] == pytest.approx(45.0 + 10.0 * np.exp(-4.0), rel=1e-3)
    assert np.all(np.diff(force[50:]) < 0.0)
    assert np.all(force[50:][way < 2e-6] > 0.0)
    assert force[-1] < -40.0


def test_parameters_of_a_sheet_are_the_nominal_ones() -> None:
    for name in ("ShakerConstant-v1", "MillingAir-v1", "LinearMotorAxis-v1"):
        context = load_scenario(name).context()
        gain = getattr(context.plant.controller, "gain_N_s_per_m", 0.0)  # type: ignore[attr-defined]
        found = model_parameters(context, sheet(context).rigid(np.zeros(4)), gain)
        np.testing.assert_allclose(found, list(context.nominal.values()), rtol=1e-9)


def test_a_drive_that_is_found_as_its_sheet_says_is_simulated_as_that() -> None:
    scenario = load_scenario("BallScrewAxis-v1")
    context, record = scenario.context(), scenario.record(0)
    found = simulated_target(context, Estimate(parameters=dict(context.nominal)), {}, record)
    heavier = {**context.nominal, "mass_kg": 1.1 * context.nominal["mass_kg"]}
    other = simulated_target(context, Estimate(parameters=heavier), {}, record)
    own = context.regression(context.plant.respond(record))  # type: ignore[attr-defined]
    assert found is not None
    assert other is not None
    np.testing.assert_allclose(found, own.target, rtol=0.0, atol=1e-9)
    assert float(own.regressors[:, 0] @ (other - found)) > 0.0


def test_held_samples_are_filled_by_a_spline() -> None:
    place = np.arange(30.0) ** 3
    held = np.array([5, 11, 12])
    fresh = np.setdiff1d(np.arange(30), held)
    stepped = place.copy()
    stepped[held] = place[[4, 10, 10]]
    np.testing.assert_allclose(filled(stepped, fresh), place, rtol=1e-9, atol=1e-6)


def test_a_shaker_on_an_axis_with_bristles_is_found_through_reversals() -> None:
    name, seed = "LinearMotorAxis-v1", 101
    found = error_of(RtsFriction(), name, seed)
    assert found < 0.05
    assert found < 0.2 * error_of(StateSpaceGp(), name, seed)


@pytest.mark.parametrize("harmonics", [-1, 1.5])
def test_harmonics_that_are_none_are_refused(harmonics: float) -> None:
    with pytest.raises(SpecError, match="rts_friction: harmonics"):
        RtsFriction(harmonics)  # type: ignore[arg-type]


@pytest.mark.parametrize("deviation", [0.0, -1.0, np.inf, np.nan])
def test_a_deviation_that_is_none_is_refused(deviation: float) -> None:
    with pytest.raises(SpecError, match="rts_friction: shape_deviation"):
        RtsFriction(shape_deviation=deviation)


@pytest.mark.parametrize("kind", [RtsFriction, UkfLugre])
def test_a_record_without_the_commanded_velocity_is_taken(kind: type[Estimator]) -> None:
    """A shaker's wave does not follow the feed, which a measured record may lack."""
    scenario = load_scenario("LinearMotorAxis-v1")
    context, record = scenario.context(), scenario.record(11)
    assert context.disturbance_period_s is not None
    assert FEED in record
    bare = Record({name: record[name][: record.n_samples // 4] for name in record.columns if name != FEED})
    found = kind().fit(context, bare)
    assert found.disturbance_N is not None
    assert np.isfinite(found.disturbance_N).all()
