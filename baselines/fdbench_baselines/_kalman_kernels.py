"""Compiled recursions of the Kalman filters.

``size`` is a tuple of n zeros: its length is known to the compiler, which unrolls the loops over the n states.
"""

import numpy as np
from numba import njit

from fdbench.compilation import kept


@njit(error_model="numpy", forceinline=True)
def pass_time(size, A, A_columns, B, Q, x, P, u, T, z):  # type: ignore[no-untyped-def]
    """Advance state and covariance, in place, by one sampling time."""
    n = len(size)
    for i in range(n):
        s = 0.0
        for j in range(n):
            s += A[i, j] * x[j]
        for j in range(len(u)):
            s += B[i, j] * u[j]
        z[i] = s
    for i in range(n):
        x[i] = z[i]
        for j in range(n):
            T[i, j] = 0.0
        for m in range(n):
            for j in range(n):
                T[i, j] += A[i, m] * P[m, j]
    for i in range(n):
        for j in range(n):
            P[i, j] = Q[i, j]
        for m in range(n):
            for j in range(n):
                P[i, j] += T[i, m] * A_columns[m, j]


@njit(error_model="numpy", forceinline=True)
def take_in(size, c, r, x, P, y, T, c_P, K):  # type: ignore[no-untyped-def]
    """Take one reading into state and covariance, in place, in the form of Joseph; return innovation and variance."""
    n = len(size)
    error, S = y, r
    for j in range(n):
        c_P[j] = 0.0
    for m in range(n):
        error -= c[m] * x[m]
        for j in range(n):
            c_P[j] += c[m] * P[m, j]
    for m in range(n):
        S += c[m] * c_P[m]
    for i in range(n):
        K[i] = c_P[i] / S
        x[i] += K[i] * error
        for j in range(n):
            T[i, j] = P[i, j] - K[i] * c_P[j]
    for i in range(n):
        s = -r * K[i]
        for j in range(n):
            s += T[i, j] * c[j]
        for j in range(n):
            P[i, j] = T[i, j] - s * K[j]
    return error, S


@njit(error_model="numpy", forceinline=True)
def copy(M, target):  # type: ignore[no-untyped-def]
    """Copy a matrix. An assignment to a slice would be compiled with the text of an error of shapes, for seconds."""
    for i in range(len(M)):
        for j in range(len(M)):
            target[i, j] = M[i, j]


@kept
@njit(error_model="numpy")
def run(size, model, x, P, u, y, out):  # type: ignore[no-untyped-def]
    """Run the filter of `fdbench_baselines._kalman_filter.filter_readings`; return its log-likelihood."""
    n = len(size)
    A, B, C, Q, R, _ = model
    A_columns = A.T.copy()
    T, z, K = np.empty((n, n)), np.empty(n), np.empty(n)
    log_likelihood = 0.0
    for k in range(y.shape[0]):
        pass_time(size, A, A_columns, B, Q, x, P, u[k], T, z)
        for row in range(y.shape[1]):
            error, S = take_in(size, C[row], R[row], x, P, y[k, row], T, z, K)
            if row == 0:
                out[k, 0] = y[k, 0] - error
                out[k, 1] = S
            log_likelihood -= 0.5 * (np.log(2.0 * np.pi * S) + error * error / S)
        out[k, 2] = x[n - 1]
        out[k, 3] = P[n - 1, n - 1]
    return log_likelihood


@kept
@njit(error_model="numpy")
def run_constant(F, G, L, c_A, c_B, x, u, y, out):  # type: ignore[no-untyped-def]
    r"""Run a filter of constant gain, :math:`x \leftarrow F x + G u_k + L y_k`, and write ``out`` as `run` does.

    ``c_A`` and ``c_B``, (n,) and (n_inputs,), predict the first output from state and input before the reading.
    """
    n = len(x)
    z = np.empty(n)
    for k in range(y.shape[0]):
        prediction = 0.0
        for j in range(n):
            prediction += c_A[j] * x[j]
        for j in range(u.shape[1]):
            prediction += c_B[j] * u[k, j]
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += F[i, j] * x[j]
            for j in range(u.shape[1]):
                s += G[i, j] * u[k, j]
            for j in range(y.shape[1]):
                s += L[i, j] * y[k, j]
            z[i] = s
        for i in range(n):
            x[i] = z[i]
        out[k, 0] = prediction
        out[k, 2] = x[n - 1]


@njit(error_model="numpy")
def inverse(M):  # type: ignore[no-untyped-def]
    """Return the inverse of a symmetric matrix."""
    return np.ascontiguousarray(np.linalg.inv(M))


@njit(error_model="numpy")
def add_scaled(a, M, x, total, vector):  # type: ignore[no-untyped-def]
    """Add a M to ``total`` and a M x to ``vector``."""
    for i in range(len(x)):
        for j in range(len(x)):
            total[i, j] += a * M[i, j]
            vector[i] += a * M[i, j] * x[j]


@kept
@njit(error_model="numpy")
def run_nodes(size, A, C, Q, R, P, heard, information, gamma, exchanges, y):  # type: ignore[no-untyped-def]
    r"""Run a filter in each node on the readings that it hears, with a consensus after each of them.

    .. math::
        x_i^+ = P_i^+ \left[ (P_i^-)^{-1} x_i^- + \sum_{j \in N_i} c_j^T y_j / r_j \right], \quad
        (P_i^+)^{-1} = (P_i^-)^{-1} + \sum_{j \in N_i} c_j^T c_j / r_j, \qquad
        x_i \leftarrow x_i + \gamma \sum_{j \in N_i} (x_j - x_i)

    Salehi (2013), eqs. (5.26), (5.27) and (5.34), with the indices of the sums put right. ``information`` is True,
    or None for the same by gains, which inverts nothing and is compiled without an inverse. Returns the last state of
    each node and its variance before the consensus, (n_rows, n_nodes) each.
    """
    nodes, n = heard.shape[0], len(size)
    A_columns, B, nothing = A.T.copy(), np.empty((n, 0)), np.empty(0)
    force, variance = np.empty((len(y), nodes)), np.empty((len(y), nodes))
    states, covariances = np.zeros((nodes, n)), np.empty((nodes, n, n))
    T, z, K = np.empty((n, n)), np.empty(n), np.empty(n)
    for i in range(nodes):
        copy(P, covariances[i])
    for k in range(len(y)):
        for i in range(nodes):
            x, covariance = states[i], covariances[i]
            pass_time(size, A, A_columns, B, Q, x, covariance, nothing, T, z)
            if information is not None:
                z[:] = 0.0
                T[:] = 0.0
                add_scaled(1.0, inverse(covariance), x, T, z)
            for j in range(len(C)):
                if not heard[i, j]:
                    continue
                if information is None:
                    take_in(size, C[j], R[j], x, covariance, y[k, j], T, z, K)
                else:
                    for row in range(n):
                        z[row] += C[j, row] * y[k, j] / R[j]
                        for column in range(n):
                            T[row, column] += C[j, row] * C[j, column] / R[j]
            if information is not None:
                copy(inverse(T), covariance)
                for row in range(n):
                    x[row] = 0.0
                    for column in range(n):
                        x[row] += covariance[row, column] * z[column]
        for _ in range(exchanges):
            told = states.copy()
            for i in range(nodes):
                for j in range(nodes):
                    if heard[i, j]:
                        for row in range(n):
                            states[i, row] += gamma * (told[j, row] - told[i, row])
        for i in range(nodes):
            force[k, i], variance[k, i] = states[i, n - 1], covariances[i, n - 1, n - 1]
    return force, variance


@kept
@njit(error_model="numpy")
def run_parallel(size, A, C, Q, R, P, sizes, exact, weighted, y):  # type: ignore[no-untyped-def]
    """Run a filter in each node on its own reading; return the last state as combined and its variance, (n_rows, 1).

    See `fdbench_baselines.kalman_parallel.KalmanParallel`; ``sizes`` weighs the diagonal in the traces.
    """
    nodes, n = len(C), len(size)
    A_columns, B, nothing = A.T.copy(), np.empty((n, 0)), np.empty(0)
    force, variance = np.empty((len(y), 1)), np.empty((len(y), 1))
    states, covariances = np.zeros((nodes, n)), np.empty((nodes, n, n))
    T, z, K = np.empty((n, n)), np.empty(n), np.empty(n)
    for i in range(nodes):
        copy(P, covariances[i])
    x, whole = np.zeros(n), P.copy()
    total, vector = np.empty((n, n)), np.empty(n)
    for k in range(len(y)):
        total[:] = 0.0
        vector[:] = 0.0
        if exact:
            pass_time(size, A, A_columns, B, Q, x, whole, nothing, T, z)
            add_scaled(1.0, inverse(whole), x, total, vector)
        for i in range(nodes):
            state, covariance = states[i], covariances[i]
            pass_time(size, A, A_columns, B, Q, state, covariance, nothing, T, z)
            if exact:
                add_scaled(-1.0, inverse(covariance), state, total, vector)
            take_in(size, C[i], R[i], state, covariance, y[k, i], T, z, K)
            trace = 0.0
            for row in range(n):
                trace += sizes[row] * covariance[row, row]
            # Weights that do not add up to 1 give the same estimate.
            add_scaled(1.0 / trace if weighted else 1.0, inverse(covariance), state, total, vector)
        copy(inverse(total), whole)
        for row in range(n):
            x[row] = 0.0
            for column in range(n):
                x[row] += whole[row, column] * vector[column]
        force[k, 0], variance[k, 0] = x[n - 1], whole[n - 1, n - 1]
    return force, variance


@kept
@njit(error_model="numpy")
def run_joint(F, L, n, y):  # type: ignore[no-untyped-def]
    r"""Run :math:`x \leftarrow F x + L y_k` on nodes of n states side by side; return the last state of each."""
    nodes = len(F) // n
    force = np.empty((len(y), nodes))
    x, z = np.zeros(len(F)), np.empty(len(F))
    for k in range(len(y)):
        for i in range(len(F)):
            s = 0.0
            for j in range(len(F)):
                s += F[i, j] * x[j]
            for j in range(y.shape[1]):
                s += L[i, j] * y[k, j]
            z[i] = s
        for i in range(len(F)):
            x[i] = z[i]
        for i in range(nodes):
            force[k, i] = x[(i + 1) * n - 1]
    return force
