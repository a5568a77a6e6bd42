r"""Unscented Kalman filter of a drive with a bristle, parameters, a walk and waves that slip, compiled.

State, and how a sample of time h passes over it:

.. math::
    (x, v, \zeta, b_1 \ldots b_5, w, \delta, a_0, a_1, c_1, s_1 \ldots c_H, s_H), \qquad
    \dot\zeta = \frac{\kappa \sigma_0}{F_c} \Big( v - |v| \frac{\zeta}{\gamma(v)} \Big), \quad
    \gamma(v) = 1 + \Big( \frac{F_s}{F_c} - 1 \Big) e^{-(v / v_s)^2}

.. math::
    m_0 \dot v = (1 + \sigma_m b_1) u - (B_0 + \sigma_B b_2) v
        - (1 + \sigma_c b_3) F_c \Big( \zeta + \frac{\sigma_1}{\sigma_0} \dot\zeta \Big) - (F_0 + \sigma_0' b_4)
        - U \Big( w + a_0 d + a_1 f + \sum_h c_h \Big), \qquad \kappa = e^{\sigma_\kappa b_5}

.. math:: (c_h + i s_h)^+ = \rho\, e^{-i h (1 + \delta) \omega T} (c_h + i s_h) + \xi_h

with zeta the bristle's deflection over the steady one, direction d and size f of the feed. At constant velocity over
the sample it relaxes exactly. All 2 N sigma points have the same weight, at :math:`\pm \sqrt{N}` columns of a root of
the covariance: none is negative.

References
----------
Julier and Uhlmann, Unscented filtering and nonlinear estimation, Proc. IEEE 92 (2004), 401-422, eqs. (11) and (12) with
W_0 = 0; Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Automatic Control 40 (1995), eqs. (2) to (4).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.estimator import FloatArray
from fdbench_baselines._motion_smoother import begin_in_motion

FLAT = 1e-13  # of a variance, below which what is left of it counts as none
VELOCITY, BRISTLE, OWN, SHAPE, WALK, SLIP, MEAN, GROWS, WAVES = 1, 2, 3, 7, 8, 9, 10, 11, 12


class Numbers(NamedTuple):
    """Numbers of the drive and the scale of states; forces in N, times in s.

    Attributes
    ----------
    place : int
        Which state is read: 0, the position, or 1, the velocity.
    velocity_unit, kick_per_N : float
        m/s of a velocity of 1, and by how much a newton changes it in a sample.
    step_s, angle : float
        Sampling time, and nominal turn of the first wave in it, rad.
    viscous, coulomb, static_share, stribeck, bend_per_m, damping_s, offset : float
        B_0, F_c, F_s / F_c - 1, v_s, sigma_0 / F_c, sigma_1 / sigma_0, F_0.
    mass, thicker, level, offset_off, shape : float
        sigma_m, sigma_B, sigma_c, sigma_0', sigma_kappa.
    force_unit : float
        U.
    """

    place: int
    velocity_unit: float
    kick_per_N: float
    step_s: float
    angle: float
    viscous: float
    coulomb: float
    static_share: float
    stribeck: float
    bend_per_m: float
    damping_s: float
    offset: float
    mass: float
    thicker: float
    level: float
    offset_off: float
    shape: float
    force_unit: float


class DriveNoise(NamedTuple):
    """Variances: of a reading, of what a sample adds to each state (N,), at the first (N,); rho; share of the walk.

    Of positions, the velocity's at the first is the mean square of the record's changes instead.
    """

    reading: float
    fresh: FloatArray
    start: FloatArray
    memory: float
    walk_share: float


class Signals(NamedTuple):
    """What is known of each sample, (n,) each.

    Attributes
    ----------
    force, apart : (n,) arrays
        Force of the motor, N, and by how much the table is faster than what is read, m/s.
    direction, feed : (n,) arrays
        Of the command, where a mean force may follow it.
    reading, missing, jolt : (n,) arrays
        As in `fdbench_baselines._motion_smoother.ForcedMotion`.
    """

    force: FloatArray
    apart: FloatArray
    direction: FloatArray
    feed: FloatArray
    reading: FloatArray
    missing: NDArray[np.bool_]
    jolt: FloatArray


@njit(error_model="numpy")
def pass_point(d, force, apart, direction, feed, memory, s):  # type: ignore[no-untyped-def]
    """Let a sample pass over one sigma point, in place."""
    h, total = d.step_s, s[MEAN] * direction + s[GROWS] * feed
    for i in range(WAVES, len(s), 2):
        total += s[i]
    pushed = (1.0 + d.mass * s[OWN]) * force - (d.offset + d.offset_off * s[OWN + 3])
    pushed -= d.force_unit * (s[WALK] + total)
    thick, level = d.viscous + d.thicker * s[OWN + 1], d.coulomb * (1.0 + d.level * s[OWN + 2])
    v = s[VELOCITY] * d.velocity_unit
    gain = d.kick_per_N * d.velocity_unit
    middle = v + 0.5 * gain * (pushed - thick * v - level * s[BRISTLE])
    friction = 0.0
    if d.coulomb != 0.0:
        slid = middle + apart
        ratio = slid / d.stribeck
        steady = 1.0 + d.static_share * np.exp(-ratio * ratio)
        y = np.exp(d.shape * s[SHAPE]) * d.bend_per_m * abs(slid) * h / steady
        if slid < 0.0:
            steady = -steady
        mean = (1.0 - np.exp(-y)) / y if y > 1e-6 else 1.0
        bent = (steady - s[BRISTLE]) * y * mean
        friction = level * (steady - (steady - s[BRISTLE]) * mean + d.damping_s * bent / h)
        s[BRISTLE] += bent
    change = d.kick_per_N * (pushed - thick * middle - friction)
    if d.place == 0:
        s[0] += s[VELOCITY] + 0.5 * change
    s[VELOCITY] += change
    turn = d.angle * (1.0 + s[SLIP])
    for i in range(WAVES, len(s), 2):
        order = 1 + (i - WAVES) // 2
        cosine, sine = memory * np.cos(order * turn), memory * np.sin(order * turn)
        c = s[i]
        s[i] = cosine * c + sine * s[i + 1]
        s[i + 1] = cosine * s[i + 1] - sine * c


@njit(error_model="numpy")
def root_of(P, L):  # type: ignore[no-untyped-def]
    """Write the lower root of a covariance; a state that is known, or a sum of others, has a column of zeros."""
    N = len(P)
    for j in range(N):
        left = P[j, j]
        for q in range(j):
            left -= L[j, q] * L[j, q]
        pivot = np.sqrt(left) if left > FLAT * P[j, j] else 0.0
        for i in range(N):
            L[i, j] = 0.0
        L[j, j] = pivot
        if pivot > 0.0:
            for i in range(j + 1, N):
                left = P[i, j]
                for q in range(j):
                    left -= L[i, q] * L[j, q]
                L[i, j] = left / pivot


@njit(error_model="numpy")
def told(d, x, P, walk_share, direction, feed, back, row):  # type: ignore[no-untyped-def]
    """Write mean and variance of the force of the sample before, from walk and waves turned back by it."""
    N = len(x)
    turn = d.angle * (1.0 + x[SLIP])
    for i in range(N):
        back[i] = 0.0
    back[WALK], back[MEAN], back[GROWS] = walk_share, direction, feed
    for i in range(WAVES, N, 2):
        order = 1 + (i - WAVES) // 2
        back[i], back[i + 1] = np.cos(order * turn), -np.sin(order * turn)
    row[0], row[1] = 0.0, 0.0
    for i in range(WALK, N):
        row[0] += back[i] * x[i]
        for j in range(WALK, N):
            row[1] += back[i] * P[i, j] * back[j]


@njit(error_model="numpy")
def pass_points(d, sample, memory, fresh, x, P, L, points):  # type: ignore[no-untyped-def]
    """Let a sample pass over state and covariance, of root L, in place, by sigma points."""
    N, spread = len(x), np.sqrt(float(len(x)))
    force, apart, direction, feed = sample
    for j in range(N):
        for i in range(N):
            points[2 * j, i] = x[i] + spread * L[i, j]
            points[2 * j + 1, i] = x[i] - spread * L[i, j]
    known = -1  # points in a direction that is known are all one
    for q in range(2 * N):
        if L[q // 2, q // 2] > 0.0 or known < 0:
            pass_point(d, force, apart, direction, feed, memory, points[q])
            known = q if L[q // 2, q // 2] == 0.0 else known
        else:
            for i in range(N):
                points[q, i] = points[known, i]
    for i in range(N):
        x[i] = 0.0
        for j in range(N):
            P[i, j] = 0.0
    for q in range(2 * N):
        for i in range(N):
            x[i] += points[q, i] / (2 * N)
    for q in range(2 * N):
        for i in range(N):
            off = (points[q, i] - x[i]) / (2 * N)
            for j in range(i + 1):
                P[i, j] += off * (points[q, j] - x[j])
    for i in range(N):
        for j in range(i):
            P[j, i] = P[i, j]
        P[i, i] += fresh[i]


@kept
@njit(error_model="numpy")
def run_unscented(d, signals, noise, rows):  # type: ignore[no-untyped-def]
    """Filter; write the force of each sample and its variance (n, 2); return state, covariance, log likelihood."""
    force, apart, direction, feed, reading, missing, jolt = signals
    observed, fresh, start, memory, walk_share = noise
    n, N = len(force), len(fresh)
    x, P, L, K, back = np.zeros(N), np.zeros((N, N)), np.zeros((N, N)), np.empty(N), np.empty(N)
    points = np.empty((2 * N, N))
    x[d.place] = reading[0]
    for i in range(N):
        P[i, i] = start[i]
    begin_in_motion(reading, d.place, P)
    log_likelihood = 0.0
    for k in range(n):
        if not missing[k]:
            error, S = reading[k] - x[d.place], P[d.place, d.place] + observed
            log_likelihood -= 0.5 * (np.log(S) + error * error / S)
            for i in range(N):
                K[i] = P[i, d.place]
            for i in range(N):
                x[i] += K[i] / S * error
                for j in range(N):
                    P[i, j] -= K[i] / S * K[j]
        if k > 0:
            told(d, x, P, walk_share, direction[k - 1], feed[k - 1], back, rows[k - 1])
        root_of(P, L)
        pass_points(d, (force[k], apart[k], direction[k], feed[k]), memory, fresh, x, P, L, points)
        P[VELOCITY, VELOCITY] += jolt[k]
    told(d, x, P, walk_share, direction[n - 1], feed[n - 1], back, rows[n - 1])
    return x, P, log_likelihood
