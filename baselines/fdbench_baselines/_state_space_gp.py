r"""A locally periodic Gaussian process in state space: likelihood and posterior in O(n).

.. math::
    y_k = z_k^T \beta + f_k + e_k, \quad f_k = \sum_i h_{ki} x_{i,k}, \quad
    x_i^+ = F x_i + q_i, \qquad \mathrm{cov}\, x_i = \sigma_i^2 P_\infty, \quad \mathrm{var}\, e_k = s^2 l_k

with h of unit amplitudes such as :math:`\cos j \varphi_k, \sin j \varphi_k`, so that harmonic j has the covariance
:math:`\sigma_j^2 k(\tau) \cos j (\varphi_k - \varphi_l)`: the locally periodic kernel, its harmonics cut off. Each x_i
is an Ornstein-Uhlenbeck process, :math:`k = e^{-\tau/\ell}`, or the Matérn process of order 3/2.

References
----------
Solin and Särkkä, Explicit link between periodic covariance functions and state space models, AISTATS 2014, 904-912
(resonators, and their damping); Särkkä and Solin, Applied Stochastic Differential Equations, 2019, section 12.3; de
Jong, Smoothing and interpolation with the state-space model, J. American Statistical Association 84 (1989), 1085-1088.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench.estimator import FloatArray


class Transition(NamedTuple):
    """How an amplitude goes on from row to row: F, Q and P_inf, each (order, order), of unit variance."""

    F: FloatArray
    Q: FloatArray
    P: FloatArray


def transition(order: int, step_s: float, length_s: float) -> Transition:
    """Return an Ornstein-Uhlenbeck process (order 1) or the Matern process of order 3/2 (order 2).

    >>> float(transition(1, 0.1, 0.1).F[0, 0].round(4)), float(transition(2, 0.0, 1.0).F[0, 0])
    (0.3679, 1.0)
    """
    if order == 1:
        P, F = np.ones((1, 1)), np.full((1, 1), np.exp(-step_s / length_s))
    else:
        # The second state is the rate in units of sqrt(3) / length, so that both have variance 1.
        x = np.sqrt(3.0) * step_s / length_s
        P, F = np.eye(2), np.exp(-x) * np.array([[1.0 + x, x], [-x, 1.0 - x]])
    return Transition(F, P - F @ P @ F.T, P)


class Innovations(NamedTuple):
    """Innovations (n, m) of the columns and their variances (n,), inf where a row is missing; more for the smoother.

    That is predictions (n, m) of the force, P h and P g (n, M) and g' P g (n,), g being h on the force's amplitudes.
    """

    errors: FloatArray
    variances: FloatArray
    predictions: FloatArray
    reach: FloatArray
    own_reach: FloatArray
    own_variances: FloatArray


@njit(error_model="numpy", forceinline=True)
def step_rows(size, T, A):  # type: ignore[no-untyped-def]
    """Multiply A (M, c) from the left by the block diagonal matrix of the blocks T, in place."""
    if len(size) == 1:
        for i in range(A.shape[0]):
            for j in range(A.shape[1]):
                A[i, j] *= T[i, 0, 0]
    else:
        for i in range(0, A.shape[0], 2):
            t = T[i // 2]
            for j in range(A.shape[1]):
                p, q = A[i, j], A[i + 1, j]
                A[i, j] = t[0, 0] * p + t[0, 1] * q
                A[i + 1, j] = t[1, 0] * p + t[1, 1] * q


@njit(error_model="numpy", forceinline=True)
def step_columns(size, T, A):  # type: ignore[no-untyped-def]
    """Multiply A (c, M) from the right by the transpose of the block diagonal matrix of the blocks T, in place."""
    if len(size) == 1:
        for i in range(A.shape[0]):
            for j in range(A.shape[1]):
                A[i, j] *= T[j, 0, 0]
    else:
        for j in range(0, A.shape[1], 2):
            t = T[j // 2]
            for i in range(A.shape[0]):
                p, q = A[i, j], A[i, j + 1]
                A[i, j] = t[0, 0] * p + t[0, 1] * q
                A[i, j + 1] = t[1, 0] * p + t[1, 1] * q


@njit(error_model="numpy", forceinline=True)
def add_blocks(size, T, A):  # type: ignore[no-untyped-def]
    """Add the block diagonal matrix of the blocks T to A (M, M), in place."""
    b = len(size)
    for i in range(len(T)):
        for p in range(b):
            for q in range(b):
                A[b * i + p, b * i + q] += T[i, p, q]


@njit(error_model="numpy", forceinline=True)
def take_in(x, P, w, S, errors):  # type: ignore[no-untyped-def]
    """Take a row of innovations (m,) into states x (m, M) and covariance P, in place."""
    for c in range(len(errors)):
        for j in range(len(w)):
            x[c, j] += w[j] / S * errors[c]
    for i in range(len(w)):
        gain = w[i] / S
        for j in range(len(w)):
            P[i, j] -= gain * w[j]


@kept
@njit(error_model="numpy")
def run_filter(size, H, own, F, Q, P0, loud, fresh, Y, keep):  # type: ignore[no-untyped-def]
    """Return the fields of `Innovations` for columns Y (n, m), with s^2 = 1.

    ``size`` is a tuple of as many zeros as an amplitude has states; H (n, d) the h of d amplitudes, ``own`` (d,) 1 for
    those that count as the force, F, Q, P0 (d, b, b) as in `Transition`; before a ``fresh`` row all begin anew.
    A row whose ``loud`` is inf is missing. Without ``keep`` nothing is left for the smoother.
    """
    n, d = H.shape
    b, m = len(size), Y.shape[1]
    M = b * d
    x, P, w, v = np.zeros((m, M)), np.zeros((M, M)), np.empty(M), np.empty(M)
    errors, variances = np.empty((n, m)), np.empty(n)
    stored = n if keep else 0
    predictions, reach, own_reach = np.empty((stored, m)), np.empty((stored, M)), np.empty((stored, M))
    own_variances = np.empty(stored)
    for k in range(n):
        if k == 0 or fresh[k]:
            x[:] = 0.0
            P[:] = 0.0
            add_blocks(size, P0, P)
        w[:] = 0.0
        for i in range(d):
            for j in range(M):
                w[j] += H[k, i] * P[b * i, j]
        if keep:
            v[:] = 0.0
            for i in range(d):
                if own[i] != 0.0:
                    for j in range(M):
                        v[j] += H[k, i] * P[b * i, j]
            spread = 0.0
            for i in range(d):
                spread += own[i] * H[k, i] * v[b * i]
            own_variances[k] = spread
            # An assignment to a slice would be compiled with the text of an error of shapes, for seconds.
            for j in range(M):
                reach[k, j], own_reach[k, j] = w[j], v[j]
            for c in range(m):
                s = 0.0
                for i in range(d):
                    s += own[i] * H[k, i] * x[c, b * i]
                predictions[k, c] = s
        S = loud[k]
        for i in range(d):
            S += H[k, i] * w[b * i]
        variances[k] = S
        for c in range(m):
            s = Y[k, c]
            for i in range(d):
                s -= H[k, i] * x[c, b * i]
            errors[k, c] = s
        if np.isfinite(S):
            take_in(x, P, w, S, errors[k])
        step_columns(size, F, x)
        step_rows(size, F, P)
        step_columns(size, F, P)
        add_blocks(size, Q, P)
    return errors, variances, predictions, reach, own_reach, own_variances


@kept
@njit(error_model="numpy")
def run_smoother(size, H, F, fresh, errors, variances, predictions, reach, own_reach, own_variances):  # type: ignore[no-untyped-def]
    """Return the force in each column given all rows (n, m), and its variance (n,) with s^2 = 1."""
    n, d = H.shape
    b, m = len(size), errors.shape[1]
    M = b * d
    back = np.empty((d, b, b))
    for i in range(d):
        for p in range(b):
            for q in range(b):
                back[i, p, q] = F[i, q, p]
    r, N, NK = np.zeros((m, M)), np.zeros((M, M)), np.empty(M)
    mean, variance = np.empty((n, m)), np.empty(n)
    for k in range(n - 1, -1, -1):
        step_columns(size, back, r)
        step_rows(size, back, N)
        step_columns(size, back, N)
        w, S, v = reach[k], variances[k], own_reach[k]
        if np.isfinite(S):
            for c in range(m):
                s = errors[k, c]
                for j in range(M):
                    s -= w[j] * r[c, j]
                for i in range(d):
                    r[c, b * i] += H[k, i] * s / S
            NK[:] = 0.0
            for i in range(M):
                gain = w[i] / S
                for j in range(M):
                    NK[j] += gain * N[i, j]
            square = 1.0 / S
            for j in range(M):
                square += w[j] / S * NK[j]
            for i in range(d):
                for j in range(M):
                    N[b * i, j] -= H[k, i] * NK[j]
                    N[j, b * i] -= H[k, i] * NK[j]
            for i in range(d):
                for j in range(d):
                    N[b * i, b * j] += square * H[k, i] * H[k, j]
        for c in range(m):
            s = predictions[k, c]
            for j in range(M):
                s += v[j] * r[c, j]
            mean[k, c] = s
        s = own_variances[k]
        for i in range(M):
            for j in range(M):
                s -= v[i] * N[i, j] * v[j]
        variance[k] = max(s, 0.0)
        if fresh[k]:
            r[:] = 0.0
            N[:] = 0.0
    return mean, variance
