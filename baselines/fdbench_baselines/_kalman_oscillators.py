r"""Kalman filter and smoother of a linear model whose disturbance is a random walk and oscillators at harmonics.

.. math::
    y_k = z_k^T b + m v_k + w_k + \sum_h c_{h,k} + e_k, \quad b^+ = b, \quad m^+ = m, \quad w^+ = w + \eta, \quad
    \begin{pmatrix} c_h \\ s_h \end{pmatrix}^+ = \rho
    \begin{pmatrix} \cos h\omega & \sin h\omega \\ -\sin h\omega & \cos h\omega \end{pmatrix}
    \begin{pmatrix} c_h \\ s_h \end{pmatrix} + \zeta_h

The force has a part that grows with the feed, as that of a cut does; a walk; and waves. Here b, standard normal at the
start, are the parameters about the nominal ones, in units of what the data sheet leaves open, so that all states have
about the size of y. The smoother is that of de Jong, which inverts no covariance.

References
----------
Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 1989, section 2.3; Durbin and Koopman, Time
Series Analysis by State Space Methods, 2nd ed. 2012, sections 4.3 to 4.4 and 7.2.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench.estimator import FloatArray


class Variances(NamedTuple):
    """What the likelihood decides on; variances in units of y squared.

    Attributes
    ----------
    reading : float
        Variance of e.
    walk : float
        Variance of eta, per sample.
    wave : float
        Variance of c_h and s_h for as long as nothing is known of them.
    memory : float
        rho, what is left of an oscillator after a sample; between 0 and 1.
    angle : float
        omega, rad a sample.
    slope : float
        Variance of m, the process force for a feed of the size of the whole record's.
    """

    reading: float
    walk: float
    wave: float
    memory: float
    angle: float
    slope: float = 0.0


class Filtered(NamedTuple):
    """What the filter leaves for the smoother: `states` and `covariances` before each reading.

    Attributes
    ----------
    errors, variances : (n,) arrays
        Innovations and their variances.
    states, covariances : (n + 1, m), (n + 1, m, m) arrays
        The last row is that after the last reading and a further step.
    log_likelihood : float
    """

    errors: FloatArray
    variances: FloatArray
    states: FloatArray
    covariances: FloatArray
    log_likelihood: float


@njit(error_model="numpy")
def rotations(memory: float, angle: float, harmonics: int) -> tuple[FloatArray, FloatArray]:
    """Return the cosines and sines of a sampling time of each oscillator, with what is left of it as length."""
    cosines, sines = np.empty(harmonics), np.empty(harmonics)
    for h in range(harmonics):
        cosines[h], sines[h] = memory * np.cos(angle * (h + 1)), memory * np.sin(angle * (h + 1))
    return cosines, sines


@njit(error_model="numpy")
def turn(x: FloatArray, first: int, cosines: FloatArray, sines: FloatArray) -> None:
    """Let one sampling time pass over a vector of states, in place."""
    for h in range(cosines.size):
        i = first + 2 * h
        c, s = x[i], x[i + 1]
        x[i], x[i + 1] = cosines[h] * c + sines[h] * s, cosines[h] * s - sines[h] * c


@njit(error_model="numpy")
def turn_back(x: FloatArray, first: int, cosines: FloatArray, sines: FloatArray) -> None:
    """Multiply a vector of states by the transpose of a sampling time, in place."""
    for h in range(cosines.size):
        i = first + 2 * h
        c, s = x[i], x[i + 1]
        x[i], x[i + 1] = cosines[h] * c - sines[h] * s, cosines[h] * s + sines[h] * c


@njit(error_model="numpy")
def store(k: int, x: FloatArray, P: FloatArray, states: FloatArray, covariances: FloatArray) -> None:
    """Write state k. An assignment to a slice would be compiled with the text of an error of shapes, for seconds."""
    for i in range(x.size):
        states[k, i] = x[i]
        for j in range(x.size):
            covariances[k, i, j] = P[i, j]


@kept
@njit(error_model="numpy")
def run_filter(Z, y, loud, sudden, own, noise, harmonics, keep):  # type: ignore[no-untyped-def]
    """Return the fields of `Filtered` for whitened regressors Z (n, p) and rows ``loud`` times as noisy as others.

    The first ``own`` columns belong to parameters, those that follow to the process force. Before a ``sudden`` row walk
    and waves may become anything within 1, as where a tool enters.
    Without ``keep`` the states and covariances are the last ones alone.
    """
    n, p = Z.shape
    m = p + 1 + 2 * harmonics
    reading, walk, wave, memory, angle, slope = noise
    cosines, sines = rotations(memory, angle, harmonics)
    fresh = wave * (1.0 - memory**2)
    x, P, h, K = np.zeros(m), np.zeros((m, m)), np.zeros(m), np.empty(m)
    for i in range(own):
        P[i, i] = 1.0
    for i in range(p, m):
        P[i, i] = wave
        h[i] = 1.0 if i == p or (i - p) % 2 == 1 else 0.0
    for i in range(own, p):
        P[i, i] = slope
    P[p, p] = 1.0
    stored = n + 1 if keep else 1
    states, covariances = np.empty((stored, m)), np.empty((stored, m, m))
    errors, variances = np.empty(n), np.empty(n)
    log_likelihood = -0.5 * n * np.log(2.0 * np.pi)
    for k in range(n):
        if sudden[k]:
            for i in range(p, m):
                P[i, i] += 1.0
        if keep:
            store(k, x, P, states, covariances)
        for i in range(p):
            h[i] = Z[k, i]
        K[:] = 0.0
        error, S = y[k], reading * loud[k]
        for i in range(m):
            if h[i] != 0.0:
                error -= h[i] * x[i]
                for j in range(m):
                    K[j] += h[i] * P[i, j]
        for i in range(m):
            S += h[i] * K[i]
        errors[k], variances[k] = error, S
        log_likelihood -= 0.5 * (np.log(S) + error * error / S)
        for i in range(m):
            scaled = K[i] / S
            x[i] += scaled * error
            for j in range(m):
                P[i, j] -= scaled * K[j]
        turn(x, p + 1, cosines, sines)
        for i in range(m):
            turn(P[i], p + 1, cosines, sines)
        for q in range(harmonics):
            i = p + 1 + 2 * q
            for j in range(m):
                c, s = P[i, j], P[i + 1, j]
                P[i, j], P[i + 1, j] = cosines[q] * c + sines[q] * s, cosines[q] * s - sines[q] * c
        P[p, p] += walk
        for i in range(p + 1, m):
            P[i, i] += fresh
        for i in range(m):
            for j in range(i):
                P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
    store(stored - 1, x, P, states, covariances)
    return errors, variances, states, covariances, log_likelihood


@kept
@njit(error_model="numpy")
def run_smoother(Z, own, noise, harmonics, errors, variances, states, covariances):  # type: ignore[no-untyped-def]
    """Return the whole force at each sample given all of them, and its variance, both (n,)."""
    n, p = Z.shape
    m = states.shape[1]
    memory, angle = noise[3], noise[4]
    cosines, sines = rotations(memory, angle, harmonics)
    h, force = np.zeros(m), np.zeros(m)
    for i in range(p, m):
        force[i] = 1.0 if i == p or (i - p) % 2 == 1 else 0.0
    r, N, K, NK, Pf, NPf = np.zeros(m), np.zeros((m, m)), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    mean, variance = np.empty(n), np.empty(n)
    for k in range(n - 1, -1, -1):
        P, S = covariances[k], variances[k]
        for i in range(p, m):
            h[i] = force[i]
        for i in range(p):
            h[i] = Z[k, i]
            force[i] = h[i] if i >= own else 0.0
        turn_back(r, p + 1, cosines, sines)
        for i in range(m):
            turn_back(N[i], p + 1, cosines, sines)
        for q in range(harmonics):
            i = p + 1 + 2 * q
            for j in range(m):
                c, s = N[i, j], N[i + 1, j]
                N[i, j], N[i + 1, j] = cosines[q] * c - sines[q] * s, cosines[q] * s + sines[q] * c
        K[:] = 0.0
        Pf[:] = 0.0
        for i in range(m):
            for j in range(m):
                K[j] += h[i] * P[i, j] / S
                Pf[j] += force[i] * P[i, j]
        weight, square = errors[k] / S, 1.0 / S
        NK[:] = 0.0
        for i in range(m):
            weight -= K[i] * r[i]
            for j in range(m):
                NK[j] += K[i] * N[i, j]
        for i in range(m):
            square += K[i] * NK[i]
        for i in range(m):
            r[i] += h[i] * weight
            for j in range(m):
                N[i, j] += square * h[i] * h[j] - h[i] * NK[j] - NK[i] * h[j]
        mean[k], variance[k] = 0.0, 0.0
        NPf[:] = 0.0
        for i in range(m):
            for j in range(m):
                NPf[j] += Pf[i] * N[i, j]
        for i in range(m):
            mean[k] += force[i] * states[k, i] + Pf[i] * r[i]
            variance[k] += force[i] * Pf[i] - Pf[i] * NPf[i]
        if variance[k] < 0.0:
            variance[k] = 0.0
    return mean, variance
