"""A PL-LSSVM fit, [1 Z] and a locally periodic kernel, beside scikit-learn, tinygp and celerite2.

Gaussian-process packages have no partially linear model, but they solve with K + I / gamma, which is all that it needs:
each solves for target and basis, and generalised least squares follows. What is compared is alpha. celerite2 knows
only kernels with an exponential envelope, so it is measured on such a one, which our Toeplitz solver takes as well.
"""

import tracemalloc
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines._locally_periodic import Kernel, kernel_system, locally_periodic
from fdbench_baselines._restricted_likelihood import likeliest_kernel, nearby_kernel
from fdbench_baselines._toeplitz import Toeplitz
from fdbench_baselines.pl_lssvm import partially_linear
from scipy.linalg import cho_factor, cho_solve, lapack, toeplitz
from scipy.special import ive

from fdbench.estimator import FloatArray

SAMPLES_PER_S = 333.0
SIGMA_1_S, SIGMA_2, GAMMA, PERIOD_S = KERNEL = (0.59, 0.42, 50.3, 1.0 / 55.0)
HARMONICS = 6


def data(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, basis [1 Z] and target of a drive in steps under a 55 Hz disturbance."""
    random = np.random.default_rng(0)
    time_s = np.arange(n) / SAMPLES_PER_S
    reference = np.repeat(random.uniform(-0.1, 0.1, n // 200 + 1), 200)[:n]
    reference[: n // 10] = 0.0
    measured = np.concatenate(([0.0], reference[:-1])) + 1e-3 * random.standard_normal(n)
    basis = np.column_stack((np.ones(n), reference, measured, -1.0 * (reference > 0), 1.0 * (reference < 0)))
    disturbance = 2e-4 * np.cos(2.0 * np.pi * 55.0 * time_s)
    target = basis @ [0, 0.8335, 0.1632, 1e-4, 1e-4] + disturbance + 2e-5 * random.standard_normal(n)
    return time_s, basis, np.asarray(target)


def column(time_s: FloatArray) -> FloatArray:
    """Return the first column of K + I / gamma."""
    values = locally_periodic(time_s, SIGMA_1_S, SIGMA_2, PERIOD_S)
    values[0] += 1.0 / GAMMA
    return values


def generalised(solve: Callable[[FloatArray], FloatArray], basis: FloatArray, target: FloatArray) -> FloatArray:
    """Return alpha by solutions for the target's residual and the basis."""
    residual = target - basis @ np.linalg.lstsq(basis, target)[0]
    solutions = solve(np.column_stack((residual, basis)))
    weighted = solutions[:, 1:]
    alpha: FloatArray = solutions[:, 0] - weighted @ np.linalg.solve(weighted.T @ basis, weighted.T @ residual)
    return alpha


def ours(n: int) -> Burst:
    time_s, basis, target = data(n)
    return lambda: partially_linear(kernel_system(time_s, *KERNEL), basis, target).alpha


def ours_free(n: int) -> Burst:
    """Return the burst with all four hyperparameters free, the period 5 Hz off at first."""
    time_s, basis, target = data(n)
    nominal = Kernel(SIGMA_1_S, SIGMA_2, GAMMA, 1.0 / 50.0)

    def burst() -> None:
        kernel = likeliest_kernel(time_s, basis, target, nearby_kernel(time_s, basis, target, nominal))
        partially_linear(kernel_system(time_s, *kernel), basis, target)

    return burst


def ours_dense(n: int) -> Burst:
    """Return the burst on a clock that is just not uniform, so that the dense path is taken."""
    time_s, basis, target = data(n)
    time_s = time_s + 2e-6 / SAMPLES_PER_S * np.random.default_rng(1).uniform(-1.0, 1.0, n)
    return lambda: partially_linear(kernel_system(time_s, *KERNEL), basis, target).alpha


def numpy_dense(n: int) -> Burst:
    time_s, basis, target = data(n)

    def burst() -> FloatArray:
        matrix = locally_periodic(time_s[:, None] - time_s, SIGMA_1_S, SIGMA_2, PERIOD_S)
        matrix[np.diag_indices(n)] += 1.0 / GAMMA
        return generalised(partial(cho_solve, cho_factor(matrix, lower=True)), basis, target)

    return burst


def dpotrf(n: int) -> Burst:
    matrix = np.asfortranarray(toeplitz(column(data(n)[0])))

    def burst() -> None:
        lapack.dpotrf(matrix, lower=True, clean=False)

    return burst


def scikit_learn(n: int) -> Burst:
    module = import_module("sklearn.gaussian_process")
    kernels = import_module("sklearn.gaussian_process.kernels")
    kernel = kernels.ExpSineSquared(2.0 * SIGMA_2, PERIOD_S) * kernels.RBF(SIGMA_1_S)
    peer = module.GaussianProcessRegressor(kernel, alpha=1.0 / GAMMA, optimizer=None)
    time_s, basis, target = data(n)
    return lambda: generalised(lambda B: peer.fit(time_s[:, None], B).alpha_, basis, target)


def tinygp(n: int) -> Burst:
    module, jax = import_module("tinygp"), import_module("jax")
    time_s, basis, target = data(n)
    kernel = module.kernels.ExpSineSquared(PERIOD_S, gamma=0.5 / SIGMA_2**2) * module.kernels.ExpSquared(SIGMA_1_S)

    def solve(B: FloatArray) -> Any:
        solver = module.GaussianProcess(kernel, time_s, diag=1.0 / GAMMA).solver
        return solver.solve_triangular(solver.solve_triangular(B), transpose=True)

    compiled = jax.jit(solve)
    return lambda: generalised(lambda B: np.asarray(compiled(B)), basis, target)


def weights() -> FloatArray:
    """Return the Fourier coefficients of the kernel within a period."""
    return np.asarray(ive(np.arange(HARMONICS + 1), 0.25 / SIGMA_2**2) * np.append(1.0, np.full(HARMONICS, 2.0)))


def ours_exponential(n: int) -> Burst:
    time_s, basis, target = data(n)

    def burst() -> FloatArray:
        angles = np.outer(2.0 * np.pi / PERIOD_S * np.arange(HARMONICS + 1), time_s)
        values = np.exp(-time_s / SIGMA_1_S) * (weights() @ np.cos(angles))
        values[0] += 1.0 / GAMMA
        return partially_linear(Toeplitz(values), basis, target).alpha

    return burst


def celerite2(n: int) -> Burst:
    module = import_module("celerite2")
    time_s, basis, target = data(n)
    first, *rest = weights()
    kernel = module.terms.RealTerm(a=first, c=1.0 / SIGMA_1_S)
    for j, a in enumerate(rest, 1):
        kernel += module.terms.ComplexTerm(a=a, b=0.0, c=1.0 / SIGMA_1_S, d=2.0 * np.pi * j / PERIOD_S)
    peer = module.GaussianProcess(kernel)

    def burst() -> FloatArray:
        peer.compute(time_s, diag=np.full(n, 1.0 / GAMMA))
        return generalised(peer.apply_inverse, basis, target)

    return burst


def memory_MB(n: int) -> float:
    """Return the most that one fit holds beyond its data."""
    burst = ours(n)
    tracemalloc.start()
    burst()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def main() -> None:
    describe_machine()
    for n, rounds in ((1000, 9), (4000, 3)):
        race(
            f"PL-LSSVM, {n} samples: ms",
            [
                Racer(name="fdbench, uniform clock", start=partial(ours, n)),
                Racer(name="fdbench, hyperparameters free", start=partial(ours_free, n), note="about 70 likelihoods"),
                Racer(name="fdbench, any clock", start=partial(ours_dense, n), note="clock off by 2e-6 of a step"),
                Racer(name="GaussianProcess, jit", start=partial(tinygp, n), peer="tinygp"),
                Racer(name="GaussianProcessRegressor", start=partial(scikit_learn, n), peer="scikit-learn"),
                Racer(name="NumPy kernel, SciPy cho_factor", start=partial(numpy_dense, n)),
                Racer(name="dpotrf alone, of the whole matrix", start=partial(dpotrf, n)),
            ],
            scale=1e3,
            rounds=rounds,
        )
    for n in (4000, 32000):
        race(
            f"PL-LSSVM with an exponential envelope, {n} samples: ms",
            [
                Racer(name="fdbench, uniform clock", start=partial(ours_exponential, n)),
                Racer(name="GaussianProcess", start=partial(celerite2, n), peer="celerite2"),
            ],
            scale=1e3,
            rounds=3,
        )
    race(
        "PL-LSSVM, longer than any matrix: ms",
        [Racer(name=f"fdbench, {n} samples", start=partial(ours, n)) for n in (32000, 128000)],
        scale=1e3,
        rounds=3,
        compare=None,
    )
    print(f"one fit of 128000 samples holds {memory_MB(128000):.0f} MB")


if __name__ == "__main__":
    main()
