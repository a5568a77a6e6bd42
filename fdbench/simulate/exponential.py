"""Exponential of a matrix with the same bits on every processor, as records must be."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

DEGREE = 16
SWEEPS = 8


def exponential(A: FloatArray) -> FloatArray:
    r"""Return :math:`e^A` of a small square matrix by scaling and squaring of a Taylor polynomial.

    .. math:: F_0 = \sum_{k=1}^{16} \frac{(A / 2^s)^k}{k!}, \quad F_{j+1} = 2 F_j + F_j^2, \quad e^A = I + F_s

    Every sum has a fixed order, where a library of linear algebra takes one that suits the processor; a last bit may
    decide whether an encoder counts. A is first balanced by powers of two, which costs no rounding. It may be complex.

    >>> exponential(np.array([[0.0, 1.0], [0.0, 0.0]]))
    array([[1., 1.],
           [0., 1.]])
    """
    size = _balance(A.real)
    B = A / size[:, None] * size
    squarings = max(0, int(np.frexp(len(A) * np.abs(B.real).max())[1]) + 2)
    X, eye = B / 2.0**squarings, np.eye(len(A))
    polynomial = eye
    for k in range(DEGREE, 1, -1):
        polynomial = eye + product(X, polynomial) / k
    F = product(X, polynomial)
    for _ in range(squarings):
        F = 2.0 * F + product(F, F)
    return (eye + F) * size[:, None] / size


def product(A: FloatArray, B: FloatArray) -> FloatArray:
    """Return A B, summed in the order of the columns of A."""
    total = np.zeros((len(A), B.shape[1]), dtype=np.result_type(A, B))
    for k in range(A.shape[1]):
        total += A[:, k, None] * B[k]
    return total


def _balance(A: FloatArray) -> FloatArray:
    """Return powers of two, (n,), in whose units rows and columns of A are about equal."""
    size = np.ones(len(A))
    off = np.abs(A) * (1.0 - np.eye(len(A)))
    for _ in range(SWEEPS):
        before = size.copy()
        for i in range(len(A)):
            row, column = off[i].max(), off[:, i].max()
            if row == column == 0.0:
                continue
            exponent = np.log2(row if row > 0.0 else 1.0) - np.log2(column if column > 0.0 else 1.0)
            factor = 2.0 ** np.round(0.5 * exponent if row > 0.0 and column > 0.0 else exponent)
            off[i] /= factor
            off[:, i] *= factor
            size[i] *= factor
        if np.array_equal(size, before):
            break
    return size
