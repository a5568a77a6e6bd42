"""A sample of KRLS-T, predicted and taken in with a full dictionary, beside the package krls.

All take in one stream of samples; what is compared is each prediction before its sample is taken in. The NumPy loop is
the published recursion in mu, Sigma and Q. The class KRLS_T of krls 0.0.4 keeps a sample only if it is far from the
dictionary by a limit made of the forgetting factor, so that its predictions are others. It needs torch and is therefore
no part of the extra.
"""

from collections.abc import Iterator
from functools import partial
from importlib import import_module

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines._krls_t_recursion import FloatArray, empty_tracker, track

BUDGETS = (30, 50, 100, 200)
ROUNDS, SAMPLES = 20, 300
BARS_US = {100: 6.0}
S2, LAM, JITTER = 0.01, 0.999, 1e-6

RANDOM = np.random.default_rng(0)
X = RANDOM.standard_normal((max(BUDGETS) + (ROUNDS + 1) * SAMPLES, 3))
Y = np.sin(X).sum(axis=1) + 0.1 * RANDOM.standard_normal(len(X))


def ours(budget: int) -> Burst:
    tracker = empty_tracker(3, budget)
    track(tracker, X[:budget], Y[:budget], S2, LAM, JITTER, False)
    starts = iter(range(budget, len(X), SAMPLES))

    def burst() -> FloatArray:
        start = next(starts)
        part = slice(start, start + SAMPLES)
        predictions: FloatArray = track(tracker, X[part], Y[part], S2, LAM, JITTER, False)[0][:, 0]
        return predictions

    return burst


def numpy_loop(budget: int) -> Burst:
    def predictions() -> Iterator[float]:
        kxx = 1.0 + JITTER
        members, K, Q = X[:0], np.empty((0, 0)), np.empty((0, 0))
        mu, sigma = np.empty(0), np.empty((0, 0))
        for row, target in zip(X, Y, strict=True):
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

    running = predictions()
    np.fromiter(running, np.float64, budget)
    return lambda: np.fromiter(running, np.float64, SAMPLES)


def krls(budget: int) -> Burst:
    settings = {"N": budget, "c": JITTER, "gamma": LAM, "sn2": S2, "kernel_type": "Gaussian", "sigma": 1.0}
    peer = import_module("krls.krls").KRLS_T(**settings)
    peer.fit(X[:budget], Y[:budget])
    starts = iter(range(budget, len(X), SAMPLES))

    def burst() -> FloatArray:
        found, start = np.empty(SAMPLES), next(starts)
        for k in range(SAMPLES):
            row = slice(start + k, start + k + 1)
            found[k] = peer.predict(X[row])[0]
            peer.evolve(X[row], Y[row])
        return found

    return burst


def main() -> None:
    describe_machine()
    for budget in BUDGETS:
        race(
            f"KRLS-T, dictionary of {budget}: us a sample",
            [
                Racer(name="fdbench", start=partial(ours, budget), units=SAMPLES, bar=BARS_US.get(budget, np.inf)),
                Racer(
                    name="KRLS_T, predict and evolve",
                    start=partial(krls, budget),
                    units=SAMPLES,
                    peer="krls",
                    install="pip install krls (with torch, 5 GB)",
                    rounds=5,
                    note="keeps other samples",
                ),
                Racer(name="NumPy loop", start=partial(numpy_loop, budget), units=SAMPLES, rounds=10),
            ],
            scale=1e6,
            rounds=ROUNDS,
        )


if __name__ == "__main__":
    main()
