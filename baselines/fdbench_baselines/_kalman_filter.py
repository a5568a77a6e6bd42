"""Kalman filter of a disturbed linear plant: the model with the force as a state, steady gains, and compiled loops."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.plants import StateSpace
from fdbench_baselines._kalman_kernels import run, run_constant

FloatArray = NDArray[np.float64]

LONGEST_DOUBLING = 60
PREDICTION, PREDICTION_VARIANCE, FORCE, FORCE_VARIANCE = range(4)
OUT_COLUMNS = 4


class Observer(NamedTuple):
    r"""Discrete model :math:`x^+ = A x + B u + w, \; y = C x + v` whose last state is the force.

    Attributes
    ----------
    A, B, C : (n, n), (n, n_inputs), (n_outputs, n) arrays
    Q : (n, n) array
        Covariance of w, with that of the inputs' readings in it.
    R : (n_outputs,) array
        Variances of v.
    P : (n, n) array
        Covariance at the start, one sampling time before the first reading.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    Q: FloatArray
    R: FloatArray
    P: FloatArray


def with_force(space: StateSpace) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A, B and C with the force as last state; Salehi (2013), eq. (3.7)."""
    n, m = space.B.shape
    A, B, C = np.zeros((n + 1, n + 1)), np.zeros((n + 1, m)), np.zeros((len(space.C), n + 1))
    A[:n, :n], A[:n, n], B[:n], C[:, :n] = space.A, space.E, space.B, space.C
    return A, B, C


def observer(
    space: StateSpace, sampling_time_s: float, q_N2_per_s: float, initial_force_N: float, within: bool
) -> Observer:
    r"""Return the discrete model of a plant whose force is a random walk of density q.

    The inputs are held, so the noise of their readings enters as they do. The force drifts ``within`` the sampling time
    (Van Loan 1978), :math:`Q = q \int_0^{T_s} e^{A\tau} g g^T e^{A^T\tau} d\tau`, or steps at its end,
    :math:`Q = q T_s g g^T`.
    """
    from scipy.linalg import expm

    A, B, C = with_force(space)
    n, m = B.shape
    generator = np.zeros((n + m, n + m))
    generator[:n, :n], generator[:n, n:] = A, B
    flow = expm(generator * sampling_time_s)
    Ad, Bd = np.ascontiguousarray(flow[:n, :n]), np.ascontiguousarray(flow[:n, n:])
    walk = np.zeros((n, n))
    walk[-1, -1] = q_N2_per_s
    Q = walk * sampling_time_s
    if within:
        double = np.block([[-A, walk], [np.zeros((n, n)), A.T]])
        Q = Ad @ expm(double * sampling_time_s)[:n, n:]
    Q = 0.5 * (Q + Q.T) + Bd * space.input_variances @ Bd.T
    Q[np.diag_indices(n)] += np.append(space.process_variances, 0.0)
    P = np.diag(np.append(space.initial_variances, initial_force_N**2))
    return Observer(Ad, Bd, C, Q, space.output_variances.astype(np.float64), P)


def steady_covariance(model: Observer) -> FloatArray:
    r"""Return the steady covariance before a reading, by structure-preserving doubling.

    .. math::
        W = I + G_k H_k, \quad A_{k+1} = A_k W^{-1} A_k, \quad G_{k+1} = G_k + A_k W^{-1} G_k A_k^T, \quad
        H_{k+1} = H_k + A_k^T H_k W^{-1} A_k

    from :math:`A_0 = A^T, G_0 = C^T R^{-1} C, H_0 = Q`; H converges quadratically. States are scaled by powers of two,
    which costs no rounding. The gain of the filter is :math:`K = P C^T (C P C^T + R)^{-1}`, and that of the predictor,
    which several tools return in its place, A K.

    Source: Anderson (1978), Int. J. Control 28, 295-306; Chu, Fan, Lin, Wang (2004), Int. J. Control 77, 767-788.

    Raises
    ------
    SpecError
        If there is no steady state, as where an unstable or integrating state is not observed.
    """
    scale = 2.0 ** np.round(np.log2(_sizes(model)))
    A = (model.A / scale[:, None] * scale).T
    C = model.C * scale
    G = (C.T / model.R) @ C
    H = model.Q / scale[:, None] / scale
    eye = np.eye(len(A))
    for _ in range(LONGEST_DOUBLING):
        solved = np.linalg.solve(eye + G @ H, np.hstack((A, G @ A.T)))
        WA, WGA = solved[:, : len(A)], solved[:, len(A) :]
        change = A.T @ H @ WA
        A, G, H = A @ WA, G + A @ WGA, H + change
        G, H = 0.5 * (G + G.T), 0.5 * (H + H.T)
        if not np.isfinite(H).all():
            break
        if np.abs(change).max() <= 1e-16 * np.abs(H).max():
            P: FloatArray = H * scale[:, None] * scale
            return P
    raise SpecError("kalman: there is no steady gain; an integrating state may not be observed by any output.")


def _sizes(model: Observer) -> FloatArray:
    """Return a size of each state, its deviation after the noises of two samples 64 apart; 1 where there is none."""
    reach = np.linalg.matrix_power(model.A, 64)
    size = np.sqrt(np.diag(model.Q + reach @ model.Q @ reach.T))
    return np.where(size > 0.0, size, 1.0)


def gain(P: FloatArray, C: FloatArray, R: FloatArray) -> FloatArray:
    """Return the gain of the filter, (n, n_outputs), for the covariance before a reading."""
    return np.asarray(np.linalg.solve(C @ P @ C.T + np.diag(R), C @ P).T, dtype=np.float64)


def continuous_gain(space: StateSpace, sampling_time_s: float, q_N2_per_s: float) -> tuple[FloatArray, FloatArray]:
    r"""Return gain and covariance of the continuous filter; Salehi (2013), eqs. (3.11) and (3.12).

    .. math:: A P + P A^T + G Q G^T - P C^T R^{-1} C P = 0, \quad K = P C^T R^{-1}

    with densities R and Q: the variance of a reading times the sampling time, and of an input's too.
    """
    from scipy.linalg import solve_continuous_are

    A, B, C = with_force(space)
    Q = B * (space.input_variances * sampling_time_s) @ B.T
    Q[np.diag_indices(len(A))] += np.append(space.process_variances / sampling_time_s, q_N2_per_s)
    R = space.output_variances * sampling_time_s
    # In states of the size of a reading's noise, and readings of density 1, the equation is well scaled.
    seen = np.abs(space.C / np.sqrt(space.output_variances)[:, None]).max(axis=0)
    scale = np.append(1.0 / np.where(seen > 0.0, seen, seen[seen > 0.0].min()), 1.0)
    T, outputs = A / scale[:, None] * scale, C * scale / np.sqrt(R)[:, None]
    try:
        scaled = solve_continuous_are(T.T, outputs.T, Q / scale[:, None] / scale, np.eye(len(R)))
    except np.linalg.LinAlgError as error:
        raise SpecError(f"kalman: the continuous filter has no steady gain: {error}.") from error
    P = scaled * scale[:, None] * scale
    return P @ C.T / R, P


def filter_readings(
    model: Observer, x: FloatArray, P: FloatArray, u: FloatArray, y: FloatArray
) -> tuple[FloatArray, float]:
    r"""Pass time and take in a reading, row by row, in the form of Joseph; return estimates and log-likelihood.

    .. math::
        x \leftarrow A x + B u_k, \; P \leftarrow A P A^T + Q; \qquad
        K = P c^T / (c P c^T + r), \; x \leftarrow x + K (y_k - c x), \;
        P \leftarrow (I - K c) P (I - K c)^T + K r K^T

    for each output in turn, which is exact as their noises are independent.

    Parameters
    ----------
    model : Observer
    x, P : (n,), (n, n) arrays, changed in place
    u, y : (n_rows, n_inputs), (n_rows, n_outputs) arrays
        Inputs held before each reading, and the readings.

    Returns
    -------
    out : (n_rows, 4) array
        First output as predicted and its variance as a reading; force after the reading and its variance.
    log_likelihood : float
    """
    out = np.empty((len(y), OUT_COLUMNS))
    return out, run((0,) * len(x), model, x, P, u, y, out)


class ConstantFilter(NamedTuple):
    """A filter of constant gain, as `run_constant` takes it, and the variances that it claims."""

    F: FloatArray
    G: FloatArray
    L: FloatArray
    c_A: FloatArray
    c_B: FloatArray
    prediction_variance: float
    force_variance: float


def steady_filter(model: Observer) -> ConstantFilter:
    """Return the filter with the steady gain, (I - K C) A and so on."""
    P = steady_covariance(model)
    K = gain(P, model.C, model.R)
    rest = np.eye(len(K)) - K @ model.C
    c, force = model.C[0], (rest @ P)[-1, -1]
    return ConstantFilter(
        rest @ model.A, rest @ model.B, K, c @ model.A, c @ model.B, float(c @ P @ c + model.R[0]), float(force)
    )


def continuous_filter(space: StateSpace, sampling_time_s: float, q_N2_per_s: float) -> ConstantFilter:
    r"""Return the continuous filter with each reading held over the sampling time before it.

    .. math:: x^+ = e^{(A - K C) T_s} x + \int_0^{T_s} e^{(A - K C)\tau} d\tau\, (K y + B u)

    Salehi (2013), eq. (3.9), with tau in the exponent.
    """
    from scipy.linalg import expm

    K, P = continuous_gain(space, sampling_time_s, q_N2_per_s)
    A, B, C = with_force(space)
    n, m = B.shape

    def flow(state: FloatArray, driven: FloatArray) -> FloatArray:
        generator = np.zeros((n + driven.shape[1],) * 2)
        generator[:n, :n], generator[:n, n:] = state, driven
        step: FloatArray = expm(generator * sampling_time_s)[:n]
        return step

    closed, opened = flow(A - K @ C, np.hstack((B, K))), flow(A, B)
    variance = C[0] @ P @ C[0] + space.output_variances[0]
    parts = closed[:, :n], closed[:, n : n + m], closed[:, n + m :]
    F, G, L = (np.ascontiguousarray(part) for part in parts)
    return ConstantFilter(F, G, L, C[0] @ opened[:, :n], C[0] @ opened[:, n:], float(variance), float(P[-1, -1]))


def run_constant_filter(constant: ConstantFilter, x: FloatArray, u: FloatArray, y: FloatArray) -> FloatArray:
    """Return what `filter_readings` does, for a filter of constant gain."""
    out = np.empty((len(y), OUT_COLUMNS))
    run_constant(*constant[:5], x, u, y, out)
    out[:, PREDICTION_VARIANCE], out[:, FORCE_VARIANCE] = constant.prediction_variance, constant.force_variance
    return out
