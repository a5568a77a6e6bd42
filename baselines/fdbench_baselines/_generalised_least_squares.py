r"""Recursive generalised least squares, compiled: a linear model whose error is autoregressive.

.. math::
    y_k = z_k^T \beta + n_k, \quad n_k = \sum_{i=1}^q a_i n_{k-i} + \varepsilon_k, \qquad
    \hat y_k = z_k^T \beta + \sum_i a_i (y_{k-i} - z_{k-i}^T \beta), \quad
    \psi_k = \begin{pmatrix} z_k - \sum_i a_i z_{k-i} \\ n_{k-1} \\ \vdots \\ n_{k-q} \end{pmatrix}

and :math:`\theta = (\beta, a)` moves along the gradient :math:`\psi` of the prediction as recursive least squares does.
The errors n are those of the present :math:`\beta`.

References
----------
Hastings-James, Sage, Recursive generalised-least-squares procedure for on-line identification of process parameters,
Proc. IEE 116 (1969), 2057-2062; Ljung, System Identification, 2nd ed. 1999, section 11.4 (the gradient).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench.estimator import FloatArray


class Recursion(NamedTuple):
    """State for p parameters and q errors; changed in place by `follow_errors`.

    Attributes
    ----------
    theta, P : (p + q,), (p + q, p + q) arrays
        beta and a, with their covariance.
    Z, y : (q, p), (q,) arrays
        Rows before the present one, the latest first.
    noise : (2,) array
        Sum and number of the squares whose mean is the variance of epsilon.
    """

    theta: FloatArray
    P: FloatArray
    Z: FloatArray
    y: FloatArray
    noise: FloatArray


def at_start(beta: FloatArray, covariance: FloatArray, lags: int, weight_deviation: float) -> Recursion:
    """Return the state before the first row: no weight on errors, each within a deviation."""
    p = len(beta)
    P = np.zeros((p + lags, p + lags))
    P[:p, :p] = covariance
    P[range(p, p + lags), range(p, p + lags)] = weight_deviation**2
    return Recursion(np.append(beta, np.zeros(lags)), P, np.zeros((lags, p)), np.zeros(lags), np.zeros(2))


@kept
@njit(error_model="numpy")
def follow_errors(state: Recursion, Z: FloatArray, y: FloatArray) -> FloatArray:
    r"""Predict rows, then take each in.

    .. math::
        e = y - \hat y, \quad S = \psi^T P \psi + r, \quad \theta \leftarrow \theta + P \psi\, e / S, \quad
        P \leftarrow P - P \psi\, \psi^T P / S

    with r the mean of :math:`e^2 r / S` over the rows so far, that of the first row with an error its square.

    Returns
    -------
    (n, 3) array
        :math:`\hat y`, its part that the errors before foretell, and S, that of a first row with its own square.
    """
    theta, P, past_Z, past_y, noise = state.theta, state.P, state.Z, state.y, state.noise
    p, q = past_Z.shape[1], past_y.size
    m = p + q
    out, psi, gain = np.empty((y.size, 3)), np.empty(m), np.empty(m)
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
        gain[:] = 0.0
        for i in range(m):
            for j in range(m):
                gain[j] += psi[i] * P[i, j]
        for i in range(m):
            doubt += psi[i] * gain[i]
        doubt = max(doubt, 0.0)
        e = y[k] - linear - foretold
        known = noise[1] > 0.0
        r = noise[0] / noise[1] if known else e * e
        S = doubt + r
        out[k, 0], out[k, 1], out[k, 2] = linear + foretold, foretold, S
        if known or e != 0.0:  # an exact row tells no noise, and with none would settle what it has to do with
            noise[0] += e * e * r / S
            noise[1] += 1.0
            for i in range(m):
                theta[i] += gain[i] * e / S
            for i in range(m):
                row, share = P[i], gain[i] / S
                for j in range(m):
                    row[j] -= share * gain[j]
        for i in range(q - 1, 0, -1):
            past_y[i] = past_y[i - 1]
            for j in range(p):
                past_Z[i, j] = past_Z[i - 1, j]
        if q > 0:
            past_y[0] = y[k]
            for j in range(p):
                past_Z[0, j] = Z[k, j]
    return out
