r"""A bank of extended Kalman filters of a drive's parameters and of a periodic force that drifts and grows, compiled.

State of a filter, and how a row of time T passes over it:

.. math::
    x = (b, w, \delta, \alpha, c_1, s_1 \ldots c_H, s_H, m_0, m_1, c'_1, s'_1 \ldots c'_H, s'_H), \qquad
    (c_h + i s_h)^+ = e^{(\alpha - 1/\tau) T}\, e^{-i h (1 + \delta) \omega T} (c_h + i s_h) + \zeta_h

.. math::
    y = z^T b + w + \sum_h c_h + m_0 \operatorname{sign}(v) + v \Big( m_1 + \sum_h c'_h \Big) + e

with parameters b, a walk w, the relative slip of the frequency, the growth rate of the waves, and, in a filter of a
cutter, a mean force and waves that grow with the feed v. Slip and growth enter as exponent of a turning pointer, whose
derivatives are :math:`-i h \omega T` and T times the pointer itself: the one place where the filter is extended.

References
----------
La Scala, Bitmead, Quinn, An extended Kalman filter frequency tracker for high-noise environments, IEEE Trans. Signal
Processing 44 (1996), 431-434 (slip); Magill, Optimal adaptive estimation of sampled stochastic processes, IEEE Trans.
Automatic Control 10 (1965), 434-439 (bank); Shumway and Stoffer, An approach to time series smoothing and forecasting
using the EM algorithm, J. Time Series Analysis 3 (1982), 253-264 (variance of the readings).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.estimator import FloatArray

BoolArray = NDArray[np.bool_]

BEFORE_WAVES = 3  # walk, slip and growth, which follow the parameters
OUTLIER = 4.0  # deviations beyond which a row counts less
HOPELESS = 50.0  # logarithm of the odds from which a filter begins again where the best of its kind is
FIRST_ROWS, ROWS_OF_VARIANCE = 2.0, 300.0  # beforehand and at most, in the mean that the readings' variance is


class RowPassing(NamedTuple):
    """How a row passes, the same for all filters.

    Attributes
    ----------
    step_s : float
        T.
    angle : float
        Nominal omega T, rad.
    memory : float
        What is left of a wave after a row that does not grow.
    slip, growth, parameter : float
        Variance that a row adds to each of slip, growth and (where they walk) parameters.
    growth_kept : float
        What is left of the growth after a row.
    evidence_kept : float
        Memory of the logarithms of the filters' weights, of a row.
    surprise : float
        Deviations from which a force begins anew; infinite for never.
    pause : int
        Rows after it without another.
    """

    step_s: float
    angle: float
    memory: float
    slip: float
    growth: float
    parameter: float
    growth_kept: float
    evidence_kept: float
    surprise: float
    pause: int


class Bank(NamedTuple):
    """M filters of at most m states; changed in place by `run_bank`.

    Attributes
    ----------
    wave, walk : (M,) arrays
        Variance that a row adds to each wave and to the walk, in variances of a reading.
    cutter, walking : (M,) arrays of bool
        Whether the force has parts that grow with the feed, and whether the parameters walk.
    prior, weight : (M,) arrays
        Logarithms of the filters' weights beforehand and now.
    reading : (M,) array
        Variance of a reading.
    rows, waiting : (M,) arrays of int
        Rows taken in, and rows until the next surprise.
    x, P : (M, m), (M, m, m) arrays
    """

    wave: FloatArray
    walk: FloatArray
    cutter: BoolArray
    walking: BoolArray
    prior: FloatArray
    weight: FloatArray
    reading: FloatArray
    rows: NDArray[np.int64]
    waiting: NDArray[np.int64]
    x: FloatArray
    P: FloatArray


@kept
@njit(error_model="numpy")
def pass_row(x: FloatArray, P: FloatArray, n: int, p: int, harmonics: int, motion: RowPassing) -> None:
    """Let a row pass over waves, slip and growth of the first n states of a filter, without noise."""
    slip, growth = p + 1, p + 2
    size = motion.memory * np.exp(motion.step_s * x[growth])
    for wave in range(2 * harmonics):
        j = p + BEFORE_WAVES + 2 * wave + (2 if wave >= harmonics else 0)
        if j >= n:
            break
        turn = (wave % harmonics + 1) * motion.angle
        c, s = size * np.cos(turn * (1.0 + x[slip])), size * np.sin(turn * (1.0 + x[slip]))
        x[j], x[j + 1] = c * x[j] + s * x[j + 1], c * x[j + 1] - s * x[j]
        slip_c, slip_s = turn * x[j + 1], -turn * x[j]
        growth_c, growth_s = motion.step_s * x[j], motion.step_s * x[j + 1]
        for i in range(n):
            a, b = P[j, i], P[j + 1, i]
            P[j, i] = c * a + s * b + slip_c * P[slip, i] + growth_c * P[growth, i]
            P[j + 1, i] = c * b - s * a + slip_s * P[slip, i] + growth_s * P[growth, i]
        for i in range(n):
            a, b = P[i, j], P[i, j + 1]
            P[i, j] = c * a + s * b + slip_c * P[i, slip] + growth_c * P[i, growth]
            P[i, j + 1] = c * b - s * a + slip_s * P[i, slip] + growth_s * P[i, growth]
    x[growth] *= motion.growth_kept
    for i in range(n):
        P[growth, i] *= motion.growth_kept
    for i in range(n):
        P[i, growth] *= motion.growth_kept


@kept
@njit(error_model="numpy")
def add_to_force(P: FloatArray, n: int, p: int, harmonics: int, wave: float, walk: float) -> None:
    """Add a variance to each wave of the first n states and another one to the walk."""
    P[p, p] += walk
    for i in range(p + BEFORE_WAVES, n):
        if not 0 <= i - (p + BEFORE_WAVES + 2 * harmonics) < 2:  # the mean force of a cutter
            P[i, i] += wave


@kept
@njit(error_model="numpy")
def gain_of(P: FloatArray, h: FloatArray, n: int, K: FloatArray) -> float:
    """Write P h of the first n states, and return h' P h."""
    total = 0.0
    for i in range(n):
        K[i] = 0.0
        for j in range(n):
            K[i] += P[i, j] * h[j]
        total += h[i] * K[i]
    return total


@kept
@njit(error_model="numpy")
def filter_row(
    bank: Bank, f: int, n: int, p: int, h: FloatArray, K: FloatArray, y: float, harmonics: int, motion: RowPassing
) -> float:
    """Take a reading into a filter, and return the logarithm of its likelihood, an outlier's as that at the limit."""
    x, P, reading = bank.x[f], bank.P[f], bank.reading[f]
    error = y
    for i in range(n):
        error -= h[i] * x[i]
    doubt = gain_of(P, h, n, K)
    S = doubt + reading
    evidence = -0.5 * (np.log(S) + min(error**2 / S, motion.surprise**2))
    if error**2 > motion.surprise**2 * S and bank.waiting[f] <= 0:
        bank.waiting[f] = motion.pause
        add_to_force(P, n, p, harmonics, 1.0, 1.0)
        doubt = gain_of(P, h, n, K)
    bank.waiting[f] -= 1
    noise = max(reading, error**2 / OUTLIER**2 - doubt)
    S = doubt + noise
    for i in range(n):
        x[i] += K[i] * error / S
        for j in range(i + 1):
            P[i, j] -= K[i] * K[j] / S
            P[j, i] = P[i, j]
    bank.rows[f] += 1
    left = ((error * noise / S) ** 2 + doubt * noise / S) * reading / noise
    share = max(1.0 / (bank.rows[f] + FIRST_ROWS), 1.0 / ROWS_OF_VARIANCE)
    bank.reading[f] = reading + share * (min(left, OUTLIER**2 * reading) - reading)
    return float(evidence)


@kept
@njit(error_model="numpy")
def normalised(logarithms: FloatArray, weights: FloatArray) -> None:
    """Write weights of sum 1, and set the largest logarithm to 0."""
    total, top = 0.0, -np.inf
    for f in range(weights.size):
        top = max(top, logarithms[f])
    for f in range(weights.size):
        logarithms[f] -= top
        weights[f] = np.exp(logarithms[f])
        total += weights[f]
    for f in range(weights.size):
        weights[f] /= total


@kept
@njit(error_model="numpy")
def begin_hopeless_again(bank: Bank) -> None:
    """Let each filter whose weight is lost go on where the best of those with the same states is."""
    for f in range(bank.weight.size):
        best = f
        for other in range(bank.weight.size):
            if bank.cutter[other] == bank.cutter[f] and bank.weight[other] > bank.weight[best]:
                best = other
        if bank.weight[f] < bank.weight[best] - HOPELESS:
            for i in range(bank.x.shape[1]):
                bank.x[f, i] = bank.x[best, i]
                for j in range(bank.x.shape[1]):
                    bank.P[f, i, j] = bank.P[best, i, j]
            bank.reading[f] = bank.reading[best]
            bank.weight[f] = bank.weight[best] - 0.5 * HOPELESS


@kept
@njit(error_model="numpy")
def run_bank(
    bank: Bank, Z: FloatArray, y: FloatArray, feed: FloatArray, learnt: BoolArray, harmonics: int, motion: RowPassing
) -> tuple[FloatArray, FloatArray]:
    """Take rows in, and return what the filters say of each together.

    Parameters
    ----------
    Z, y, feed : (n, p), (n,), (n,) arrays
        In units in which all states are about 1 beforehand; the feed is v.
    learnt : (n,) array of bool
        Rows that are taken in; over the others time passes only.

    Returns
    -------
    (n, 4) array
        Force after the row and its variance; reading as predicted before it and the variance of that. Where there are
        waves and parameters, the walk is the force's in filters of a cutter alone, else a friction's.
    (n, p) array
        Parameters b after the row.
    """
    n, p = Z.shape
    M = bank.weight.size
    rows, found = np.zeros((n, 4)), np.zeros((n, p))
    h, K, weights = np.zeros(bank.x.shape[1]), np.empty(bank.x.shape[1]), np.empty(M)
    force, force_variance, evidence = np.empty(M), np.empty(M), np.zeros(M)
    plain = p + BEFORE_WAVES + 2 * harmonics
    for k in range(n):
        normalised(bank.weight, weights)
        for i in range(p):
            h[i] = Z[k, i]
        h[p] = 1.0
        for i in range(p + BEFORE_WAVES, plain, 2):
            h[i] = 1.0
        if plain < h.size:
            h[plain], h[plain + 1] = np.sign(feed[k]), feed[k]
            for i in range(plain + 2, h.size, 2):
                h[i] = feed[k]
        predicted = square = 0.0
        for f in range(M):
            x, P = bank.x[f], bank.P[f]
            states = h.size if bank.cutter[f] else plain
            pass_row(x, P, states, p, harmonics, motion)
            add_to_force(P, states, p, harmonics, bank.wave[f] * bank.reading[f], bank.walk[f] * bank.reading[f])
            P[p + 1, p + 1] += motion.slip
            P[p + 2, p + 2] += motion.growth
            if bank.walking[f]:
                for i in range(p):
                    P[i, i] += motion.parameter
            mean = 0.0
            for i in range(states):
                mean += h[i] * x[i]
            predicted += weights[f] * mean
            square += weights[f] * (gain_of(P, h, states, K) + bank.reading[f] + mean**2)
            if learnt[k]:
                evidence[f] = filter_row(bank, f, states, p, h, K, y[k], harmonics, motion)
            first = p + 1 if harmonics > 0 and p > 0 and not bank.cutter[f] else p
            force[f] = force_variance[f] = 0.0
            for i in range(first, states):
                force[f] += h[i] * x[i]
                for j in range(first, states):
                    force_variance[f] += h[i] * P[i, j] * h[j]
        rows[k, 2], rows[k, 3] = predicted, square - predicted**2
        if learnt[k]:
            for f in range(M):
                bank.weight[f] = bank.prior[f] + motion.evidence_kept * (bank.weight[f] - bank.prior[f]) + evidence[f]
            begin_hopeless_again(bank)
            normalised(bank.weight, weights)
        for f in range(M):
            rows[k, 0] += weights[f] * force[f]
            for i in range(p):
                found[k, i] += weights[f] * bank.x[f, i]
        for f in range(M):
            rows[k, 1] += weights[f] * (force_variance[f] + (force[f] - rows[k, 0]) ** 2)
    return rows, found
