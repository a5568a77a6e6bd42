r"""Kalman filter and smoother of a motion whose acceleration is linear in coefficients that drift.

.. math::
    x^+ = x + v + \tfrac12 a_k, \quad v^+ = v + a_k + \kappa, \quad a_k = \alpha_k + g_k^T \theta, \quad
    \theta_j^+ = \rho_j \theta_j + \eta_j, \qquad y_k = x_k + e \;\text{ or }\; v_k + e

in units of a sample and of the reading, so that all states have about the size of y. Parameters of the drive are
coefficients that stay (:math:`\rho = 1, \eta = 0`), walks drift, amplitudes of waves forget. A record of positions may
begin in motion: at its first sample v has the mean square of the record's changes as its variance. The smoother is that
of Rauch, Tung and Striebel in the form of de Jong, which inverts no covariance.

References
----------
Rauch, Tung, Striebel, AIAA Journal 3 (1965), 1445-1450; de Jong, J. American Statistical Association 84 (1989),
1085-1088; Durbin and Koopman, Time Series Analysis by State Space Methods, 2nd ed. 2012, sections 4.3 and 4.4; de
Jong and Penzer, J. American Statistical Association 93 (1998), 796-806 (shocks).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.estimator import FloatArray

MOTION = 2
THINNED = 64  # samples of which one is asked for mean squares


class ForcedMotion(NamedTuple):
    """What is known of each sample.

    Attributes
    ----------
    known : (n,) array
        alpha.
    columns : (n, m) array
        g.
    reading : (n,) array
        y.
    missing : (n,) array of bool
        Readings that are not taken in.
    jolt : (n,) array
        Variance that the velocity gains in the sample beside that of kappa, as where the force is not known.
    shock : (n,) array of bool
        Samples at which coefficients that forget may become anything, as where a tool enters.
    place : int
        Which state is read: 0, the position, or 1, the velocity.
    """

    known: FloatArray
    columns: FloatArray
    reading: FloatArray
    missing: NDArray[np.bool_]
    jolt: FloatArray
    shock: NDArray[np.bool_]
    place: int


class Drift(NamedTuple):
    """How the states go on; variances in units of the reading.

    Attributes
    ----------
    reading, kick : float
        Variances of e and kappa.
    kept_share : (m,) array
        rho.
    fresh, start : (m,) arrays
        Variances of eta, and of theta at the first sample.
    """

    reading: float
    kick: float
    kept_share: FloatArray
    fresh: FloatArray
    start: FloatArray


class Passed(NamedTuple):
    """What the filter leaves for the smoother, states and covariances being those before each reading.

    Attributes
    ----------
    errors, variances : (n,) arrays
        Innovations, and their variances; inf where a reading is missing.
    states, covariances : (n + 1, m + 2), (n + 1, m + 2, m + 2) arrays
        Of position, velocity and theta; the last row is that after the last sample.
    log_likelihood : float
        Of the readings, beside a constant.
    """

    errors: FloatArray
    variances: FloatArray
    states: FloatArray
    covariances: FloatArray
    log_likelihood: float


class Smoothed(NamedTuple):
    """What all readings say.

    Attributes
    ----------
    mean, variance : (n,) arrays
        Of the sums of coefficients asked for.
    shocks : (n,) array
        Largest square, in deviations, by which a coefficient that forgets seems to jump before a sample: de Jong and
        Penzer (1998), eq. (14).
    squares : (m,) array
        Mean squares of the coefficients over the record, each sample's own uncertainty in it.
    """

    mean: FloatArray
    variance: FloatArray
    shocks: FloatArray
    squares: FloatArray


def smoothed(motion: ForcedMotion, drift: Drift, run: Passed, sums: FloatArray) -> Smoothed:
    r"""Return :math:`s_k^T \theta_k` given all readings, for ``sums`` s (n, m)."""
    behind = run.errors, run.variances, run.states[:-1], run.covariances[:-1]
    return Smoothed(*run_backward(motion.columns, drift.kept_share, motion.place, sums, *behind))


def passed(motion: ForcedMotion, drift: Drift, keep: bool = True) -> Passed:
    """Run the filter; without ``keep`` states and covariances are the last ones alone."""
    return Passed(*run_motion(*motion, *drift, keep))


@njit(error_model="numpy")
def pass_sample(g, kept_share, x, P):  # type: ignore[no-untyped-def]
    """Let a sample pass over states and covariance, in place, without its noise."""
    M = len(x)
    a = 0.0
    for j in range(MOTION, M):
        a += g[j - MOTION] * x[j]
        x[j] *= kept_share[j - MOTION]
    x[0] += x[1] + 0.5 * a
    x[1] += a
    for i in range(M):
        a = 0.0
        for j in range(MOTION, M):
            a += g[j - MOTION] * P[i, j]
            P[i, j] *= kept_share[j - MOTION]
        P[i, 0] += P[i, 1] + 0.5 * a
        P[i, 1] += a
    for j in range(M):
        a = 0.0
        for i in range(MOTION, M):
            a += g[i - MOTION] * P[i, j]
            P[i, j] *= kept_share[i - MOTION]
        P[0, j] += P[1, j] + 0.5 * a
        P[1, j] += a


@njit(error_model="numpy")
def store(k, x, P, states, covariances):  # type: ignore[no-untyped-def]
    """Write state k. An assignment to a slice would be compiled with the text of an error of shapes, for seconds."""
    for i in range(len(x)):
        states[k, i] = x[i]
        for j in range(len(x)):
            covariances[k, i, j] = P[i, j]


@njit(error_model="numpy")
def begin_in_motion(y, place, P):  # type: ignore[no-untyped-def]
    """Write the velocity's variance at the first sample of positions: it may be any that the record has later."""
    if place == 0 and len(y) > 1:
        P[1, 1] = np.mean((y[1:] - y[:-1]) ** 2)


@kept
@njit(error_model="numpy")
def run_motion(  # type: ignore[no-untyped-def]
    known, columns, y, missing, jolt, shock, place, reading, kick, kept_share, fresh, start, keep
):
    """Return the fields of `Passed`."""
    n, m = columns.shape
    M = m + MOTION
    x, P, K = np.zeros(M), np.zeros((M, M)), np.empty(M)
    x[place] = y[0]
    P[0, 0] = P[1, 1] = reading
    begin_in_motion(y, place, P)
    for j in range(m):
        P[j + MOTION, j + MOTION] = start[j]
    stored = n + 1 if keep else 1
    states, covariances = np.empty((stored, M)), np.empty((stored, M, M))
    errors, variances = np.zeros(n), np.full(n, np.inf)
    log_likelihood = 0.0
    for k in range(n):
        if shock[k]:
            for j in range(m):
                if kept_share[j] < 1.0:
                    P[j + MOTION, j + MOTION] += start[j]
        if keep:
            store(k, x, P, states, covariances)
        if not missing[k]:
            error, S = y[k] - x[place], P[place, place] + reading
            errors[k], variances[k] = error, S
            log_likelihood -= 0.5 * (np.log(S) + error * error / S)
            for i in range(M):
                K[i] = P[i, place]
            for i in range(M):
                scaled = K[i] / S
                x[i] += scaled * error
                for j in range(M):
                    P[i, j] -= scaled * K[j]
        pass_sample(columns[k], kept_share, x, P)
        x[0] += 0.5 * known[k]
        x[1] += known[k]
        P[1, 1] += kick + jolt[k]
        for j in range(m):
            P[j + MOTION, j + MOTION] += fresh[j]
        for i in range(M):
            for j in range(i):
                P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
    store(stored - 1, x, P, states, covariances)
    return errors, variances, states, covariances, log_likelihood


@njit(error_model="numpy")
def pass_back(g, kept_share, r, N):  # type: ignore[no-untyped-def]
    """Multiply r, and N from both sides, by the transpose of a sample, in place."""
    M = len(r)
    for j in range(MOTION, M):
        r[j] = kept_share[j - MOTION] * r[j] + g[j - MOTION] * (0.5 * r[0] + r[1])
    r[1] += r[0]
    for i in range(M):
        for j in range(MOTION, M):
            N[i, j] = kept_share[j - MOTION] * N[i, j] + g[j - MOTION] * (0.5 * N[i, 0] + N[i, 1])
        N[i, 1] += N[i, 0]
    for j in range(M):
        for i in range(MOTION, M):
            N[i, j] = kept_share[i - MOTION] * N[i, j] + g[i - MOTION] * (0.5 * N[0, j] + N[1, j])
        N[1, j] += N[0, j]


@njit(error_model="numpy")
def add_squares(state, P, r, N, squares):  # type: ignore[no-untyped-def]
    """Add the mean squares of the coefficients given all readings."""
    M = len(r)
    for j in range(MOTION, M):
        value, left = state[j], P[j, j]
        for i in range(M):
            value += P[j, i] * r[i]
            for q in range(M):
                left -= P[j, i] * N[i, q] * P[q, j]
        squares[j - MOTION] += value * value + max(left, 0.0)


@kept
@njit(error_model="numpy")
def run_backward(columns, kept_share, place, sums, errors, variances, states, covariances):  # type: ignore[no-untyped-def]
    r"""Return the fields of `Smoothed` for ``sums`` s (n, m)."""
    n, m = columns.shape
    M = m + MOTION
    r, N, NK, Ps, NPs = np.zeros(M), np.zeros((M, M)), np.empty(M), np.empty(M), np.empty(M)
    mean, variance, shocks = np.empty(n), np.empty(n), np.zeros(n)
    squares, thinned = np.zeros(m), 0
    for k in range(n - 1, -1, -1):
        g, P = columns[k], covariances[k]
        pass_back(g, kept_share, r, N)
        if variances[k] < np.inf:
            S = variances[k]
            weight, square = errors[k] / S, 1.0 / S
            for i in range(M):
                NK[i] = 0.0
            for i in range(M):
                gain = P[i, place] / S
                weight -= gain * r[i]
                for j in range(M):
                    NK[j] += gain * N[i, j]
            for i in range(M):
                square += P[i, place] / S * NK[i]
            r[place] += weight
            N[place, place] += square
            for i in range(M):
                N[i, place] -= NK[i]
                N[place, i] -= NK[i]
        mean[k], variance[k] = 0.0, 0.0
        for i in range(M):
            Ps[i] = NPs[i] = 0.0
        for j in range(MOTION, M):
            s = sums[k, j - MOTION]
            mean[k] += s * states[k, j]
            for i in range(M):
                Ps[i] += s * P[i, j]
        for i in range(M):
            for j in range(M):
                NPs[j] += Ps[i] * N[i, j]
        for i in range(M):
            mean[k] += Ps[i] * r[i]
            variance[k] -= Ps[i] * NPs[i]
        for j in range(MOTION, M):
            variance[k] += sums[k, j - MOTION] * Ps[j]
        variance[k] = max(variance[k], 0.0)
        for j in range(MOTION, M):
            if kept_share[j - MOTION] < 1.0 and N[j, j] > 0.0:
                shocks[k] = max(shocks[k], r[j] * r[j] / N[j, j])
        if k % THINNED == 0:
            thinned += 1
            add_squares(states[k], P, r, N, squares)
    return mean, variance, shocks, squares / thinned
