r"""Recursive least squares, compiled: sample by sample with forgetting, and batch by batch for the hybrid model.

The first keeps :math:`P`, the inverse of the information matrix, the second the information matrix :math:`A` itself:

.. math::
    P_n^{-1} = \lambda P_{n-1}^{-1} + x_n x_n^T, \quad P_0 = \delta I, \qquad\qquad
    A_n = A_{n-1} + \varphi_n \varphi_n^T, \quad A_0 = \lambda I

With :math:`\delta = 1 / \lambda` and no forgetting both have the same weights. A needs no inverse until a batch is due
and stays positive definite under rounding.

References
----------
Haykin, Adaptive Filter Theory, on the exponentially weighted RLS algorithm; Chou, Duan, Okwudire, A linear hybrid
model for enhanced servo error pre-compensation of feed drives with unmodeled nonlinear dynamics, CIRP Annals, eqs. (4)
to (6).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept

FloatArray = NDArray[np.float64]


@kept
@njit(error_model="numpy")
def rls(theta: FloatArray, P: FloatArray, X: FloatArray, y: FloatArray, lam: float) -> FloatArray:
    r"""Take in rows and return the errors of their predictions before each.

    .. math::
        g = P x, \quad d = \lambda + x^T g, \quad e = y - x^T \theta, \quad
        \theta \leftarrow \theta + g e / d, \quad P \leftarrow (P - g g^T / d) / \lambda

    Parameters
    ----------
    theta, P : (p,), (p, p) arrays, changed in place
        Weights and covariance factor; P stays symmetric to the last bit.
    X, y : (n, p), (n,) arrays
        Regressors and targets.
    lam : float
        Forgetting factor, in (0, 1].

    Returns
    -------
    (n,) array
        A-priori errors e.

    Examples
    --------
    One sample on a wide prior: the weight is nearly y / x.

    >>> theta, P = np.zeros(1), np.array([[3.0]])
    >>> rls(theta, P, np.array([[1.0]]), np.array([4.0]), 1.0), theta, P
    (array([4.]), array([3.]), array([[0.75]]))
    """
    n, p = X.shape
    errors, g = np.empty(n), np.empty(p)
    whole = p - p % 4
    for k in range(n):
        x = X[k]
        g[:] = 0.0
        for j in range(0, whole, 4):
            a, b, c, d = P[j], P[j + 1], P[j + 2], P[j + 3]
            xa, xb, xc, xd = x[j], x[j + 1], x[j + 2], x[j + 3]
            for i in range(p):
                g[i] += (xa * a[i] + xb * b[i]) + (xc * c[i] + xd * d[i])
        for j in range(whole, p):
            for i in range(p):
                g[i] += x[j] * P[j, i]
        e, power = y[k], lam
        for i in range(p):
            e -= x[i] * theta[i]
            power += x[i] * g[i]
        errors[k] = e
        gain = e / power
        root = 1.0 / math.sqrt(power)
        for i in range(p):
            theta[i] += gain * g[i]
            g[i] *= root
        shrink = 1.0 / lam
        for j in range(p):
            row, gj = P[j], g[j]
            for i in range(p):
                row[i] = (row[i] - gj * g[i]) * shrink
    return errors


class Hybrid(NamedTuple):
    """State of the hybrid model with q + 1 responses and p errors in its features; changed in place by `predict`.

    Attributes
    ----------
    A, b : (2 + q + p, 2 + q + p), (2 + q + p,) arrays
        Information matrix (lower triangle) and vector.
    w : (2 + q + p,) array
        Weights of the present batch.
    measured, predicted : (2 + q + p,) arrays
        Features with measured errors, and those in which the errors of the present batch are predicted ones.
    place : (1,) array of int
        Place of the next sample in its batch.
    """

    A: FloatArray
    b: FloatArray
    w: FloatArray
    measured: FloatArray
    predicted: FloatArray
    place: NDArray[np.int64]


def untrained(q: int, p: int, lam: float) -> Hybrid:
    """Return the state before the first sample, with all signals zero before it."""
    n = 2 + q + p
    measured, predicted = np.zeros(n), np.zeros(n)
    measured[0] = predicted[0] = 1.0
    return Hybrid(lam * np.eye(n), np.zeros(n), np.zeros(n), measured, predicted, np.zeros(1, dtype=np.int64))


@kept
@njit(error_model="numpy")
def solve(A: FloatArray, b: FloatArray, w: FloatArray) -> None:
    """Write the solution of A w = b, A positive definite and given by its lower triangle, by Cholesky's method."""
    n = b.size
    L = np.zeros((n, n))
    for j in range(n):
        w[j] = b[j]
    for j in range(n):
        column = L[j]  # L is kept transposed, so that a column is contiguous
        for i in range(j, n):
            column[i] = A[i, j]
        for k in range(j):
            row, factor = L[k], L[k, j]
            for i in range(j, n):
                column[i] -= factor * row[i]
        pivot = 1.0 / math.sqrt(column[j])
        for i in range(j, n):
            column[i] *= pivot
        w[j] /= column[j]
        for i in range(j + 1, n):
            w[i] -= column[i] * w[j]
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            w[j] -= L[j, i] * w[i]
        w[j] /= L[j, j]


@kept
@njit(error_model="numpy")
def predict(state: Hybrid, response: FloatArray, error: FloatArray, q: int, batch: int) -> FloatArray:
    r"""Predict samples batch by batch, then take them in.

    .. math::
        \varphi_k = (1, x_{pb,k} \ldots x_{pb,k-q}, e_{k-1} \ldots e_{k-p}), \quad \hat e_k = w^T \hat\varphi_k, \quad
        A \leftarrow A + \varphi_k \varphi_k^T, \quad b \leftarrow b + \varphi_k e_k

    At the first sample of a batch w solves A w = b; from there on :math:`\hat\varphi` holds predicted errors in place
    of measured ones, as none of the batch is measured yet.

    Parameters
    ----------
    state : Hybrid, changed in place
    response, error : (n,) arrays
        Positions that the physics model predicts, and their measured errors.
    q, batch : int
        Responses before the present one in the features; samples in a batch, N_p.

    Returns
    -------
    (n,) array
        Predicted errors.
    """
    A, b, w, measured, predicted = state.A, state.b, state.w, state.measured, state.predicted
    n, first = w.size, 2 + q
    estimates = np.empty(response.size)
    for k in range(response.size):
        if state.place[0] == 0:
            solve(A, b, w)
            for i in range(first, n):
                predicted[i] = measured[i]
        state.place[0] = (state.place[0] + 1) % batch
        for i in range(1 + q, 1, -1):
            measured[i] = measured[i - 1]
        measured[1] = response[k]
        for i in range(1, first):
            predicted[i] = measured[i]
        estimate = 0.0
        for i in range(n):
            estimate += w[i] * predicted[i]
        estimates[k] = estimate
        for i in range(n):
            row, factor = A[i], measured[i]
            for j in range(i + 1):
                row[j] += factor * measured[j]
            b[i] += factor * error[k]
        for i in range(n - 1, first, -1):
            measured[i] = measured[i - 1]
            predicted[i] = predicted[i - 1]
        if n > first:
            measured[first], predicted[first] = error[k], estimate
    return estimates


@kept
@njit(error_model="numpy")
def free_run(state: Hybrid, response: FloatArray, q: int) -> FloatArray:
    r"""Return the errors (n,) of a motion of which nothing is measured, with the weights of all samples so far.

    .. math:: \hat e_k = w^T (1, x_{pb,k} \ldots x_{pb,k-q}, \hat e_{k-1} \ldots \hat e_{k-p}), \quad A w = b

    Before the first sample all signals are zero. The state is left as it is.
    """
    n, first = state.w.size, 2 + q
    w, features, errors = np.empty(n), np.zeros(n), np.empty(response.size)
    solve(state.A, state.b, w)
    features[0] = 1.0
    for k in range(response.size):
        for i in range(1 + q, 1, -1):
            features[i] = features[i - 1]
        features[1] = response[k]
        error = 0.0
        for i in range(n):
            error += w[i] * features[i]
        errors[k] = error
        for i in range(n - 1, first, -1):
            features[i] = features[i - 1]
        if n > first:
            features[first] = error
    return errors
