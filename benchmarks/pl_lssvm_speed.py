"""CPU time and memory of a PL-LSSVM fit: Toeplitz against dense Cholesky and, if it is installed, scikit-learn.

One fit is the kernel, bias and four regressors solved for theta and alpha; one thread, a fresh process for each row.
Extra memory is the rise of the process's peak during the fits, with data and libraries loaded before.

Run: python benchmarks/pl_lssvm_speed.py
"""

import importlib.util
import multiprocessing
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from fdbench_baselines._toeplitz import LEVINSON_LIMIT, conjugate_gradients
from fdbench_baselines.pl_lssvm import kernel_system, locally_periodic, partially_linear
from scipy.linalg import lapack, toeplitz

from fdbench.estimator import FloatArray

SAMPLING_TIME_S = 1.0 / 333.0
KERNEL = (0.59, 0.42, 50.3, 1.0 / 55.0)
ROWS = [
    ("Toeplitz", 2000, 9),
    ("Toeplitz", 4000, 9),
    ("Toeplitz", 8000, 5),
    ("Toeplitz", 32000, 3),
    ("Toeplitz", 128000, 3),
    ("dense", 2000, 5),
    ("dense", 4000, 3),
    ("dpotrf", 2000, 5),
    ("dpotrf", 4000, 3),
    ("scikit-learn", 2000, 3),
    ("scikit-learn", 4000, 1),
]


def data(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, basis [1 Z] and target of a drive in steps under a 55 Hz disturbance."""
    random = np.random.default_rng(0)
    time_s = SAMPLING_TIME_S * np.arange(n)
    reference = np.repeat(random.uniform(-0.1, 0.1, n // 200 + 1), 200)[:n]
    reference[: n // 10] = 0.0
    measured = np.concatenate(([0.0], reference[:-1])) + 1e-3 * random.standard_normal(n)
    basis = np.column_stack((np.ones(n), reference, measured, -1.0 * (reference > 0), 1.0 * (reference < 0)))
    disturbance = 2e-4 * np.cos(2.0 * np.pi * 55.0 * time_s)
    return time_s, basis, basis @ [0, 0.8335, 0.1632, 1e-4, 1e-4] + disturbance + 2e-5 * random.standard_normal(n)


def off_grid(time_s: FloatArray) -> FloatArray:
    """Return a clock that is just not uniform, so that the dense path is taken."""
    return time_s + 1e-5 * SAMPLING_TIME_S * np.random.default_rng(1).uniform(-1.0, 1.0, len(time_s))


def column(time_s: FloatArray) -> FloatArray:
    """Return the first column of K + I / gamma."""
    sigma_1_s, sigma_2, gamma, period_s = KERNEL
    values = locally_periodic(time_s, sigma_1_s, sigma_2, period_s)
    values[0] += 1.0 / gamma
    return values


def job(method: str, n: int) -> tuple[Callable[[], object], str]:
    """Return what is timed, and a note; what is not part of a fit is prepared beforehand."""
    time_s, basis, target = data(n)
    if method == "Toeplitz":
        note = "Levinson" if n <= LEVINSON_LIMIT else "conjugate gradients"
        return lambda: partially_linear(kernel_system(time_s, *KERNEL), basis, target), note
    if method == "dense":
        clock = off_grid(time_s)
        return lambda: partially_linear(kernel_system(clock, *KERNEL), basis, target), "kernel, Cholesky, solve"
    if method == "dpotrf":
        matrix = np.asfortranarray(toeplitz(column(time_s)))
        return lambda: lapack.dpotrf(matrix, lower=True, clean=False), "Cholesky alone, with a copy of the matrix"
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, DotProduct, ExpSineSquared

    sigma_1_s, sigma_2, gamma, period_s = KERNEL
    kernel = ExpSineSquared(2.0 * sigma_2, period_s) * RBF(sigma_1_s) + DotProduct(1.0)
    peer = GaussianProcessRegressor(kernel, alpha=1.0 / gamma, optimizer=None)
    return lambda: peer.fit(time_s[:, None], target), "GaussianProcessRegressor of time alone, fixed hyperparameters"


def measure(method: str, n: int, repeats: int) -> tuple[float, float, str]:
    """Return CPU seconds (median, after a warm-up on a small problem), extra memory in MB and a note."""
    job(method, 300)[0]()
    run, note = job(method, n)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    seconds = []
    for _ in range(repeats):
        started = time.process_time()
        run()
        seconds.append(time.process_time() - started)
    unit = 1e6 if sys.platform == "darwin" else 1e3
    extra = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / unit
    if note == "conjugate gradients":
        time_s, basis, _ = data(n)
        note += f", {conjugate_gradients(column(time_s), basis)[1]} iterations"
    return statistics.median(seconds), extra, note


def main() -> None:
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    base: dict[int, float] = {}
    print(f"{'method':14}{'N':>8}{'CPU s':>10}{'x Toeplitz':>12}{'extra MB':>10}  note")
    for method, n, repeats in ROWS:
        if method == "scikit-learn" and importlib.util.find_spec("sklearn") is None:
            print(f"{method:14}{n:8}  absent: install the peers extra")
            continue
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            seconds, extra, note = pool.apply(measure, (method, n, repeats))
        if method == "Toeplitz":
            base[n] = seconds
        print(f"{method:14}{n:8}{seconds:10.4f}{seconds / base[n]:12.1f}{extra:10.1f}  {note}", flush=True)


if __name__ == "__main__":
    main()
