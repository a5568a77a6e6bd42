"""Readings from which a drive's parameters follow without estimation: the way of a sample in a velocity loop."""

import math

import numpy as np
import pytest
from fdbench_baselines.least_squares import LeastSquares
from scipy.optimize import brentq

from fdbench.catalogue import newest_ids
from fdbench.estimator import FloatArray, Regression
from fdbench.plants._velocity_loop import held_time_s
from fdbench.record import Record
from fdbench.scenario import load_scenario

BARELY_MOVING_M_PER_S = 2e-3
LOOPS = [name for name in newest_ids() if load_scenario(name).estimation.model == "velocity_loop"]


def ways(record: Record, regression: Regression, *, summed: bool) -> FloatArray:
    r"""Return beta from position alone: x_{k+1} - x_k = (g - K h) v_k + K h v_r - ..., which no noise enters.

    K is the gain over the mass, g and h are the integrals of the pole's response over a sample. Summed, errors of the
    reading are white.
    """
    Z, steady = regression.regressors, np.ones(len(regression.target), np.bool_)
    if Z.shape[1] > 2:
        steady = np.minimum(np.abs(Z[:, 1]), np.abs(regression.target)) > BARELY_MOVING_M_PER_S
        steady &= Z[:, 1] * regression.target > 0.0
    x = record["motor_position_m"]
    X, y = Z[steady], np.diff(x)[steady]
    if summed:
        run = np.cumsum(~steady)[steady]
        levels = (run[:, None] == np.unique(run)).astype(float)
        X, y = np.hstack((np.cumsum(Z * steady[:, None], axis=0)[steady], levels)), x[1:][steady]
    scale = np.linalg.norm(X, axis=0)
    theta = np.linalg.lstsq(X / scale, y, rcond=None)[0] / scale
    period_s, g = record.sampling_time_s, theta[0] + theta[1]
    pole = brentq(lambda p: held_time_s(p, period_s) - g, -500.0, 500.0)
    h = (g - period_s) / pole
    beta_1 = theta[0] / h * g
    others = theta[2 : Z.shape[1]] / h * g
    return np.array([beta_1, math.exp(pole * period_s) - beta_1, *others])


def errors(name: str, seed: int) -> tuple[float, float, float]:
    """Return errors in the parameters: of the ways, of their sums and of least squares."""
    scenario = load_scenario(name)
    record, truth = scenario.observe(seed)
    context = scenario.context()
    regression = context.regression(record)
    size = np.sqrt(np.mean(regression.regressors**2, axis=0))
    true = np.array([truth.parameters[key] for key in regression.names])
    found = LeastSquares().fit(context, record).parameters
    claims = (
        ways(record, regression, summed=False),
        ways(record, regression, summed=True),
        np.array([found[key] for key in regression.names]),
    )
    return tuple(float(np.linalg.norm(size * (claim - true))) for claim in claims)  # type: ignore[return-value]


@pytest.mark.parametrize("name", ["MillingAir-v1", "ShakerControl-v1"])
def test_an_exact_position_gave_the_parameters_away(name: str) -> None:
    ways_alone, _, equation = errors(name, 100)
    assert ways_alone < 1e-3 * equation


@pytest.mark.parametrize("name", ["MillingAir", "ShakerControl"])
def test_a_scale_tells_less_than_the_equation(name: str) -> None:
    newest = next(found for found in LOOPS if found.startswith(f"{name}-"))
    assert min(errors(newest, 100)[:2]) > 1.5 * errors(newest, 100)[2]


@pytest.mark.parametrize("name", LOOPS)
def test_no_position_is_read_exactly(name: str) -> None:
    """A scale of 3 um leaves 1 mm/s in the way of a 3 ms sample, 50 times the noise of any loop's equation."""
    scenario = load_scenario(name)
    noise = scenario.reality.noise
    assert scenario.timing is not None
    assert noise.motor_position_m / scenario.timing.sampling_time_s > 20.0 * noise.equation_velocity_m_per_s
