"""A locally periodic Gaussian process in state space, filter and smoother, beside celerite2 and a dense solution.

The process is the one that celerite2 has as well: harmonics with an exponential envelope. What is compared is the mean
of the force given all samples, hyperparameters given; celerite2 gives no variance on the way.
"""

from functools import partial
from importlib import import_module

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines._locally_periodic_states import (
    Amplitudes,
    LikeliestProcess,
    NoisyRows,
    designs,
    posterior,
    restricted,
    transitions,
)
from fdbench_baselines._state_space_gp import Transition
from scipy.linalg import cho_factor, cho_solve

from fdbench.estimator import FloatArray

SAMPLES_PER_S, FREQUENCY_HZ = 333.0, 55.0
PLACE = np.array([1.0, 0.0, 0.0, -1.0, 0.0, 0.0])
EMPTY = np.empty((0, 0))


def data(n: int) -> tuple[FloatArray, FloatArray]:
    """Return time and a disturbance of 55 Hz under noise."""
    time_s = np.arange(n) / SAMPLES_PER_S
    return time_s, 2.0 * np.cos(2.0 * np.pi * FREQUENCY_HZ * time_s) + np.random.default_rng(0).standard_normal(n)


def process(n: int, harmonics: int) -> tuple[Amplitudes, Transition]:
    design = designs(2.0 * np.pi * FREQUENCY_HZ * data(n)[0], harmonics, None, True)[0]
    return design, transitions(design, 1.0 / SAMPLES_PER_S, PLACE)


def smoothed(n: int, harmonics: int) -> Burst:
    design, move = process(n, harmonics)
    ours = LikeliestProcess(design, move, np.ones(n), np.zeros(n, np.bool_), 1.0, 0.0)
    y = data(n)[1]
    return lambda: posterior(ours, y, np.empty((n, 0)), EMPTY, 1.0 / SAMPLES_PER_S, False).force


def likelihood(n: int, harmonics: int) -> Burst:
    design, move = process(n, harmonics)
    rows = NoisyRows(data(n)[1][:, None], np.ones(n), np.zeros(n, np.bool_))

    def burst() -> None:
        restricted(rows, design, move)

    return burst


def celerite2(n: int, harmonics: int) -> Burst:
    module = import_module("celerite2")
    time_s, y = data(n)
    variance = process(n, harmonics)[1].P[:, 0, 0]
    kernel = module.terms.RealTerm(a=variance[0], c=1.0)
    for j in range(1, harmonics + 1):
        kernel += module.terms.ComplexTerm(a=variance[2 * j], b=0.0, c=1.0, d=2.0 * np.pi * j * FREQUENCY_HZ)
    peer = module.GaussianProcess(kernel)

    def burst() -> FloatArray:
        peer.compute(time_s, diag=np.ones(n))
        return np.asarray(y - peer.apply_inverse(y))

    return burst


def dense(n: int, harmonics: int) -> Burst:
    time_s, y = data(n)
    design, move = process(n, harmonics)

    def burst() -> FloatArray:
        K = (design.H * move.P[:, 0, 0]) @ design.H.T * np.exp(-np.abs(time_s[:, None] - time_s))
        K[np.diag_indices(n)] += 1.0
        return np.asarray(y - cho_solve(cho_factor(K, lower=True), y))

    return burst


def main() -> None:
    describe_machine()
    for harmonics in (1, 3):
        race(
            f"Gaussian process of {harmonics} harmonics and a level, 4000 samples: ns a sample",
            [
                Racer(name="fdbench, mean and variance", start=partial(smoothed, 4000, harmonics), units=4000),
                Racer(name="fdbench, likelihood", start=partial(likelihood, 4000, harmonics), units=4000),
                Racer(name="mean", start=partial(celerite2, 4000, harmonics), units=4000, peer="celerite2"),
                Racer(name="SciPy cho_factor, mean", start=partial(dense, 4000, harmonics), units=4000, rounds=3),
            ],
            scale=1e9,
        )
    race(
        "The same, one harmonic, a million samples: ns a sample",
        [
            Racer(name="fdbench, mean and variance", start=partial(smoothed, 10**6, 1), units=10**6, bar=1000.0),
            Racer(name="mean", start=partial(celerite2, 10**6, 1), units=10**6, peer="celerite2"),
        ],
        scale=1e9,
        rounds=3,
    )


if __name__ == "__main__":
    main()
