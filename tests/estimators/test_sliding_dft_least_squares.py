"""Sliding transforms give the batch's bins at every row, and an equation that no run-out or offset reaches."""

from dataclasses import replace

import numpy as np
import pytest
from fdbench_baselines._example import Example, example_drive, example_milling
from fdbench_baselines.frequency_least_squares import FrequencyLeastSquares
from fdbench_baselines.least_squares import LeastSquares
from fdbench_baselines.sliding_dft_least_squares import SlidingDftLeastSquares

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import samples
from fdbench.record import Record

PERIOD_S = 0.0311
WINDOW_S, FUNCTIONS = 1.5, 4


def with_force(force_N: np.ndarray) -> Example:
    context, record = example_milling()
    columns = {name: record[name] for name in ("time_s", "feedrate_m_per_s")}
    context = replace(context, disturbance_period_s=PERIOD_S)
    return Example(context, Record(columns | {"force_N": record["force_N"] + force_N}))


def largest_error(estimator: SlidingDftLeastSquares | FrequencyLeastSquares | LeastSquares, case: Example) -> float:
    found, nominal = estimator.fit(*case).parameters, case.context.nominal
    return max(abs(found[name] / value - 1.0) for name, value in nominal.items())


def test_the_factor_is_that_of_the_modulated_integrals() -> None:
    context, record = example_milling()
    estimator = SlidingDftLeastSquares(WINDOW_S, FUNCTIONS)
    estimator.fit(context, record)
    assert estimator._factor is not None
    # The same as integrals over modulating functions and their derivatives, each window from the beginning.
    step_s, N = context.sampling_time_s, round(WINDOW_S / context.sampling_time_s)
    u, y = context.plant.settled(record)[1:]
    t = step_s * np.arange(N + 1)
    half = np.append(0.5, np.append(np.ones(N - 1), 0.5))
    c_1, c_2, _, _ = context.plant.coefficients
    functions = []
    for m in range(1, FUNCTIONS + 1):
        s = 2j * np.pi * (m + np.arange(3)) / (N * step_s)
        terms = np.exp(-np.outer(t, s)) * [1.0, -2.0, 1.0]
        functions.append([half * (terms * (-s) ** order).sum(axis=1) for order in range(3)])
    phi, slope, curvature = np.moveaxis(np.array(functions), 1, 0)
    # White noise of the force in the equation, filtered by the sheet's denominator.
    noise = curvature - c_1 * slope + c_2 * phi
    noise[:, 0] += noise[:, -1]
    white = np.linalg.inv(np.linalg.cholesky(noise[:, :-1] @ noise[:, :-1].conj().T / N))
    rows = []
    for last in range(N, len(u) - 1):
        a, b = y[last - N : last + 1], u[last - N : last + 1]
        terms = [phi @ a, -slope @ a, -phi @ b, slope @ b, -curvature @ a]
        equations = white @ np.transpose(terms)
        rows += [equations.real, equations.imag]
    X = np.vstack(rows)
    gram, expected = estimator._factor.T @ estimator._factor, X.T @ X
    size = np.sqrt(np.diag(expected))
    assert np.allclose(gram / np.outer(size, size), expected / np.outer(size, size), rtol=0.0, atol=1e-9)


@pytest.mark.linear_algebra
def test_neither_a_runout_nor_an_offset_reaches_the_parameters() -> None:
    time_s = example_milling().record["time_s"]
    case = with_force(30.0 + 2.0 * np.sin(2.0 * np.pi * time_s / PERIOD_S + 1.0))
    assert largest_error(SlidingDftLeastSquares(WINDOW_S, FUNCTIONS), case) < 1e-3
    assert largest_error(FrequencyLeastSquares(), case) > 2e-3
    assert largest_error(LeastSquares(), case) > 0.5


@pytest.mark.linear_algebra
def test_the_noise_of_the_force_stays_within_the_covariance() -> None:
    estimator, squares = SlidingDftLeastSquares(WINDOW_S, FUNCTIONS), []
    for seed in range(20):
        context, record = with_force(0.01 * np.random.default_rng(seed).standard_normal(200))
        found = estimator.fit(context, record)
        assert found.covariance is not None
        error = np.array(list(found.parameters.values())) - np.array(list(context.nominal.values()))
        squares.append(float(error @ np.linalg.solve(found.covariance, error)) / 4.0)
    assert 0.3 < np.mean(squares) < 3.0


def test_before_the_first_window_is_full_the_sheet_stands() -> None:
    context, record = example_milling()
    estimator = SlidingDftLeastSquares(WINDOW_S, FUNCTIONS)
    estimator.start(context)
    for sample in samples(context.regression(record))[:100]:
        estimator.update(sample)
    assert estimator.estimate().parameters == context.nominal
    assert estimator.estimate().covariance is None


def test_what_is_forgotten_does_little_harm() -> None:
    force_N = np.zeros(200)
    force_N[:20] = 5.0 * np.random.default_rng(0).standard_normal(20)
    case = with_force(force_N)
    kept = largest_error(SlidingDftLeastSquares(1.0, 3), case)
    assert largest_error(SlidingDftLeastSquares(1.0, 3, forgetting=0.8), case) < 0.25 * kept


def test_bad_input_is_refused() -> None:
    with pytest.raises(SpecError, match="window_s = 0"):
        SlidingDftLeastSquares(0.0)
    with pytest.raises(SpecError, match="functions = 1"):
        SlidingDftLeastSquares(functions=1)
    with pytest.raises(SpecError, match=r"forgetting = 1\.1"):
        SlidingDftLeastSquares(forgetting=1.1)
    with pytest.raises(SpecError, match="holds 15 samples; at least 24 are needed for 8 functions"):
        SlidingDftLeastSquares(0.15).fit(*example_milling())
    with pytest.raises(SpecError, match="the plant is no slot milling"):
        SlidingDftLeastSquares().fit(*example_drive())
    with pytest.raises(PluginError, match="must come before"):
        SlidingDftLeastSquares().estimate()
    context, record = example_milling()
    still = {name: record[name] for name in ("time_s", "force_N")} | {"feedrate_m_per_s": np.full(200, 1e-3)}
    with pytest.raises(SpecError, match="do not identify c_1 to c_4"):
        SlidingDftLeastSquares(WINDOW_S, FUNCTIONS).fit(context, Record(still))
