r"""Recursive generalised least squares, compiled: a linear model whose error is autoregressive.

.. math::
    y_k = z_k^T \beta + n_k, \quad n_k = \sum_{i=1}^q a_i n_{k-i} + \varepsilon_k, \qquad
    \hat y_k = z_k^T \beta + \sum_i a_i (y_{k-i} - z_{k-i}^T \beta), \quad
    \psi_k = \begin{pmatrix} z_k - \sum_i a_i z_{k-i} \\ n_{k-1} \\ \vdots \\ n_{k-q} \end{pmatrix}

and :math:`\theta = (\beta, a)` is what all gradients :math:`\psi` of the prediction so far ask for, beside what was
known of it before. The errors n are those of the present :math:`\beta`.

References
----------
Hastings-James, Sage, Recursive generalised-least-squares procedure for on-line identification of process parameters,
Proc. IEE 116 (1969), 2057-2062; Ljung, System Identification, 2nd ed. 1999, section 11.4 (the gradient).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.estimator import FloatArray

# Share of the variance at the start that no rows go below: the first ones may tell no noise, and would leave no digits.
FINEST = 1e-9


class Recursion(NamedTuple):
    r"""State for p parameters and q errors, m = p + q; changed in place by `follow_errors`.

    Attributes
    ----------
    theta, P : (m,), (m, m) arrays
        beta and a, with their covariance.
    start, deviation : (m,), (m,) arrays
        What was known before the first row, and how well.
    G, h : (m, m), (m,) arrays
        Sums of :math:`\psi \psi^T` and of :math:`\psi\,(e + \psi^T (\theta - \theta_0))`.
    Z, y : (q, p), (q,) arrays
        Rows before the present one, the latest first.
    noise : (2,) array
        Sum and number of the squares whose mean is the variance of epsilon.
    """

    theta: FloatArray
    P: FloatArray
    start: FloatArray
    deviation: FloatArray
    G: FloatArray
    h: FloatArray
    Z: FloatArray
    y: FloatArray
    noise: FloatArray


def at_start(beta: FloatArray, deviation: FloatArray, lags: int, weight_deviation: float) -> Recursion:
    """Return the state before the first row: no weight on errors, each within a deviation."""
    p, m = len(beta), len(beta) + lags
    theta, known = np.append(beta, np.zeros(lags)), np.append(deviation, np.full(lags, weight_deviation))
    sums = np.zeros((m, m)), np.zeros(m)
    return Recursion(
        theta, np.diag(known**2), theta.copy(), known, *sums, np.zeros((lags, p)), np.zeros(lags), np.zeros(2)
    )


@kept
@njit(error_model="numpy")
def follow_errors(state: Recursion, Z: FloatArray, y: FloatArray, learnt: NDArray[np.bool_]) -> FloatArray:
    r"""Predict rows, then take each in that is ``learnt`` (n,) from.

    .. math::
        e = y - \hat y, \quad S = \psi^T P \psi + r, \quad
        P = (G / r + \Lambda^{-1})^{-1}, \quad \theta = \theta_0 + P\, h / r

    with :math:`\Lambda` the variances at the start and r the mean of :math:`e^2 r / S` over the rows so far, that of
    the first row with an error its square. All rows have the noise of now, so that those of a drive at rest, where
    nothing is wrong, do not settle the parameters before it moves.

    Returns
    -------
    (n, 3) array
        :math:`\hat y`, its part that the errors before foretell, and S, that of a first row with its own square.
    """
    theta, P, start, deviation, noise = state.theta, state.P, state.start, state.deviation, state.noise
    G, h, past_Z, past_y = state.G, state.h, state.Z, state.y
    p, q = past_Z.shape[1], past_y.size
    m = p + q
    out, psi, L, W = np.empty((y.size, 3)), np.empty(m), np.zeros((m, m)), np.zeros((m, m))
    for k in range(y.size):
        linear = foretold = 0.0
        for j in range(p):
            psi[j] = Z[k, j]
            linear += Z[k, j] * theta[j]
        for i in range(q):
            error = past_y[i]
            for j in range(p):
                error -= past_Z[i, j] * theta[j]
                psi[j] -= theta[p + i] * past_Z[i, j]
            psi[p + i] = error
            foretold += theta[p + i] * error
        doubt = 0.0
        for i in range(m):
            for j in range(m):
                doubt += psi[i] * P[i, j] * psi[j]
        e = y[k] - linear - foretold
        known = noise[1] > 0.0
        r = noise[0] / noise[1] if known else e * e
        S = doubt + r
        out[k, 0], out[k, 1], out[k, 2] = linear + foretold, foretold, S
        if learnt[k] and (
            known or e != 0.0
        ):  # an exact row tells no noise, and with none would settle what it has to do with
            noise[0] += e * e * r / S
            noise[1] += 1.0
            pull = e
            for i in range(m):
                pull += psi[i] * (theta[i] - start[i])
            for i in range(m):
                h[i] += psi[i] * pull
                for j in range(i + 1):
                    G[i, j] += psi[i] * psi[j]
            _settle(G, h, noise[0] / noise[1], start, deviation, L, W, theta, P)
        for i in range(q - 1, 0, -1):
            past_y[i] = past_y[i - 1]
            for j in range(p):
                past_Z[i, j] = past_Z[i - 1, j]
        if q > 0:
            past_y[0] = y[k]
            for j in range(p):
                past_Z[0, j] = Z[k, j]
    return out


@kept
@njit(error_model="numpy")
def _settle(
    G: FloatArray,
    h: FloatArray,
    r: float,
    start: FloatArray,
    deviation: FloatArray,
    L: FloatArray,
    W: FloatArray,
    theta: FloatArray,
    P: FloatArray,
) -> None:
    """Write theta and P for the sums so far, with L L^T = D G D / r + I and D the deviations; W takes L^-1 D."""
    m = h.size
    for i in range(m):
        r = max(r, FINEST * deviation[i] ** 2 * G[i, i])
    for i in range(m):
        for j in range(i + 1):
            total = deviation[i] * G[i, j] * deviation[j] / r + (1.0 if i == j else 0.0)
            for k in range(j):
                total -= L[i, k] * L[j, k]
            # A pivot of I beside anything positive is at least 1, whatever is rounded.
            L[i, j] = math.sqrt(max(total, 1.0)) if i == j else total / L[j, j]
    for j in range(m):
        for i in range(j, m):
            total = deviation[j] if i == j else 0.0
            for k in range(j, i):
                total -= L[i, k] * W[k, j]
            W[i, j] = total / L[i, i]
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, m):
                total += W[k, i] * W[k, j]
            P[i, j] = P[j, i] = total
    for i in range(m):
        total = 0.0
        for j in range(m):
            total += P[i, j] * h[j]
        theta[i] = start[i] + total / r
