"""Sequentially thresholded least squares, 2600 x 1001 with 400 outputs, beside pysindy, scikit-learn and NumPy.

Peers that solve each output by itself are timed on a few of them, and 400 outputs are extrapolated. What is compared is
the coefficients of these outputs. Ridge and Lasso give other coefficients: Ridge is one solution without thresholds and
is compared with ours, the Lasso is there for its time alone.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines._function_basis import NONLINEAR, expand
from fdbench_baselines._sparse_regression import FloatArray, least_squares, threshold_sequentially

from fdbench.plants import SpectralPlant
from fdbench.scenario import load_scenario

ROWS, COLUMNS, OUTPUTS, KEPT = 2600, 1001, 400, 10
THRESHOLD, ITERATIONS = 0.05, 10
BAR_S = 0.5


def made() -> tuple[FloatArray, FloatArray]:
    """Return white regressors and targets with ten terms each, some of them near the threshold."""
    random = np.random.default_rng(0)
    A = random.standard_normal((ROWS, COLUMNS))
    Z = np.zeros((COLUMNS, OUTPUTS))
    for output in range(OUTPUTS):
        Z[random.choice(COLUMNS, KEPT, replace=False), output] = random.uniform(0.5, 4.0, KEPT) * THRESHOLD
    return A, A @ Z + 0.3 * random.standard_normal((ROWS, OUTPUTS))


A, Y = made()


def ours() -> Burst:
    return lambda: threshold_sequentially(A, Y, THRESHOLD, ITERATIONS).coefficients.T


def ours_unthresholded() -> Burst:
    return lambda: least_squares(A, Y).T


def numpy_loop(outputs: int) -> Burst:
    def burst() -> FloatArray:
        Z = np.zeros((outputs, COLUMNS))
        for output in range(outputs):
            support, y = np.arange(COLUMNS), Y[:, output]
            found = np.linalg.lstsq(A, y)[0]
            for _ in range(ITERATIONS):
                large = np.abs(found) >= THRESHOLD
                if large.all():
                    break
                support = support[large]
                found = np.linalg.lstsq(A[:, support], y)[0]
            Z[output, support] = found
        return Z

    return burst


def pysindy(outputs: int) -> Burst:
    peer = import_module("pysindy").STLSQ(threshold=THRESHOLD, alpha=1e-10, max_iter=ITERATIONS, unbias=False)
    return lambda: peer.fit(A, Y[:, :outputs]).coef_


def ridge() -> Burst:
    peer = import_module("sklearn.linear_model").Ridge(alpha=1e-10, fit_intercept=False, solver="cholesky")
    return lambda: peer.fit(A, Y).coef_


def lasso(outputs: int) -> Burst:
    peer = import_module("sklearn.linear_model").Lasso(alpha=0.02, fit_intercept=False, precompute=A.T @ A)

    def burst() -> None:
        peer.fit(A, Y[:, :outputs])

    return burst


def thresholded(name: str, start: Callable[[int], Burst], outputs: int, peer: str = "", note: str = "") -> Racer:
    return Racer(
        name=name,
        start=partial(start, outputs),
        units=outputs,
        peer=peer,
        note=f"{note}extrapolated from {outputs} outputs",
        rounds=2,
    )


def main() -> None:
    describe_machine()
    race(
        f"thresholded least squares, {ROWS} x {COLUMNS}: s for {OUTPUTS} outputs",
        [
            Racer(name="fdbench, orthogonal factors", start=ours, units=OUTPUTS, bar=BAR_S),
            thresholded("STLSQ", pysindy, 8, "pysindy"),
            thresholded("NumPy lstsq, output by output", numpy_loop, 4),
            thresholded("Lasso, Gram matrix given", lasso, 20, "scikit-learn", "another estimate, "),
        ],
        scale=OUTPUTS,
        rounds=5,
    )
    race(
        f"least squares without thresholds, {ROWS} x {COLUMNS}: s for {OUTPUTS} outputs",
        [
            Racer(name="fdbench, QR", start=ours_unthresholded, units=OUTPUTS),
            Racer(name="Ridge, normal equations", start=ridge, units=OUTPUTS, peer="scikit-learn"),
            Racer(name="NumPy lstsq", start=lambda: lambda: np.linalg.lstsq(A, Y)[0].T, units=OUTPUTS),
        ],
        scale=OUTPUTS,
        rounds=5,
    )
    scenario = load_scenario("SpindleTestbedRandom-v0")
    record = scenario.record(0)
    if not isinstance(scenario.plant, SpectralPlant):
        raise TypeError("SpindleTestbedRandom-v0 has no spectra.")
    spectra = scenario.plant.spectra(record)
    G, targets = expand(spectra.features, NONLINEAR)[spectra.training], spectra.targets[spectra.training]
    race(
        f"slr_nfb on the spindle testbed, {record.n_samples} samples: s",
        [
            Racer(
                name=f"thresholded least squares, {G.shape[0]} x {G.shape[1]}, {targets.shape[1]} outputs",
                start=lambda: lambda: threshold_sequentially(G, targets, 0.2, ITERATIONS),
                note="most terms kept",
            ),
            Racer(name="simulation of the record", start=lambda: lambda: scenario.record(0)),
        ],
        rounds=2,
        compare=None,
    )


if __name__ == "__main__":
    main()
