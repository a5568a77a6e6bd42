"""A locally periodic Gaussian process in state space, filter and smoother, beside celerite2 and a dense solution.

The process is the one that celerite2 has as well: harmonics with an exponential envelope. What is compared is the mean
of the force given all samples, hyperparameters given, and their likelihood. celerite2 gives no variance in O(n), and
takes cosines of the time anew with each kernel. Here a search takes them once, unless "and cosines" is said.
"""

from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines._locally_periodic_force import posterior, smoothed
from fdbench_baselines._locally_periodic_states import (
    Amplitudes,
    LikeliestProcess,
    NoisyRows,
    designs,
    filtered,
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


def process(time_s: FloatArray, harmonics: int) -> tuple[Amplitudes, Transition]:
    design = designs(2.0 * np.pi * FREQUENCY_HZ * time_s, harmonics, None, True)[0]
    return design, transitions(design, 1.0 / SAMPLES_PER_S, PLACE)


def rows_of(y: FloatArray) -> NoisyRows:
    return NoisyRows(y[:, None], np.ones(len(y)), np.zeros(len(y), np.bool_))


def mean(n: int, harmonics: int) -> Burst:
    time_s, y = data(n)
    rows, (design, move) = rows_of(y), process(time_s, harmonics)
    return lambda: smoothed(rows, design, move, filtered(rows, design, move))[:, 0]


def mean_and_cosines(n: int, harmonics: int) -> Burst:
    time_s, y = data(n)
    rows = rows_of(y)

    def burst() -> FloatArray:
        design, move = process(time_s, harmonics)
        return smoothed(rows, design, move, filtered(rows, design, move))[:, 0]

    return burst


def mean_and_variance(n: int, harmonics: int) -> Burst:
    time_s, y = data(n)
    design, move = process(time_s, harmonics)
    ours = LikeliestProcess(design, move, np.ones(n), np.zeros(n, np.bool_), 1.0, 0.0)
    return lambda: posterior(ours, y, np.empty((n, 0)), EMPTY, 1.0 / SAMPLES_PER_S, False).force


def likelihood(n: int, harmonics: int) -> Burst:
    """At the deviation of the noise that is likeliest, as a search needs it."""
    time_s, y = data(n)
    rows, (design, move) = rows_of(y), process(time_s, harmonics)

    def burst() -> FloatArray:
        value, s2 = restricted(rows, design, move)
        return np.array([value + 0.5 * n * (np.log(s2) - s2 - np.log(2.0 * np.pi))])

    return burst


def celerite2_process(time_s: FloatArray, harmonics: int) -> Any:
    module = import_module("celerite2")
    variance = process(time_s, harmonics)[1].P[:, 0, 0]
    kernel = module.terms.RealTerm(a=variance[0], c=1.0)
    for j in range(1, harmonics + 1):
        kernel += module.terms.ComplexTerm(a=variance[2 * j], b=0.0, c=1.0, d=2.0 * np.pi * j * FREQUENCY_HZ)
    return module.GaussianProcess(kernel)


def celerite2_likelihood(n: int, harmonics: int) -> Burst:
    time_s, y = data(n)
    peer = celerite2_process(time_s, harmonics)

    def burst() -> FloatArray:
        peer.compute(time_s, diag=np.ones(n))
        return np.array([peer.log_likelihood(y)])

    return burst


def celerite2_mean(n: int, harmonics: int) -> Burst:
    time_s, y = data(n)
    peer = celerite2_process(time_s, harmonics)

    def burst() -> FloatArray:
        peer.compute(time_s, diag=np.ones(n))
        return np.asarray(y - peer.apply_inverse(y))

    return burst


def dense(n: int, harmonics: int) -> Burst:
    time_s, y = data(n)
    design, move = process(time_s, harmonics)

    def burst() -> FloatArray:
        K = (design.H * move.P[:, 0, 0]) @ design.H.T * np.exp(-np.abs(time_s[:, None] - time_s))
        K[np.diag_indices(n)] += 1.0
        return np.asarray(y - cho_solve(cho_factor(K, lower=True), y))

    return burst


def main() -> None:
    describe_machine()
    for n, harmonics, rounds in ((4000, 1, 15), (4000, 3, 15), (10**6, 1, 3)):
        title = f"Gaussian process of {harmonics} harmonics and a level, {n} samples: ns a sample"
        means = [
            Racer(name="fdbench, mean", start=partial(mean, n, harmonics), units=n),
            Racer(
                name="fdbench, mean and variance", start=partial(mean_and_variance, n, harmonics), units=n, bar=1000.0
            ),
            Racer(name="fdbench, mean and cosines", start=partial(mean_and_cosines, n, harmonics), units=n),
            Racer(name="mean", start=partial(celerite2_mean, n, harmonics), units=n, peer="celerite2"),
        ]
        if n < 10**5:
            means.append(Racer(name="SciPy cho_factor, mean", start=partial(dense, n, harmonics), units=n, rounds=3))
        race(title, means, scale=1e9, rounds=rounds)
        likelihoods = [
            Racer(name="fdbench, likelihood", start=partial(likelihood, n, harmonics), units=n),
            Racer(name="likelihood", start=partial(celerite2_likelihood, n, harmonics), units=n, peer="celerite2"),
        ]
        race("The same", likelihoods, scale=1e9, rounds=rounds)


if __name__ == "__main__":
    main()
