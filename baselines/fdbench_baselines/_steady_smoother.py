r"""Fixed-interval smoother of a time-invariant linear model at the steady gain of its Kalman filter.

.. math::
    e_k = y_k - C \hat x_k, \quad \hat x_{k+1} = A (\hat x_k + K e_k) + B u_{k+1}, \qquad
    r_k = C^T S^{-1} e_k + (I - K C)^T A^T r_{k+1}, \quad \hat x_{k|n} = \hat x_k + P r_k

with P the steady covariance before a reading, :math:`S = C P C^T + R` and :math:`K = P C^T S^{-1}`. It is the smoother
of Rauch, Tung and Striebel in the form of Bryson and Frazier, which inverts no covariance. Where the record starts, the
state is uncertain by D beyond P, and innovations are linear in it, so that

.. math::
    \hat x_0 = D (I + N D)^{-1} r_0, \qquad N = C^T S^{-1} C + (I - K C)^T A^T N A (I - K C)

with r_0 that of a filter which starts at 0.

References
----------
Rauch, Tung, Striebel, AIAA Journal 3 (1965), 1445-1450; Bryson and Frazier, Smoothing for linear and nonlinear dynamic
systems, 1963; de Jong, The diffuse Kalman filter, Annals of Statistics 19 (1991), 1073-1083 (the start); Durbin and
Koopman, Time Series Analysis by State Space Methods, 2nd ed. 2012, section 4.4.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench.estimator import FloatArray
from fdbench_baselines._kalman_filter import Observer, gain, steady_covariance


class Steady(NamedTuple):
    """A model with its steady filter, readings in units of their noise and states in units of P's diagonal.

    Attributes
    ----------
    A, B, C, K, S, P : arrays
        Of the model, the gain, and the covariances of a reading and of the states before it.
    information : (n_outputs, n) array
        S^-1 C.
    beyond : (n, n) array
        D, by which the covariance at the first reading exceeds P.
    size, noise : (n,), (n_outputs,) arrays
        SI values of states and readings at 1.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    K: FloatArray
    S: FloatArray
    P: FloatArray
    information: FloatArray
    beyond: FloatArray
    size: FloatArray
    noise: FloatArray

    @property
    def transition(self) -> FloatArray:
        """What takes an adjoint one sample back, (I - K C)^T A^T."""
        return np.ascontiguousarray((self.A @ (np.eye(len(self.P)) - self.K @ self.C)).T)


class SteadyFiltered(NamedTuple):
    """The steady filter of a model, run over readings in units of their noise, with states in units of P's diagonal.

    Attributes
    ----------
    P, N, S : (n, n), (n, n), (n_outputs, n_outputs) arrays
    states, errors : (n_rows, n), (n_rows, n_outputs) arrays
        Before each reading, and the innovations.
    adjoints : (n_rows, n) array
        r of each row.
    size : (n,) array
        SI values of the states at 1.
    """

    P: FloatArray
    N: FloatArray
    S: FloatArray
    states: FloatArray
    errors: FloatArray
    adjoints: FloatArray
    size: FloatArray

    @property
    def scale(self) -> float:
        """Factor on all variances of the model under which the readings are likeliest."""
        return float(np.mean(self.errors * np.linalg.solve(self.S, self.errors.T).T))

    @property
    def log_likelihood(self) -> float:
        """Of the readings, beside a constant, with all variances times `scale`."""
        n, outputs = self.errors.shape
        log_determinant = float(np.linalg.slogdet(self.S)[1])
        return float(-0.5 * n * (outputs * math.log(self.scale) + log_determinant))

    def smoothed(self, number: int) -> tuple[FloatArray, float]:
        """Return a state (n_rows,) given all readings, and the variance that it has in mid-record; SI units."""
        states = self.states[:, number] + self.adjoints @ self.P[:, number]
        variance = self.scale * (self.P - self.P @ self.N @ self.P)[number, number]
        return states * self.size[number], float(variance * self.size[number] ** 2)


@kept
@njit(error_model="numpy")
def run_forward(A, B, C, K, start, u, y, states, errors):  # type: ignore[no-untyped-def]
    """Write states before each reading, ``start`` before the first one but for its input, and innovations."""
    n, ahead, now = len(start), start.copy(), np.empty(len(start))
    for k in range(y.shape[0]):
        for i in range(n):
            s = ahead[i]
            for j in range(u.shape[1]):
                s += B[i, j] * u[k, j]
            states[k, i] = now[i] = s
        for row in range(y.shape[1]):
            s = y[k, row]
            for j in range(n):
                s -= C[row, j] * states[k, j]
            errors[k, row] = s
            for i in range(n):
                now[i] += K[i, row] * s
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += A[i, j] * now[j]
            ahead[i] = s


@kept
@njit(error_model="numpy")
def run_backward(transition, weighted, adjoints):  # type: ignore[no-untyped-def]
    """Write r of each row, from the last one on; ``weighted`` is C^T S^-1 e, ``transition`` (I - K C)^T A^T."""
    n, later = len(transition), np.zeros(len(transition))
    for k in range(len(weighted) - 1, -1, -1):
        for i in range(n):
            s = weighted[k, i]
            for j in range(n):
                s += transition[i, j] * later[j]
            adjoints[k, i] = s
        for i in range(n):
            later[i] = adjoints[k, i]


def settled(model: Observer) -> Steady:
    """Return the steady filter of a model, whose P is the covariance one sampling time before the first reading."""
    P = steady_covariance(model)
    size, noise = np.sqrt(np.diag(P)), np.sqrt(model.R)
    A, B, C = model.A / size[:, None] * size, model.B / size[:, None], model.C / noise[:, None] * size
    P, start = P / np.outer(size, size), model.P / np.outer(size, size)
    K, S = np.ascontiguousarray(gain(P, C, np.ones(len(C)))), C @ P @ C.T + np.eye(len(C))
    return Steady(A, B, C, K, S, P, np.linalg.solve(S, C), A @ start @ A.T, size, noise)


def filtered(model: Observer, u: FloatArray, y: FloatArray) -> SteadyFiltered:
    """Filter inputs (n_rows, n_inputs) and outputs (n_rows, n_outputs) forwards, and their innovations backwards.

    ``model.P`` is the covariance one sampling time before the first reading.

    Raises
    ------
    SpecError
        If the model has no steady gain.
    """
    from scipy.linalg import solve_discrete_lyapunov

    A, B, C, K, S, P, information, beyond, size, noise = steady = settled(model)
    transition = steady.transition
    N = np.asarray(solve_discrete_lyapunov(transition, C.T @ information), dtype=np.float64)
    states, errors, adjoints = np.empty((len(y), len(P))), np.empty(y.shape), np.empty((len(y), len(P)))
    first = np.zeros(len(P))
    for _ in range(2):
        run_forward(A, B, C, K, first, u, y / noise, states, errors)
        run_backward(transition, np.ascontiguousarray(errors @ information), adjoints)
        first = first + beyond @ np.linalg.solve(np.eye(len(P)) + N @ beyond, adjoints[0])
    return SteadyFiltered(P, N, S, states, errors, adjoints, size)
