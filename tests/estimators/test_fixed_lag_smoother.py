"""A row of fixed lag is the conditional mean given the readings up to so many samples later, and knows none beyond."""

from dataclasses import replace

import numpy as np
import pytest
from disturbance_found import error_of
from fdbench_baselines import fixed_lag_smoother
from fdbench_baselines._example import example_network
from fdbench_baselines._fixed_lag import lagged_state, lagged_sum
from fdbench_baselines._kalman_filter import Observer, steady_covariance
from fdbench_baselines._motion_smoother import Drift, ForcedMotion, passed, smoothed
from fdbench_baselines._steady_smoother import filtered, settled
from fdbench_baselines.fixed_lag_smoother import FixedLagSmoother
from fdbench_baselines.rts_smoother import RtsSmoother

from fdbench.errors import SpecError
from fdbench.estimator import FloatArray

DRIFT = Drift(0.7, 0.2, np.array([1.0, 1.0, 0.9]), np.array([0.0, 0.1, 0.19]), np.array([1.0, 0.5, 1.0]))


@pytest.fixture
def model() -> Observer:
    """A damped mass under a random walk, read by position and velocity, in SI units that differ a lot in size."""
    A = np.array([[1.0, 0.8e-3, 0.0], [-0.2, 0.7, 1e-2], [0.0, 0.0, 1.0]])
    C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    Q = np.diag([1e-12, 1e-8, 4.0])
    return Observer(A, np.zeros((3, 0)), C, Q, np.array([1e-12, 1e-4]), np.diag([1e-6, 1e-2, 100.0]))


@pytest.fixture
def y(model: Observer) -> FloatArray:
    rng, readings = np.random.default_rng(5), []
    x = rng.normal(size=3) * np.sqrt(np.diag(model.P))
    for _ in range(200):
        x = model.A @ x + rng.normal(size=3) * np.sqrt(np.diag(model.Q))
        readings.append(model.C @ x + rng.normal(size=2) * np.sqrt(model.R))
    return np.array(readings)


@pytest.fixture
def motion() -> ForcedMotion:
    rng, n = np.random.default_rng(4), 40
    return ForcedMotion(
        known=rng.normal(size=n),
        columns=np.column_stack((np.ones(n), rng.normal(size=(n, 2)))),
        reading=np.cumsum(rng.normal(size=n)),
        missing=rng.random(n) < 0.2,
        jolt=np.where(np.arange(n) == 7, 3.0, 0.0),
        shock=np.zeros(n, dtype=np.bool_),
        place=0,
    )


def augmented(given: Observer, y: FloatArray, lag: int) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the last state ``lag`` samples ago, by the filter of a state that holds its past."""
    m = len(given.A)
    A, Q = np.zeros((m + lag, m + lag)), np.zeros((m + lag, m + lag))
    A[:m, :m], Q[:m, :m] = given.A, given.Q
    A[np.arange(m, m + lag), np.arange(m - 1, m + lag - 1)] = 1.0
    C = np.hstack((given.C, np.zeros((len(given.C), lag))))
    x, P = np.zeros(m + lag), np.zeros((m + lag, m + lag))
    P[:m, :m] = steady_covariance(given) + given.A @ given.P @ given.A.T
    mean, variance = [], []
    for k in range(len(y)):
        if k > 0:
            x, P = A @ x, A @ P @ A.T + Q
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + np.diag(given.R))
        rest = np.eye(m + lag) - K @ C
        x, P = x + K @ (y[k] - C @ x), rest @ P @ rest.T + K * given.R @ K.T
        mean.append(x[-1])
        variance.append(P[-1, -1])
    last = np.arange(m + lag - 2, m - 2, -1)  # those that the record's end leaves with fewer readings
    return np.append(mean[lag:], x[last]), np.append(variance[lag:], np.diag(P)[last])


@pytest.mark.parametrize("lag", [0, 1, 2, 7, 25])
def test_it_is_the_filter_of_a_state_that_holds_its_past(model: Observer, y: FloatArray, lag: int) -> None:
    mean, variance = augmented(model, y, lag)
    force, stated = lagged_state(model, np.zeros((len(y), 0)), y, -1, lag)
    assert np.abs(force - mean).max() < 1e-9 * np.abs(mean).max()
    np.testing.assert_allclose(stated, variance, rtol=1e-9)


@pytest.mark.parametrize("lag", [0, 1, 2, 7, 25])
def test_it_is_what_is_left_of_an_adjoint_without_those_beyond(model: Observer, y: FloatArray, lag: int) -> None:
    run, back = filtered(model, np.zeros((len(y), 0)), y), settled(model).transition
    later = np.zeros_like(run.adjoints)
    later[: -lag - 1] = run.adjoints[lag + 1 :]
    known = run.adjoints - later @ np.linalg.matrix_power(back, lag + 1).T
    force, variance = lagged_state(model, np.zeros((len(y), 0)), y, -1, lag)
    left = (run.states[:, -1] + known @ run.P[:, -1]) * run.size[-1]
    settled_rows = slice(100, None)  # before them the adjoints' start is told by the whole record
    assert np.abs(force - left)[settled_rows].max() < 1e-9 * np.abs(force).max()
    beyond = np.linalg.matrix_power(back, lag + 1)
    N = run.N - beyond @ run.N @ beyond.T
    assert variance[120] == pytest.approx((run.P - run.P @ N @ run.P)[-1, -1] * run.size[-1] ** 2, rel=1e-9)


def test_a_lag_beyond_the_record_is_the_smoother(model: Observer, y: FloatArray) -> None:
    whole, variance = (run := filtered(model, np.zeros((len(y), 0)), y)).smoothed(-1)
    force, stated = lagged_state(model, np.zeros((len(y), 0)), y, -1, 1000)
    np.testing.assert_allclose(force, whole, rtol=0.0, atol=1e-9 * np.abs(whole).max())
    assert stated[100] * run.scale == pytest.approx(variance, rel=1e-9)


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("lag", [0, 1, 4, 100])
def test_on_a_drive_it_is_the_smoother_of_a_record_that_ends_there(motion: ForcedMotion, place: int, lag: int) -> None:
    motion = motion._replace(place=place, reading=motion.reading - motion.reading[0])
    # The start's variance is told by the record, so that a record that is cut off has its readings missing instead.
    mean, variance = lagged_sum(motion, DRIFT.kept_share, passed(motion, DRIFT), motion.columns, lag)
    for k in range(len(motion.reading)):
        cut = motion._replace(missing=motion.missing | (np.arange(len(motion.reading)) > k + lag))
        found = smoothed(cut, DRIFT, passed(cut, DRIFT), motion.columns)
        assert mean[k] == pytest.approx(found.mean[k], abs=1e-9)
        assert variance[k] == pytest.approx(found.variance[k], abs=1e-9)


@pytest.mark.parametrize("lag", [0, 3])
def test_a_row_knows_no_reading_beyond_its_lag(
    lag: int, model: Observer, y: FloatArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    context, record = example_network(force_N=10.0)
    claims, cut = [], 120
    for factor in (1.0, 5.0):
        other = y.copy()
        other[cut + lag + 1 :] *= factor
        found = (model, np.zeros((len(y), 0)), other)
        monkeypatch.setattr(fixed_lag_smoother, "likeliest", lambda *_, found=found: found)
        claims.append(np.asarray(FixedLagSmoother(lag=lag).fit(context, record).disturbance_N))
    before, after = claims
    np.testing.assert_array_equal(before[: cut + 1], after[: cut + 1])
    assert before[cut + 1] != after[cut + 1]


@pytest.mark.parametrize("name", ["SpindleMilling-v1", "SensorNetwork-v1"])
def test_three_samples_at_a_spindle_are_nearly_the_whole_record(name: str) -> None:
    filtering, lagged = (error_of(FixedLagSmoother(lag=lag), name, 101) for lag in (0, 3))
    smoothing = error_of(RtsSmoother(), name, 101)
    assert lagged == pytest.approx(smoothing, rel=0.05)
    assert lagged < filtering


def test_a_shaker_on_an_axis_with_friction_is_found_the_better_the_later() -> None:
    early, late = (error_of(FixedLagSmoother(lag=lag), "LinearMotorAxis-v1", 101) for lag in (0, 20))
    assert late < 0.9 * early
    assert late < 0.2


@pytest.mark.parametrize("argument", ["lag", "harmonics"])
@pytest.mark.parametrize("value", [-1, 1.5, np.nan])
def test_numbers_that_are_none_are_refused(argument: str, value: float) -> None:
    with pytest.raises(SpecError, match=f"fixed_lag_smoother: {argument}"):
        FixedLagSmoother(**{argument: value})  # type: ignore[arg-type]


def test_a_model_that_is_neither_is_skipped() -> None:
    context, record = example_network(force_N=0.0)
    other = replace(context, model="none")
    reason = FixedLagSmoother().skip(other)
    assert reason is not None
    with pytest.raises(SpecError, match=reason):
        FixedLagSmoother().fit(other, record)
