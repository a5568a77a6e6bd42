"""The smoother is the conditional mean of a Gaussian process, and better than the filters that cannot look ahead."""

from pathlib import Path

import numpy as np
import pytest
from disturbance_found import error_of
from fdbench_baselines._kalman_filter import Observer
from fdbench_baselines._steady_smoother import filtered
from fdbench_baselines.kalman import Kalman
from fdbench_baselines.kalman_central import KalmanCentral
from fdbench_baselines.rts_smoother import RtsSmoother

from fdbench.errors import SpecError
from fdbench.estimator import Estimator, FloatArray


def model() -> Observer:
    """A damped mass under a random walk, read by position and velocity, in SI units that differ a lot in size."""
    A = np.array([[1.0, 0.8e-3, 0.0], [-0.2, 0.7, 1e-2], [0.0, 0.0, 1.0]])
    C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    Q = np.diag([1e-12, 1e-8, 4.0])
    return Observer(A, np.zeros((3, 0)), C, Q, np.array([1e-12, 1e-4]), np.diag([1e-6, 1e-2, 100.0]))


def dense(y: FloatArray, given: Observer) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the last state given all readings, by the covariance of the whole record."""
    n, m = len(y), len(given.A)
    blocks = np.zeros((n, n, m, m))
    P = given.P
    for k in range(n):
        P = given.A @ P @ given.A.T + given.Q
        blocks[k, k] = P
        for j in range(k + 1, n):
            blocks[j, k] = given.A @ blocks[j - 1, k]
            blocks[k, j] = blocks[j, k].T
    states = blocks.transpose(0, 2, 1, 3).reshape(n * m, n * m)
    H = np.kron(np.eye(n), given.C)
    readings = H @ states @ H.T + np.kron(np.eye(n), np.diag(given.R))
    scale = np.sqrt(np.diag(readings))
    gain = np.linalg.solve(readings / np.outer(scale, scale), (H @ states) / scale[:, None])
    last = slice(m - 1, None, m)
    mean = gain[:, last].T @ (y.ravel() / scale)
    return mean, np.diag(states)[last] - np.sum(gain[:, last] * (H @ states / scale[:, None])[:, last], axis=0)


def test_it_is_the_mean_of_the_dense_process() -> None:
    given, rng = model(), np.random.default_rng(5)
    x, readings = rng.normal(size=3) * np.sqrt(np.diag(given.P)), []
    for _ in range(300):
        x = given.A @ x + rng.normal(size=3) * np.sqrt(np.diag(given.Q))
        readings.append(given.C @ x + rng.normal(size=2) * np.sqrt(given.R))
    y = np.array(readings)
    found = filtered(given, np.zeros((len(y), 0)), y)
    force, variance = found.smoothed(-1)
    mean, exact = dense(y, given)
    late = slice(60, None)  # from where on the gain is the steady one
    assert np.abs(force - mean)[late].max() < 1e-6 * np.abs(mean).max()
    assert variance / found.scale == pytest.approx(exact[150], rel=1e-6)
    assert found.scale == pytest.approx(1.0, abs=0.15)
    assert np.abs(force - mean)[:60].max() < np.sqrt(exact[:60]).max()


@pytest.mark.parametrize(
    ("name", "filtering"), [("SpindleMilling-v1", Kalman()), ("SensorNetwork-v1", KalmanCentral())]
)
def test_who_looks_ahead_sees_more(name: str, filtering: Estimator) -> None:
    seeds = (101, 102, 103)
    smoothing = np.mean([error_of(RtsSmoother(), name, seed) for seed in seeds])
    assert smoothing < 0.8 * np.mean([error_of(filtering, name, seed) for seed in seeds])


@pytest.mark.parametrize("quieter", ["e-8", "e-10"])
def test_a_record_without_visible_noise_is_smoothed(quieter: str, tmp_path: Path) -> None:
    path = tmp_path / "QuietStep.toml"
    path.write_text(f'extends = "SpindleStep-v0"\n[reality.noise]\ndisplacement_m = 4.813463447437164{quieter}\n')
    assert error_of(RtsSmoother(), str(path), 0) < 0.02


@pytest.mark.parametrize("argument", ["q_N2_per_s", "process_factor", "initial_force_N"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.inf, np.nan])
def test_densities_that_are_none_are_refused(argument: str, value: float) -> None:
    with pytest.raises(SpecError, match=f"rts_smoother: {argument}"):
        RtsSmoother(**{argument: value})
