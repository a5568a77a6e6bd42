"""The hybrid model and the physics alone on drives: generalised least squares by hand, and drawn machines."""

from typing import Any, cast

import numpy as np
import pytest
from fdbench_baselines._data_sheet import sheet_beforehand
from fdbench_baselines._generalised_least_squares import at_start, follow_errors
from fdbench_baselines._one_step import OneStep, declined
from fdbench_baselines.hybrid_rls import HybridRLS
from fdbench_baselines.null import Null
from fdbench_baselines.physics_model import PhysicsModel

from fdbench.estimator import FloatArray
from fdbench.plants import StateSpacePlant
from fdbench.scenario import load_scenario


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_two_rows_by_hand() -> None:
    """Row 1: e = 2, r = 4, S = 1 + 4; then r = 16/5, P = 1 / (1 + 5/16) = 16/21, beta = P * 2 / r = 10/21."""
    state = at_start(np.zeros(1), np.ones(1), 1, 0.0)
    out = follow_errors(state, np.ones((2, 1)), np.array([2.0, 2.0]), np.ones(2, np.bool_))
    r = 16.0 / 5.0
    np.testing.assert_allclose(out, [[0.0, 0.0, 5.0], [10.0 / 21.0, 0.0, 16.0 / 21.0 + r]])
    e = 2.0 - 10.0 / 21.0
    r = 0.5 * (r + e**2 * r / (16.0 / 21.0 + r))
    np.testing.assert_allclose(state.theta, [4.0 / r / (1.0 + 2.0 / r), 0.0])
    np.testing.assert_allclose(state.P, [[1.0 / (1.0 + 2.0 / r), 0.0], [0.0, 0.0]])


def test_rows_at_rest_do_not_settle_what_moves_later() -> None:
    random, n = np.random.default_rng(0), 400
    z = np.where(np.arange(n) < 100, 1e-6, random.standard_normal(n))
    y = 0.7 * z + np.where(np.arange(n) < 100, 1e-9, 0.1) * random.standard_normal(n)
    state = at_start(np.zeros(1), np.ones(1), 0, 0.0)
    follow_errors(state, z[:, None], y, np.ones(len(y), np.bool_))
    assert state.theta[0] == pytest.approx(0.7, abs=0.03)
    assert np.sqrt(state.P[0, 0]) == pytest.approx(0.1 / np.sqrt(300.0), rel=0.3)


def test_parameters_are_right_under_an_autoregressive_error_where_least_squares_is_biased() -> None:
    random, n = np.random.default_rng(3), 8000
    u, e = random.standard_normal(n), random.standard_normal(n)
    error, y = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        error[k] = 0.9 * error[k - 1] + 0.3 * e[k]
        y[k] = 0.5 * y[k - 1] + 0.7 * u[k] + error[k]
    Z = np.column_stack((np.append(0.0, y[:-1]), u))
    state = at_start(np.zeros(2), np.ones(2), 5, 0.5)
    follow_errors(state, Z, y, np.ones(len(y), np.bool_))
    biased = np.linalg.lstsq(Z, y)[0]
    assert abs(biased[0] - 0.5) > 0.1
    np.testing.assert_allclose(state.theta[:2], [0.5, 0.7], atol=0.03)
    np.testing.assert_allclose(state.theta[2:4], [0.9, 0.0], atol=0.05)
    assert state.noise[0] / state.noise[1] == pytest.approx(0.09, rel=0.1)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_drawn_machine_is_found(seed: int) -> None:
    scenario = load_scenario("ShakerConstant-v1")
    context, (record, truth) = scenario.context(), scenario.observe(seed)
    regression, estimator, physics = context.regression(record), HybridRLS(), PhysicsModel()
    found, paper = estimator.fit(context, record), physics.fit(context, record)
    size = np.sqrt(np.mean(regression.regressors**2, axis=0))

    def error(parameters: Any) -> float:
        return rms(size * [parameters[name] - truth.parameters[name] for name in regression.names])

    assert error(found.parameters) < 0.05 * error(context.nominal)
    assert truth.disturbance_N is not None
    d = truth.disturbance_N[regression.rows]
    window = (regression.time_s > 2.4) & (regression.time_s < 9.6)
    force = cast(FloatArray, found.disturbance_N)
    assert rms((force - d)[window]) < 0.15 * rms(d[window])
    assert rms((cast(FloatArray, paper.disturbance_N) - d)[window]) > 2.0 * rms((force - d)[window])
    command = scenario.command()
    assert command is not None
    assert truth.response is not None
    own, as_nominal = (
        estimator.predict(context, found, command),
        Null().predict(context, Null().fit(context, record), command),
    )
    runs = [cast(FloatArray, own), cast(FloatArray, as_nominal)]
    assert rms(runs[0] - truth.response) < 0.2 * rms(runs[1] - truth.response)


def test_force_on_a_drive_with_current_input() -> None:
    scenario = load_scenario("DriveCurrentClosed-v0")
    context, (record, truth) = scenario.context(), scenario.observe(0)
    force = cast(FloatArray, HybridRLS().fit(context, record).disturbance_N)
    assert truth.disturbance_N is not None
    assert force[800:].mean() == pytest.approx(100.0, abs=1.0)
    assert rms(force - truth.disturbance_N[:-1]) < 0.4 * truth.disturbance_N.std()
    raw = cast(FloatArray, PhysicsModel().fit(context, record).disturbance_N)
    assert raw[800:].mean() == pytest.approx(100.0, abs=1.0)


def test_one_step_of_a_drive_by_hand() -> None:
    """Inertia 0.01 kg m^2 and 1 N m/A at a lead of 10 mm: 1 A over 1 ms makes 1e-3 / 0.01 rad/s, times lead / 2 pi."""
    context = load_scenario("DriveCurrentClosed-v0").context()
    assert isinstance(context.plant, StateSpacePlant)
    step = OneStep(context.plant, 1e-3)
    np.testing.assert_allclose(step.from_outputs, [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(step.from_inputs, 0.1 * 0.01 / (2.0 * np.pi))
    rows = np.array([[0.0, 0.2, 0.0], [1.0, 0.5, 0.0]])
    np.testing.assert_allclose(step.predicted(None, rows), [0.2, 0.2 + 0.1 * 0.01 / (2.0 * np.pi)])
    np.testing.assert_allclose(step.predicted(rows[0], rows[1:]), [0.2 + 0.1 * 0.01 / (2.0 * np.pi)])
    assert "do not give every state" in (declined(load_scenario("SensorNetwork-v0").context()) or "")


def test_the_data_sheet_beforehand() -> None:
    context = load_scenario("ShakerConstant-v1").context()
    found = sheet_beforehand(context)
    np.testing.assert_allclose(found.nominal, list(context.nominal.values()))
    np.testing.assert_allclose(found.root @ found.root.T, context.covariance, rtol=1e-9, atol=1e-20)
    stated = sheet_beforehand(load_scenario("ShakerConstant-v0").context())
    np.testing.assert_allclose(stated.root, np.diag(np.abs(stated.nominal)))
