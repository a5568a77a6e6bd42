"""The Kalman observer of a linear model against its dense Gaussian twin, and on drives drawn from their data sheets."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from fdbench_baselines._data_sheet import sheet
from fdbench_baselines._kalman_oscillators import Filtered, Variances, run_smoother
from fdbench_baselines._kalman_regression import Rows, filtered, sudden_rows
from fdbench_baselines._robust import loudness, robust_residual
from fdbench_baselines._slip import slipped_period
from fdbench_baselines.kalman import Kalman
from fdbench_baselines.least_squares import LeastSquares

from fdbench.errors import SpecError
from fdbench.estimator import FloatArray, samples
from fdbench.scenario import load_scenario

NOISE = Variances(reading=0.3, walk=0.02, wave=0.7, memory=0.97, angle=0.9, slope=0.6)


def prior(feed: FloatArray, harmonics: int) -> FloatArray:
    """Return the covariance (n, n) of slope, walk and oscillators: 1 + q min(i, j), s rho^|i - j| cos(h w (i - j))."""
    n = len(feed)
    i = np.arange(n)
    lag = np.abs(i[:, None] - i)
    K = NOISE.slope * np.outer(feed, feed) + 1.0 + NOISE.walk * np.minimum(i[:, None], i)
    for h in range(1, harmonics + 1):
        K = K + NOISE.wave * NOISE.memory**lag * np.cos(h * NOISE.angle * lag)
    return K


@pytest.mark.parametrize(("p", "harmonics"), [(2, 0), (0, 2), (3, 3)])
def test_filter_and_smoother_equal_a_dense_gaussian_process(p: int, harmonics: int) -> None:
    random = np.random.default_rng(p)
    n = 40
    Z, y, loud = random.standard_normal((n, p)), random.standard_normal(n), np.where(np.arange(n) % 7 == 0, 5.0, 1.0)
    feed = random.standard_normal(n)
    K = prior(feed, harmonics)
    # From the sudden row on a further walk and further waves are there, each of variance 1.
    later, lag = np.arange(n) - 25, np.abs(np.arange(n)[:, None] - np.arange(n))
    both = np.minimum.outer(later, later)
    for h in range(harmonics + 1):
        K += np.where(both >= 0, NOISE.memory ** (2.0 * both + lag) * np.cos(h * NOISE.angle * lag) if h else 1.0, 0.0)
    S = Z @ Z.T + K + NOISE.reading * np.diag(loud)
    run = filtered(Rows(np.column_stack((Z, feed)), y, loud, np.arange(n) == 25, p), NOISE, harmonics)
    expected = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1] + n * np.log(2.0 * np.pi))
    assert run.log_likelihood == pytest.approx(expected, rel=1e-10)
    np.testing.assert_allclose(run.states[-1, :p], Z.T @ np.linalg.solve(S, y), atol=1e-10)
    np.testing.assert_allclose(run.covariances[-1, :p, :p], np.eye(p) - Z.T @ np.linalg.solve(S, Z), atol=1e-10)
    mean, variance = run_smoother(
        np.column_stack((Z, feed)),
        p,
        NOISE,
        harmonics,
        run.errors,
        run.variances,
        run.states[:-1],
        run.covariances[:-1],
    )
    np.testing.assert_allclose(mean, K @ np.linalg.solve(S, y), atol=1e-10)
    np.testing.assert_allclose(variance, np.diag(K - K @ np.linalg.solve(S, K)), atol=1e-10)


def test_two_readings_of_a_constant_by_hand() -> None:
    """A unit prior, readings 3 and 3 of variance 1/2 each: 6 / (2 + 1/2), and 1 / (1 + 2 + 2) of the variance."""
    quiet = Variances(reading=0.5, walk=0.0, wave=0.0, memory=0.5, angle=0.0)
    rows = Rows(np.empty((2, 0)), np.array([3.0, 3.0]), np.ones(2), np.zeros(2, np.bool_), 0)
    run = filtered(rows, quiet, 0)
    mean, variance = run_smoother(rows.Z, 0, quiet, 0, run.errors, run.variances, run.states[:-1], run.covariances[:-1])
    np.testing.assert_allclose(mean, 2.4)
    np.testing.assert_allclose(variance, 0.2)


def test_outliers_count_less() -> None:
    Z = np.ones((101, 1))
    y = np.random.default_rng(0).standard_normal(101)
    clean = y.mean()
    y[50] = 1e4
    residual, loud = robust_residual(Z, y)
    assert loud[50] > 1e6
    assert abs(y[0] - residual[0] - clean) < 0.05
    assert loudness(np.zeros(3)).tolist() == [1.0, 1.0, 1.0]


def test_slip_of_a_spindle_is_found() -> None:
    time_s = 0.003 * np.arange(4000)
    signal = np.sin(2 * np.pi * 50.2 * time_s) + 2.0 * np.cos(4 * np.pi * 50.2 * time_s)
    signal += np.random.default_rng(1).standard_normal(4000)
    assert 1.0 / slipped_period(time_s, signal, 0.02, 3) == pytest.approx(50.2, abs=0.01)


def test_a_tool_that_enters_is_sudden() -> None:
    """Errors of 9, 9 and 2 deviations, then 9 again after 0.2 s: the first and the last begin something."""
    errors = np.zeros(400)
    errors[[10, 11, 15, 300]] = 9.0, 9.0, 2.0, -9.0
    run = Filtered(errors, np.ones(400), np.empty(0), np.empty(0), 0.0)
    assert np.flatnonzero(sudden_rows(run, 0.001)).tolist() == [10, 300]


def test_a_cut_that_begins_does_not_bias_the_parameters() -> None:
    scenario = load_scenario("MillingDecreasing-v0")
    record, truth = scenario.observe(0)
    found = Kalman().fit(scenario.context(), record).parameters
    batch = LeastSquares().fit(scenario.context(), record).parameters
    for name, value in truth.parameters.items():
        assert abs(found[name] - value) < 0.15 * abs(batch[name] - value)


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_drawn_machine_is_found_from_its_data_sheet(seed: int) -> None:
    scenario = load_scenario("ShakerConstant-v1")
    record, truth = scenario.observe(seed)
    context = scenario.context()
    found = Kalman().fit(context, record)
    regression = context.regression(record)
    size = np.sqrt(np.mean(regression.regressors**2, axis=0))
    names = regression.names

    def error(parameters: Any) -> float:
        return rms(size * [parameters[name] - truth.parameters[name] for name in names])

    assert error(found.parameters) < 0.05 * error(context.nominal)
    assert truth.disturbance_N is not None
    d = truth.disturbance_N[regression.rows]
    window = (regression.time_s > 2.4) & (regression.time_s < 9.6)
    estimated, variance = cast(FloatArray, found.disturbance_N), cast(FloatArray, found.disturbance_variance_N2)
    assert rms((estimated - d)[window]) < 0.15 * rms(d[window])
    inside = np.abs(estimated - d)[window] < 1.96 * np.sqrt(variance[window])
    assert 0.65 < inside.mean() <= 1.0
    innovation = regression.target - cast(FloatArray, found.output)
    assert np.mean(innovation**2 / cast(FloatArray, found.output_variance)) == pytest.approx(1.0, abs=0.15)


def test_a_stream_is_the_record_so_far() -> None:
    scenario = load_scenario("ShakerConstant-v1")
    context, record = scenario.context(), scenario.record(0)
    regression = context.regression(record)
    estimator = Kalman(harmonics=1)
    estimator.start(context)
    for sample in samples(regression)[:600]:
        estimator.update(sample)
    part = estimator.estimate()
    assert cast(FloatArray, part.output).shape == (600,)
    estimator.start(context)
    with pytest.raises(SpecError, match="0 rows for 4 parameters"):
        estimator.estimate()


def test_without_a_stated_covariance_the_prior_is_as_wide_as_the_target() -> None:
    scenario = load_scenario("ShakerConstant-v1")
    context, record = replace(scenario.context(), covariance=None), scenario.record(0)
    regression = context.regression(record)
    root = sheet(context, regression).root
    size = np.sqrt(np.mean(regression.regressors**2, axis=0))
    np.testing.assert_allclose(np.diag(root) * size, rms(regression.target))


@pytest.mark.parametrize("harmonics", [-1, 1.5])
def test_harmonics_out_of_bounds_are_refused(harmonics: Any) -> None:
    with pytest.raises(SpecError, match="harmonics"):
        Kalman(harmonics=harmonics)
