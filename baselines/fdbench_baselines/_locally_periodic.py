"""The locally periodic kernel, and the system of equations that it makes on a clock."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.errors import FdbenchError
from fdbench_baselines._toeplitz import Cholesky, Toeplitz

FloatArray = NDArray[np.float64]

DENSE_LIMIT = 20_000
UNIFORM_GRID_TOLERANCE = 1e-6

System = Toeplitz | Cholesky


class Kernel(NamedTuple):
    """Hyperparameters as `kernel_system` takes them; an infinite period and width leave the envelope alone."""

    sigma_1_s: float
    sigma_2: float
    gamma: float
    period_s: float


def locally_periodic(lag_s: FloatArray, sigma_1_s: float, sigma_2: float, period_s: float) -> FloatArray:
    r"""Kernel of a periodic signal whose shape drifts, equal to 1 at lag zero.

    .. math:: K(\tau) = e^{-\tau^2 / 2 \sigma_1^2} e^{-\sin^2(\pi \tau / \psi) / 2 \sigma_2^2}

    McPherson, thesis, 2024, eq. 2.11, with the square on the sine and the pi that make it positive definite and of
    period psi.

    >>> float(locally_periodic(np.array([0.0]), 0.59, 0.42, 0.02)[0])
    1.0
    """
    sine = np.sin(np.pi * lag_s / period_s)
    return np.asarray(np.exp(-0.5 * (lag_s / sigma_1_s) ** 2 - 0.5 * (sine / sigma_2) ** 2), dtype=np.float64)


@kept
@njit(error_model="numpy")
def _fill_lower(
    matrix: FloatArray,
    time: FloatArray,
    sine: FloatArray,
    cosine: FloatArray,
    decay: float,
    sharpness: float,
) -> None:
    for j in range(len(time)):
        for i in range(j, len(time)):
            tau = time[i] - time[j]
            s = sine[i] * cosine[j] - cosine[i] * sine[j]
            matrix[i, j] = np.exp(-decay * tau * tau - sharpness * s * s)


def is_uniform(time_s: FloatArray) -> bool:
    """Return whether a clock keeps its step to 1e-6 of it."""
    grid_s = np.linspace(time_s[0], time_s[-1], len(time_s))
    return bool(np.max(np.abs(time_s - grid_s)) <= UNIFORM_GRID_TOLERANCE * (grid_s[1] - grid_s[0]))


def kernel_system(time_s: FloatArray, sigma_1_s: float, sigma_2: float, gamma: float, period_s: float) -> System:
    """Return K + I / gamma at the given times: from one column if the clock is uniform to 1e-6 of a step, else dense.

    Raises
    ------
    FdbenchError
        If the clock is not uniform and longer than ``DENSE_LIMIT``.
    """
    n = len(time_s)
    elapsed_s = time_s - time_s[0]
    if is_uniform(time_s):
        grid_s = elapsed_s[-1] / (n - 1) * np.arange(n)
        column = locally_periodic(grid_s, sigma_1_s, sigma_2, period_s)
        column[0] += 1.0 / gamma
        return Toeplitz(column)
    if n > DENSE_LIMIT:
        raise FdbenchError(
            f"pl_lssvm: {n} rows on a clock that is not uniform, at most {DENSE_LIMIT} are possible. "
            "Resample the record or split it."
        )
    matrix = np.zeros((n, n), order="F")
    angle = np.pi * elapsed_s / period_s
    _fill_lower(matrix, elapsed_s, np.sin(angle), np.cos(angle), 0.5 / sigma_1_s**2, 0.5 / sigma_2**2)
    matrix[np.diag_indices(n)] += 1.0 / gamma
    return Cholesky(matrix, overwrite=True)
