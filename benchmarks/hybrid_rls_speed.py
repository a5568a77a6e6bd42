"""CPU time of recursive least squares for each sample, on one thread, with 55 regressors.

The twins are the published recursions in plain NumPy. Bursts of both take turns; the best counts. A burst of the hybrid
model is three batches of 100 samples, each with one solution of the normal equations.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from collections.abc import Callable, Iterator
from itertools import islice
from time import process_time

import numpy as np
from fdbench_baselines._recursive_least_squares import FloatArray, predict, rls, untrained

LAGS, ERRORS, BATCH = 3, 50, 100
N = 2 + LAGS + ERRORS
BURSTS = 60
SAMPLES = 300  # in a burst
LAM, DELTA = 0.999, 1e4


def plain_rls(X: FloatArray, y: FloatArray) -> Iterator[float]:
    """Yield the error of each prediction."""
    theta, P = np.zeros(N), DELTA * np.eye(N)
    for x, target in zip(X, y, strict=True):
        g = P @ x
        power = LAM + x @ g
        error = target - x @ theta
        theta += g * (error / power)
        g /= np.sqrt(power)  # an outer product of one vector is symmetric to the last bit, as P has to stay
        P -= np.outer(g, g)
        P /= LAM
        yield float(error)


def plain_hybrid(response: FloatArray, error: FloatArray) -> Iterator[float]:
    """Yield the predicted error of each sample."""
    A, b, w = np.eye(N), np.zeros(N), np.zeros(N)
    measured = np.zeros(N)
    measured[0] = 1.0
    predicted = measured.copy()
    first = 2 + LAGS
    for k, (x, e) in enumerate(zip(response, error, strict=True)):
        if k % BATCH == 0:
            w = np.linalg.solve(A, b)
            predicted[first:] = measured[first:]
        measured[2:first] = measured[1 : first - 1].copy()
        measured[1] = x
        predicted[1:first] = measured[1:first]
        estimate = float(w @ predicted)
        A += np.outer(measured, measured)
        b += measured * e
        for features, newest in ((measured, e), (predicted, estimate)):
            features[first + 1 :] = features[first:-1].copy()
            features[first] = newest
        yield estimate


def race(name: str, compiled: Callable[[slice], FloatArray], plain: Iterator[float]) -> None:
    times: dict[str, list[float]] = {"compiled": [], "NumPy": []}
    worst = 0.0
    for start in range(0, BURSTS * SAMPLES, SAMPLES):
        t0 = process_time()
        found = compiled(slice(start, start + SAMPLES))
        t1 = process_time()
        expected = list(islice(plain, SAMPLES))
        t2 = process_time()
        worst = max(worst, float(np.abs(found - expected).max()))
        times["compiled"].append((t1 - t0) / SAMPLES)
        times["NumPy"].append((t2 - t1) / SAMPLES)
    fast, slow = (1e6 * min(values) for values in times.values())
    print(f"{name:24s} {fast:19.2f} {slow:16.1f} {slow / fast:6.0f} {worst:19.1e}")


def main() -> None:
    rng = np.random.default_rng(0)
    n = BURSTS * SAMPLES
    X, y = rng.standard_normal((n, N)), rng.standard_normal(n)
    theta, P = np.zeros(N), DELTA * np.eye(N)
    response = np.cumsum(rng.standard_normal(n)) * 0.01
    error = np.convolve(rng.standard_normal(n), np.exp(-0.05 * np.arange(100)), "same") * 0.01
    state = untrained(LAGS, ERRORS, 1.0)
    rls(theta.copy(), P.copy(), X[:2], y[:2], LAM)
    predict(untrained(LAGS, ERRORS, 1.0), response[:2], error[:2], LAGS, BATCH)
    print("recursion                compiled us/sample  NumPy us/sample  ratio  largest difference")
    race("RLS with forgetting", lambda part: rls(theta, P, X[part], y[part], LAM), plain_rls(X, y))
    race(
        "hybrid model in batches",
        lambda part: predict(state, response[part], error[part], LAGS, BATCH),
        plain_hybrid(response, error),
    )


if __name__ == "__main__":
    main()
