"""Steady gains of the Kalman filters, beside the Riccati solver of SciPy and the design of python-control."""

from typing import Any

import numpy as np
import pytest
from fdbench_baselines._kalman_filter import gain, observer, steady_covariance
from scipy.linalg import solve_discrete_are

from fdbench.scenario import load_scenario

NAMES = ("SpindleStep-v0", "SpindleMilling-v0", "SensorNetwork-v0", "SensorNetworkLine-v0", "DriveCurrentClosed-v0")


@pytest.mark.linear_algebra
@pytest.mark.parametrize("within", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_doubling_solves_the_riccati_equation(name: str, within: bool) -> None:
    import control

    plant: Any = load_scenario(name).plant
    period_s = load_scenario(name).setup.timing.sampling_time_s
    model = observer(plant.state_space(period_s), period_s, 1e6, 10.0, within)
    P = steady_covariance(model)
    # In states of the size of their deviations and readings of unit noise the equation is well scaled for any solver.
    scale, noise = np.sqrt(np.diag(P)), np.sqrt(model.R)
    A, C = model.A / scale[:, None] * scale, model.C * scale / noise[:, None]
    Q, R = model.Q / scale[:, None] / scale, np.eye(len(noise))
    expected = solve_discrete_are(A.T, C.T, Q, R)
    np.testing.assert_allclose(P / scale[:, None] / scale, expected, atol=1e-6)
    designed, covariance, _ = control.dlqe(A, np.eye(len(A)), C, Q, R)
    np.testing.assert_allclose(covariance, expected, atol=1e-6)
    # dlqe returns the gain of the predictor, A K.
    own = gain(P, model.C, model.R) / scale[:, None] * noise
    np.testing.assert_allclose(A @ own, designed, atol=1e-6)
