r"""Smoothers of fixed lag: a state given the readings up to L samples after its own.

.. math::
    E[s^T x_k \,|\, y_0 \ldots y_{k+L}] = s^T \hat x_k + \sum_{j=0}^{L} p_j^T C^T S_{k+j}^{-1} e_{k+j}, \qquad
    p_0 = P_k s, \quad p_{j+1} = A_{k+j} (I - K_{k+j} C) p_j

with :math:`\hat x_k, P_k` before reading k, innovations e and their covariances S: :math:`C p_j` is the covariance of
what is asked with the innovation j samples later. The variance is :math:`s^T P_k s - \sum_j p_j^T C^T S^{-1} C p_j`. It
is the filter of a state that holds its own past, without a covariance of that size. At a steady gain the sum is a
convolution with L + 1 weights.

References
----------
Moore, Discrete-time fixed-lag smoothing algorithms, Automatica 9 (1973), 163-173; Anderson and Moore, Optimal
Filtering, 1979, section 7.3.
"""

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench.estimator import FloatArray
from fdbench_baselines._kalman_filter import Observer
from fdbench_baselines._motion_smoother import MOTION, ForcedMotion, Passed
from fdbench_baselines._steady_smoother import run_forward, settled

FORGOTTEN = 1e-24  # variance that the start has left, in units of P


def lagged_state(model: Observer, u: FloatArray, y: FloatArray, number: int, lag: int) -> tuple[FloatArray, FloatArray]:
    r"""Return a state (n_rows,) and its variance (n_rows,) at the steady gain, given readings up to ``lag`` rows later.

    The start is uncertain by D beyond P. Of the filter that starts at 0 innovations are
    :math:`C \Psi^k \delta + \epsilon_k`, :math:`\Psi = A (I - K C)`, and the state is off by what the weights leave of
    :math:`\Psi^k \delta`; :math:`\delta` is that given the readings up to k + L too. As with P + D at the first reading
    and the gain that follows from it, all this is exact from the first row on.
    """
    A, B, C, K, _, P, information, beyond, size, noise = steady = settled(model)
    n, m, back = len(y), len(P), steady.transition
    states, errors = np.empty((n, m)), np.empty(y.shape)
    run_forward(A, B, C, K, np.zeros(m), u, y / noise, states, errors)
    weighted, p, g = errors @ information, P[:, number].copy(), np.eye(m)[number]
    mean, variance, left, flow = states[:, number].copy(), np.full(n, P[number, number]), [], np.eye(m)
    for j in range(min(lag, n - 1) + 1):
        mean[: n - j] += weighted[j:] @ p
        weight = information @ p
        variance[: n - j] -= p @ C.T @ weight
        g = g - weight @ C @ flow
        left.append(g)
        p, flow = back.T @ p, back.T @ flow
    N, r, ahead, flow, read = np.zeros((m, m)), np.zeros(m), np.eye(m), np.eye(m), 0
    for k in range(n):
        while read <= min(k + lag, n - 1):
            N, r = N + ahead.T @ C.T @ information @ ahead, r + ahead.T @ weighted[read]
            ahead, read = back.T @ ahead, read + 1
        off = left[min(lag, n - 1 - k)] @ flow
        spread = beyond @ np.linalg.inv(np.eye(m) + N @ beyond)
        mean[k] += off @ spread @ r
        variance[k] += off @ spread @ off
        flow = back.T @ flow
        if np.abs(flow @ beyond @ flow.T).max() < FORGOTTEN:
            break
    return mean * size[number], variance * size[number] ** 2


def lagged_sum(
    motion: ForcedMotion, kept_share: FloatArray, run: Passed, sums: FloatArray, lag: int
) -> tuple[FloatArray, FloatArray]:
    r"""Return :math:`s_k^T \theta_k`, for ``sums`` s (n, m), and its variance, given readings up to k + L.

    Coefficients act from sample k to the next one, whose reading is the first to tell of them.
    """
    behind = run.errors, run.variances, run.states[:-1], run.covariances[:-1]
    return run_lagged(motion.columns, kept_share, motion.place, sums, lag, *behind)  # type: ignore[no-any-return]


@kept
@njit(error_model="numpy")
def run_lagged(columns, kept_share, place, sums, lag, errors, variances, states, covariances):  # type: ignore[no-untyped-def]
    """Return mean and variance of `lagged_sum`."""
    n, m = columns.shape
    M = m + MOTION
    p = np.empty(M)
    mean, variance = np.zeros(n), np.zeros(n)
    for k in range(n):
        for i in range(M):
            p[i] = 0.0
            for j in range(m):
                p[i] += covariances[k, i, j + MOTION] * sums[k, j]
        for j in range(m):
            mean[k] += sums[k, j] * states[k, j + MOTION]
            variance[k] += sums[k, j] * p[j + MOTION]
        for later in range(k, min(k + lag, n - 1) + 1):
            if variances[later] < np.inf:
                shared = p[place] / variances[later]
                mean[k] += shared * errors[later]
                variance[k] -= shared * p[place]
                for i in range(M):
                    p[i] -= shared * covariances[later, i, place]
            carry(columns[later], kept_share, p)
        variance[k] = max(variance[k], 0.0)
    return mean, variance


@njit(error_model="numpy")
def carry(g, kept_share, x):  # type: ignore[no-untyped-def]
    """Let a sample pass over a state, in place."""
    a = 0.0
    for j in range(MOTION, len(x)):
        a += g[j - MOTION] * x[j]
        x[j] *= kept_share[j - MOTION]
    x[0] += x[1] + 0.5 * a
    x[1] += a
