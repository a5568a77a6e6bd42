"""CPU time of sequentially thresholded least squares, 2600 x 1001 with 400 outputs, on one thread; the bar is 0.5 s.

The peers solve each output by itself and are timed on a few of them: NumPy's lstsq in a loop, and pysindy where it is
installed. All run in turns in this process; the best time counts. The dense case is LR-NFB of the spindle testbed.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import importlib
import importlib.util
from collections.abc import Callable
from time import process_time

import numpy as np
from fdbench_baselines._function_basis import NONLINEAR, expand
from fdbench_baselines._sparse_regression import FloatArray, threshold_sequentially

from fdbench.plants import SpectralPlant
from fdbench.scenario import load_scenario

ROWS, COLUMNS, OUTPUTS, KEPT = 2600, 1001, 400, 10
THRESHOLD, ITERATIONS = 0.05, 10
ROUNDS = 3
PEER_OUTPUTS = 4
BAR_S = 0.5


def made() -> tuple[FloatArray, FloatArray]:
    """Return white regressors and targets with ten terms each, some of them near the threshold."""
    random = np.random.default_rng(0)
    A = random.standard_normal((ROWS, COLUMNS))
    Z = np.zeros((COLUMNS, OUTPUTS))
    for output in range(OUTPUTS):
        Z[random.choice(COLUMNS, KEPT, replace=False), output] = random.uniform(0.5, 4.0, KEPT) * THRESHOLD
    return A, A @ Z + 0.3 * random.standard_normal((ROWS, OUTPUTS))


def numpy_loop(A: FloatArray, Y: FloatArray) -> FloatArray:
    Z = np.zeros((A.shape[1], Y.shape[1]))
    for output in range(Y.shape[1]):
        support = np.arange(A.shape[1])
        found = np.linalg.lstsq(A, Y[:, output])[0]
        for _ in range(ITERATIONS):
            large = np.abs(found) >= THRESHOLD
            if large.all():
                break
            support = support[large]
            found = np.linalg.lstsq(A[:, support], Y[:, output])[0]
        Z[support, output] = found
    return Z


def pysindy_loop(A: FloatArray, Y: FloatArray) -> FloatArray:
    optimizer = importlib.import_module("pysindy").STLSQ(
        threshold=THRESHOLD, alpha=1e-10, max_iter=ITERATIONS, unbias=False
    )
    return np.asarray(optimizer.fit(A, Y).coef_).T


def best(
    solve: Callable[[FloatArray, FloatArray], FloatArray], A: FloatArray, Y: FloatArray
) -> tuple[float, FloatArray]:
    times = []
    for _ in range(ROUNDS):
        start = process_time()
        found = solve(A, Y)
        times.append(process_time() - start)
    return min(times), found


def ours(A: FloatArray, Y: FloatArray) -> FloatArray:
    return threshold_sequentially(A, Y, THRESHOLD, ITERATIONS).coefficients


def main() -> None:
    A, Y = made()
    ours(A[:, :5], Y[:, :2])  # compiles
    seconds, found = best(ours, A, Y)
    kept = np.mean(np.count_nonzero(found, axis=0))
    print(f"{ROWS} x {COLUMNS}, {OUTPUTS} outputs, {kept:.1f} terms kept; bar {BAR_S} s")
    print(f"{'ours':>8} {seconds:8.2f} s  {'ok' if seconds <= BAR_S else 'TOO SLOW'}")
    peers = {"NumPy": numpy_loop}
    if importlib.util.find_spec("pysindy") is not None:
        peers["pysindy"] = pysindy_loop
    else:
        print(" pysindy  is not installed")
    for name, solve in peers.items():
        time, few = best(solve, A, Y[:, :PEER_OUTPUTS])
        whole = time * OUTPUTS / PEER_OUTPUTS
        difference = np.abs(few - found[:, :PEER_OUTPUTS]).max()
        print(
            f"{name:>8} {whole:8.1f} s  {whole / seconds:5.0f} x, from {PEER_OUTPUTS} outputs, off by {difference:.0e}"
        )
    scenario = load_scenario("SpindleTestbedRandom-v0")
    start = process_time()
    record = scenario.record(0)
    print(f"spindle testbed, record of {record.n_samples} samples: {process_time() - start:.2f} s")
    if isinstance(scenario.plant, SpectralPlant):
        spectra = scenario.plant.spectra(record)
        G = expand(spectra.features, NONLINEAR)[spectra.training]
        start = process_time()
        solves = threshold_sequentially(G, spectra.targets[spectra.training], 0.2, ITERATIONS).solves
        print(f"{G.shape[0]} x {G.shape[1]}, 200 outputs, {solves.mean():.1f} solves: {process_time() - start:.2f} s")


if __name__ == "__main__":
    main()
