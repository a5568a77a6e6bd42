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


def by_components(blocks: FloatArray) -> FloatArray:
    """Return blocks (d, b, b) as (b, b, d)."""
    return np.ascontiguousarray(blocks.transpose(1, 2, 0))


class Innovations(NamedTuple):
    """Innovations (n, m) of the columns and their variances (n,), inf where a row is missing; more for the smoother.

    That is predictions (n, m) of the force, P h and P g (n, M) and g' P g (n,), g being h on the force's amplitudes.
    States are in order of their components: the values of all amplitudes, then the rates of all.
    """

    errors: FloatArray
    variances: FloatArray
    predictions: FloatArray
    reach: FloatArray
    own_reach: FloatArray
    own_variances: FloatArray


@njit(error_model="numpy", forceinline=True)
def step_states(size, T, x):  # type: ignore[no-untyped-def]
    """Multiply states x (m, M) by the blocks T (b, b, d), in place."""
    d = T.shape[2]
    for c in range(x.shape[0]):
        for i in range(d):
            if len(size) == 1:
                x[c, i] *= T[0, 0, i]
            else:
                p, q = x[c, i], x[c, d + i]
                x[c, i] = T[0, 0, i] * p + T[0, 1, i] * q
                x[c, d + i] = T[1, 0, i] * p + T[1, 1, i] * q


@njit(error_model="numpy", forceinline=True)
def step_covariance(size, T, a, b, c, e, A, g, u):  # type: ignore[no-untyped-def]
    """Put T (A - a b' - c e') T' into A (M, M) and g' A into u (M,), with the blocks T (b, b, d), in one pass."""
    d = T.shape[2]
    u[:] = 0.0
    for i in range(d):
        if len(size) == 1:
            a_i, c_i, g_i, t = a[i], c[i], g[i], T[0, 0, i]
            for j in range(d):
                value = (A[i, j] - a_i * b[j] - c_i * e[j]) * (t * T[0, 0, j])
                A[i, j] = value
                u[j] += g_i * value
        else:
            k = d + i
            a_i, a_k, c_i, c_k, g_i, g_k = a[i], a[k], c[i], c[k], g[i], g[k]
            t00, t01, t10, t11 = T[0, 0, i], T[0, 1, i], T[1, 0, i], T[1, 1, i]
            for j in range(2 * d):
                p, q = A[i, j] - a_i * b[j] - c_i * e[j], A[k, j] - a_k * b[j] - c_k * e[j]
                A[i, j], A[k, j] = t00 * p + t01 * q, t10 * p + t11 * q
            for row, weight in ((i, g_i), (k, g_k)):
                for j in range(d):
                    p, q = A[row, j], A[row, d + j]
                    p, q = T[0, 0, j] * p + T[0, 1, j] * q, T[1, 0, j] * p + T[1, 1, j] * q
                    A[row, j], A[row, d + j] = p, q
                    u[j] += weight * p
                    u[d + j] += weight * q


@njit(error_model="numpy", forceinline=True)
def add_blocks(size, T, A, g, u):  # type: ignore[no-untyped-def]
    """Add the blocks T (b, b, d) to A (M, M), and what that adds to g' A to u (M,)."""
    d = T.shape[2]
    for p in range(len(size)):
        for q in range(len(size)):
            for i in range(d):
                A[p * d + i, q * d + i] += T[p, q, i]
                u[q * d + i] += g[p * d + i] * T[p, q, i]


@njit(error_model="numpy", forceinline=True)
def own_part(h, own, x, P, reach, predictions):  # type: ignore[no-untyped-def]
    """Put P g into reach (M,) and g' x into predictions (m,); return g' P g."""
    d = len(h)
    for j in range(len(reach)):
        reach[j] = 0.0
    for i in range(d):
        if own[i] != 0.0:
            for j in range(len(reach)):
                reach[j] += own[i] * h[i] * P[i, j]
    for c in range(len(predictions)):
        predictions[c] = 0.0
        for i in range(d):
            predictions[c] += own[i] * h[i] * x[c, i]
    variance = 0.0
    for i in range(d):
        variance += own[i] * h[i] * reach[i]
    return variance


@kept
@njit(error_model="numpy")
def run_filter(size, H, own, F, Q, P0, loud, fresh, Y, keep):  # type: ignore[no-untyped-def]
    """Return the fields of `Innovations` for columns Y (n, m), with s^2 = 1.

    ``size`` is a tuple of as many zeros as an amplitude has states; H (n, d) the h of d amplitudes, ``own`` (d,) 1 for
    those that count as the force, F, Q, P0 (b, b, d) as in `Transition`; before a ``fresh`` row all begin anew.
    A row whose ``loud`` is inf is missing. Without ``keep`` nothing is left for the smoother.
    """
    n, d = H.shape
    m, M = Y.shape[1], len(size) * d
    x, P, w, v = np.zeros((m, M)), np.zeros((M, M)), np.zeros(M), np.zeros(M)
    gain, none, g = np.zeros(M), np.zeros(M), np.zeros(M)
    errors, variances = np.empty((n, m)), np.empty(n)
    stored = n if keep else 0
    predictions, reach, own_variances = np.empty((stored, m)), np.empty((stored, M)), np.empty(stored)
    is_whole = own.sum() == d
    own_reach = reach if is_whole else np.empty((stored, M))
    for k in range(n):
        if k == 0 or fresh[k]:
            x[:] = 0.0
            P[:] = 0.0
            w[:] = 0.0
            for i in range(d):
                g[i] = H[k, i]
            add_blocks(size, P0, P, g, w)
        variance = 0.0
        for i in range(d):
            variance += H[k, i] * w[i]
        S = variance + loud[k]
        variances[k] = S
        for c in range(m):
            s = 0.0
            for i in range(d):
                s += H[k, i] * x[c, i]
            errors[k, c] = Y[k, c] - s
            if keep:
                predictions[k, c] = s
        if keep:
            # An assignment to a slice would be compiled with the text of an error of shapes, for seconds.
            for j in range(M):
                reach[k, j] = w[j]
            own_variances[k] = variance
            if not is_whole:
                own_variances[k] = own_part(H[k], own, x, P, own_reach[k], predictions[k])
        share = 1.0 / S
        for j in range(M):
            gain[j] = w[j] * share
        if share > 0.0:
            for c in range(m):
                for j in range(M):
                    x[c, j] += gain[j] * errors[k, c]
        step_states(size, F, x)
        following = min(k + 1, n - 1)
        for i in range(d):
            g[i] = H[following, i]
        step_covariance(size, F, gain, w, none, none, P, g, v)
        add_blocks(size, Q, P, g, v)
        w, v = v, w
    return errors, variances, predictions, reach, own_reach, own_variances


@kept
@njit(error_model="numpy")
def run_smoother(size, H, F, fresh, errors, variances, predictions, reach, own_reach):  # type: ignore[no-untyped-def]
    """Return the force in each column given all rows (n, m)."""
    n, d = H.shape
    m, M = errors.shape[1], len(size) * d
    back = np.ascontiguousarray(F.transpose(1, 0, 2))
    r, mean = np.zeros((m, M)), np.empty((n, m))
    for k in range(n - 1, -1, -1):
        step_states(size, back, r)
        share = 1.0 / variances[k]
        for c in range(m):
            s = errors[k, c]
            for j in range(M):
                s -= reach[k, j] * r[c, j]
            s *= share
            for i in range(d):
                r[c, i] += H[k, i] * s
            s = predictions[k, c]
            for j in range(M):
                s += own_reach[k, j] * r[c, j]
            mean[k, c] = s
            if fresh[k]:
                for j in range(M):
                    r[c, j] = 0.0
    return mean


@kept
@njit(error_model="numpy")
def run_spread(size, H, own, F, loud, fresh, variances, reach, own_reach, own_variances):  # type: ignore[no-untyped-def]
    r"""Return the variance (n,) of the force given all rows, with s^2 = 1.

    .. math:: N \to L^T N L + h h^T / S, \quad L = 1 - w h^T / S, \quad w = P h, \qquad
              \mathrm{var} = g^T P g - (h^T v)^2 / S - z^T N z, \quad v = P g, \quad z = L v
    """
    n, d = H.shape
    M = len(size) * d
    is_whole = own.sum() == d
    back = np.ascontiguousarray(F.transpose(1, 0, 2))
    N, u, c, g, z = np.zeros((M, M)), np.zeros(M), np.zeros(M), np.zeros(M), np.zeros(M)
    spread = np.empty(n)
    for k in range(n - 1, -1, -1):
        w, share = reach[k], 1.0 / variances[k]
        square = 0.0
        for j in range(M):
            square += w[j] * u[j]
        if is_whole:
            left = loud[k] * share if loud[k] < np.inf else 1.0
            spread[k] = max(own_variances[k] * left - left**2 * square, 0.0)
        else:
            v, taken = own_reach[k], 0.0
            for i in range(d):
                taken += H[k, i] * v[i]
            for j in range(M):
                z[j] = v[j] - w[j] * (taken * share)
            s = own_variances[k] - taken**2 * share
            for i in range(M):
                for j in range(M):
                    s -= z[i] * N[i, j] * z[j]
            spread[k] = max(s, 0.0)
        for i in range(d):
            g[i] = H[k, i]
        half = 0.5 * share * (1.0 + share * square)
        for j in range(M):
            c[j] = u[j] * share - half * g[j]
        following = reach[max(k - 1, 0)]
        if fresh[k]:
            N[:] = 0.0
            u[:] = 0.0
        else:
            step_covariance(size, back, g, c, c, g, N, following, u)
    return spread
