"""CPU time of KRLS-T for each sample, predicted and taken in with a full dictionary, on one thread.

The twin is the published recursion, in mu, Sigma and Q, in plain NumPy. Bursts of both take turns; the best counts.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from collections.abc import Iterator
from itertools import islice
from time import process_time

import numpy as np
from fdbench_baselines._krls_t_recursion import FloatArray, empty_tracker, track

BUDGETS = (30, 50, 100, 200)
BURSTS = 30
SAMPLES = 300  # in a burst
S2, LAM, JITTER = 0.01, 0.999, 1e-6


def published(x: FloatArray, y: FloatArray, budget: int) -> Iterator[float]:
    """Yield the prediction of each sample; K is kept, so that a step costs one kernel column."""
    kxx = 1.0 + JITTER
    members, K, Q = x[:0], np.empty((0, 0)), np.empty((0, 0))
    mu, sigma = np.empty(0), np.empty((0, 0))
    for row, target in zip(x, y, strict=True):
        k = np.exp(-0.5 * ((members - row) ** 2).sum(axis=1))
        q = Q @ k
        g2 = kxx - k @ q
        yield float(q @ mu)
        mu, sigma = np.sqrt(LAM) * mu, LAM * sigma + (1.0 - LAM) * K
        h = sigma @ q
        sf2 = g2 + q @ h
        grown, direction = np.append(h, sf2), np.append(q, -1.0)
        mu = np.append(mu, q @ mu) + (target - q @ mu) / (S2 + sf2) * grown
        sigma = np.block([[sigma, h[:, None]], [grown]]) - np.outer(grown, grown) / (S2 + sf2)
        Q = np.pad(Q, (0, 1)) + np.outer(direction, direction) / g2
        K = np.block([[K, k[:, None]], [np.append(k, kxx)]])
        members = np.vstack((members, row))
        if len(members) > budget:
            i = int(np.argmin(np.abs(Q @ mu / np.diag(Q))))
            rest = np.delete(np.arange(budget + 1), i)
            Q = Q[np.ix_(rest, rest)] - np.outer(Q[rest, i], Q[rest, i]) / Q[i, i]
            K, sigma, mu, members = K[np.ix_(rest, rest)], sigma[np.ix_(rest, rest)], mu[rest], members[rest]


def main() -> None:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((max(BUDGETS) + BURSTS * SAMPLES, 3))
    y = np.sin(x).sum(axis=1) + 0.1 * rng.standard_normal(len(x))
    print("budget  compiled us/sample  NumPy us/sample  ratio  largest difference")
    for budget in BUDGETS:
        tracker, twin = empty_tracker(3, budget), published(x, y, budget)
        times: dict[str, list[float]] = {"compiled": [], "NumPy": []}
        worst = 0.0
        for start in range(0, len(x), SAMPLES):
            burst = slice(start, start + SAMPLES)
            t0 = process_time()
            predictions, _ = track(tracker, x[burst], y[burst], S2, LAM, JITTER, False)
            t1 = process_time()
            expected = list(islice(twin, len(predictions)))
            t2 = process_time()
            worst = max(worst, float(np.abs(predictions[:, 0] - expected).max()))
            if start > budget:
                times["compiled"].append((t1 - t0) / len(expected))
                times["NumPy"].append((t2 - t1) / len(expected))
        compiled, plain = (1e6 * min(values) for values in times.values())
        print(f"{budget:6d} {compiled:19.2f} {plain:16.0f} {plain / compiled:6.0f} {worst:19.1e}")


if __name__ == "__main__":
    main()
