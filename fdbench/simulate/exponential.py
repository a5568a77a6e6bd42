"""Exponential of a matrix with the same bits on every processor, as records must be."""

import math

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
    terms = A.T[:, :, None] * B[:, None, :]
    total: FloatArray = np.add.reduce(terms, axis=0)  # over the slowest axis: one term after the other
    return total


def _balance(A: FloatArray) -> FloatArray:
    """Return powers of two, (n,), in whose units rows and columns of A are about equal."""
    n = len(A)
    size, off = [1.0] * n, (np.abs(A) * (1.0 - np.eye(n))).tolist()
    for _ in range(SWEEPS):
        before = size.copy()
        for i in range(n):
            row, column = max(off[i]), max(own[i] for own in off)
            if row == column == 0.0:
                continue
            exponent = math.log2(row if row > 0.0 else 1.0) - math.log2(column if column > 0.0 else 1.0)
            factor = 2.0 ** round(0.5 * exponent if row > 0.0 and column > 0.0 else exponent)
            off[i] = [value / factor for value in off[i]]
            for own in off:
                own[i] *= factor
            size[i] *= factor
        if size == before:
            break
    return np.array(size)
