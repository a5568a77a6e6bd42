"""Rows that stand out, such as those of held samples, made to count less or left out."""

import numpy as np
from numpy.typing import NDArray

from fdbench.estimator import FloatArray

DEVIATIONS_PER_MEDIAN, OUTLIER, PASSES = 1.4826, 4.0, 3


def loudness(residual: FloatArray) -> FloatArray:
    r"""Return :math:`\max(1, (r_k / 4 s)^2)` with s the median deviation: what outliers must count less by.

    >>> loudness(np.array([1.0, -1.0, 1.0, 11.8608, -1.0]))
    array([1., 1., 1., 4., 1.])
    """
    deviation = DEVIATIONS_PER_MEDIAN * float(np.median(np.abs(residual)))
    if deviation == 0.0:
        return np.ones(len(residual))
    return np.asarray(np.maximum(1.0, (residual / (OUTLIER * deviation)) ** 2))


def robust_residual(Z: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what least squares leaves once outliers, such as held samples, count less, and the rows' loudness."""
    loud = np.ones(len(y))
    for _ in range(PASSES):
        weight = 1.0 / np.sqrt(loud)
        residual = y - Z @ np.linalg.lstsq(Z * weight[:, None], y * weight, rcond=None)[0]
        loud = loudness(residual)
    return residual, loud


def indicators(n: int, rows: NDArray[np.intp]) -> FloatArray:
    """Return a column (n,) for each row, 1 there and 0 elsewhere.

    >>> indicators(3, np.array([2]))[:, 0]
    array([0., 0., 1.])
    """
    columns = np.zeros((n, len(rows)))
    columns[rows, np.arange(len(rows))] = 1.0
    return columns
