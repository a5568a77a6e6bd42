r"""Kernel recursive least squares tracker on a fixed budget, compiled.

The published recursion keeps the posterior of the function on its dictionary, :math:`\mu` and :math:`\Sigma`, and
:math:`Q = K^{-1}`, the inverse of the dictionary's kernel matrix with jitter. This one keeps the weights instead:

.. math:: \alpha = Q \mu, \qquad R = Q - Q \Sigma Q, \qquad Q

At an input with kernel column k the mean is :math:`k^T \alpha` and the variance :math:`k(x, x) - k^T R k`; forgetting
back to the prior is :math:`R \leftarrow \lambda R`, so K is not needed. A step reads Q and R once, together, writes R
once, and writes Q only if the dictionary changes. At any time :math:`\mu = K \alpha` and :math:`\Sigma = K - K R K`.

References
----------
Van Vaerenbergh, Lázaro-Gredilla, Santamaría (2012), Kernel Recursive Least-Squares Tracker for Time-Varying
Regression, IEEE Trans. Neural Networks and Learning Systems 23, 1313-1326, doi:10.1109/TNNLS.2012.2200500.
Csató, Opper (2002), Sparse On-Line Gaussian Processes, Neural Computation 14, 641-668 (the form with weights).
Rosenberg (1973), Random coefficients models, Annals of Economic and Social Measurement 2, no. 4 (the linear part).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept

FloatArray = NDArray[np.float64]

FEWEST = 10  # samples that tell s0^2; fewer may be near 0 by chance, and make beta far too sure


class Tracker(NamedTuple):
    """State of the recursion for budget M and inputs of dimension d; changed in place by `track`.

    A free slot holds a point at infinity, which is independent of every input: k = 0, Q = 1 and no weight.

    Attributes
    ----------
    dictionary : (d, M) array
        Inputs in the dictionary, one column for each slot; a new input takes the slot of the one that leaves.
    members : (M,) array of int
        Sample that each slot holds; -1 if it is free.
    alpha : (M,) array
        Weights that the targets have given.
    beside : (p, M) array
        Weights that each regressor of a linear part would have given as target; those of f are alpha - beta' beside.
    QR : (M, 2 M) array
        Q and R side by side, both symmetric.
    power : (2,) array
        Numerator and denominator of s0^2, the signal power.
    seen : (1,) array of int
        Number of samples taken in.
    """

    dictionary: FloatArray
    members: NDArray[np.int64]
    alpha: FloatArray
    beside: FloatArray
    QR: FloatArray
    power: FloatArray
    seen: NDArray[np.int64]


def empty_tracker(dimension: int, budget: int, regressors: int = 0) -> Tracker:
    """Return the state before the first sample, beside a linear part with so many regressors.

    >>> tracker = empty_tracker(dimension=1, budget=2)
    >>> predictions, removed = track(tracker, np.zeros((2, 1)), np.array([2.0, 2.0]), 1.0, 1.0, 0.0, False)
    >>> predictions[1, :2], removed  # one observation of 2 with as much noise as signal; the second adds no member
    (array([1. , 0.5]), array([-1,  1]))
    """
    return Tracker(
        dictionary=np.full((dimension, budget), np.inf),
        members=np.full(budget, -1, dtype=np.int64),
        alpha=np.zeros(budget),
        beside=np.zeros((regressors, budget)),
        QR=np.eye(budget, 2 * budget),
        power=np.zeros(2),
        seen=np.zeros(1, dtype=np.int64),
    )


@kept
@njit(error_model="numpy")
def locally_periodic_inputs(t: FloatArray, sigma_1: float, sigma_2: float, psi: float) -> FloatArray:
    r"""Map times to inputs whose Gaussian kernel is the locally periodic kernel.

    .. math:: e^{-\tau^2 / (2 \sigma_1^2)} e^{-\sin^2(\pi \tau / \psi) / (2 \sigma_2^2)} = e^{-|x - x'|^2 / 2},
              \qquad x = (t / \sigma_1, \cos(2 \pi t / \psi) / (2 \sigma_2), \sin(2 \pi t / \psi) / (2 \sigma_2))

    Parameters
    ----------
    t : (n,) array
        Time in s.
    sigma_1, psi : float
        Length scale and period in s.
    sigma_2 : float
        Length scale of the periodic factor, dimensionless.

    Returns
    -------
    (n, 3) array
        Rows x.

    References
    ----------
    McPherson (2024), eq. 2.11, with the pi that the print lacks and the square on the sine; MacKay (1998), Introduction
    to Gaussian processes, for the map to the circle.
    """
    x = np.empty((t.size, 3))
    for n in range(t.size):
        phase = 2.0 * np.pi * t[n] / psi
        x[n, 0] = t[n] / sigma_1
        x[n, 1] = np.cos(phase) / (2.0 * sigma_2)
        x[n, 2] = np.sin(phase) / (2.0 * sigma_2)
    return x


@kept
@njit(error_model="numpy")
def kernel_column(dictionary: FloatArray, x: FloatArray, k: FloatArray) -> None:
    """Write exp(-|x_i - x|^2 / 2) for every slot i into ``k``."""
    k[:] = 0.0
    for c in range(x.size):
        row, xc = dictionary[c], x[c]
        for i in range(k.size):
            k[i] += (row[i] - xc) ** 2
    for i in range(k.size):
        k[i] = np.exp(-0.5 * k[i])


@kept
@njit(error_model="numpy")
def symmetric_products(QR: FloatArray, k: FloatArray, qr: FloatArray) -> None:
    """Write Q k and R k side by side into ``qr``, eight rows at a time: vector code without a reordered sum."""
    qr[:] = 0.0
    whole = k.size - k.size % 8
    for j in range(0, whole, 8):
        a, b, c, d, e, f, g, h = QR[j], QR[j + 1], QR[j + 2], QR[j + 3], QR[j + 4], QR[j + 5], QR[j + 6], QR[j + 7]
        ka, kb, kc, kd, ke, kf, kg, kh = k[j], k[j + 1], k[j + 2], k[j + 3], k[j + 4], k[j + 5], k[j + 6], k[j + 7]
        for i in range(qr.size):
            first = (ka * a[i] + kb * b[i]) + (kc * c[i] + kd * d[i])
            qr[i] += first + ((ke * e[i] + kf * f[i]) + (kg * g[i] + kh * h[i]))
    for j in range(whole, k.size):
        a, ka = QR[j], k[j]
        for i in range(qr.size):
            qr[i] += ka * a[i]


@kept
@njit(error_model="numpy")
def inject_uncertainty(QR: FloatArray, members: NDArray[np.int64], lam: float) -> None:
    """Sigma <- Sigma / lam, which is R <- R / lam - (1 / lam - 1) Q."""
    M = members.size
    for j in range(M):
        if members[j] >= 0:  # a free slot has no variance that may grow
            Q, R = QR[j], QR[j, M:]
            for i in range(M):
                R[i] = R[i] / lam - (1.0 / lam - 1.0) * Q[i]


@kept
@njit(error_model="numpy")
def update_reduction(QR: FloatArray, lam: float, s: FloatArray, u: FloatArray, b: FloatArray) -> None:
    """R <- lam R + s s' - (u b' + b u')."""
    M = s.size
    for j in range(M):
        R, sj, uj, bj = QR[j, M:], s[j], u[j], b[j]
        for i in range(M):
            R[i] = lam * R[i] + sj * s[i] - (uj * b[i] + bj * u[i])


@kept
@njit(error_model="numpy")
def update_inverse(QR: FloatArray, t: FloatArray, p: FloatArray) -> None:
    """Q <- Q + t t' - p p'."""
    M = t.size
    for j in range(M):
        Q, tj, pj = QR[j], t[j], p[j]
        for i in range(M):
            Q[i] += tj * t[i] - pj * p[i]


@kept
@njit(error_model="numpy")
def give_slot(dictionary: FloatArray, QR: FloatArray, out: int, x: FloatArray) -> None:
    """Put an input into a slot, and leave nothing in Q and R of who was there."""
    M = len(QR)
    # An assignment of an array to a slice would be compiled with the text of an error of shapes, for seconds.
    for c in range(x.size):
        dictionary[c, out] = x[c]
    QR[out] = 0.0
    QR[:, out] = 0.0
    QR[:, M + out] = 0.0


@kept
@njit(error_model="numpy")
def project(weights: FloatArray, u: FloatArray, new: float, out: int, enters: bool) -> None:
    """Spread the weight of who leaves over the others: a member whose slot the new one takes, or the new one itself."""
    leaving = new
    if enters:
        leaving, weights[out] = weights[out], new
    for i in range(weights.size):
        weights[i] -= leaving * u[i]


@kept
@njit(error_model="numpy")
def least(values: FloatArray) -> tuple[int, float]:
    """Return place and value of the first smallest, (0, infinity) if none is below infinity."""
    place, smallest = 0, np.inf
    for i in range(values.size):
        if values[i] < smallest:
            place, smallest = i, values[i]
    return place, smallest


@kept
@njit(error_model="numpy")
def doubt_of(P: FloatArray, z: FloatArray, Pz: FloatArray) -> float:
    """Write P z and return z' P z."""
    doubt = 0.0
    for j in range(z.size):
        Pz[j] = 0.0
        for i in range(z.size):
            Pz[j] += P[j, i] * z[i]
        doubt += z[j] * Pz[j]
    return doubt


@kept
@njit(error_model="numpy")
def correct(beta: FloatArray, P: FloatArray, Pz: FloatArray, error: float, doubt: float, noise: float) -> None:
    """Take in an error: beta <- beta + P z error / S and P <- P - P z z' P / S with S = z' P z + noise."""
    S = doubt + noise
    if doubt > 0.0 and S > 0.0:
        for i in range(beta.size):
            beta[i] += Pz[i] * error / S
            for j in range(beta.size):
                P[i, j] -= Pz[i] * Pz[j] / S


def track(
    tracker: Tracker, x: FloatArray, y: FloatArray, s2: float, lam: float, jitter: float, injection: bool
) -> tuple[FloatArray, NDArray[np.int64]]:
    r"""Predict and take in samples one after the other, with the kernel :math:`k(x, x') = e^{-|x - x'|^2 / 2}`.

    A sample is predicted from the state that the sample before it left. Then the state forgets, takes the sample in,
    and gives up the member whose loss :math:`|\alpha_i / Q_{ii}|` is smallest, be it a free slot or the sample itself.

    Parameters
    ----------
    tracker : Tracker
        State, changed in place.
    x : (n, d) array
        Inputs, divided by their length scales.
    y : (n,) array
        Targets.
    s2 : float
        Noise-to-signal power ratio, above 0.
    lam : float
        Forgetting factor, in (0, 1].
    jitter : float
        Added to the diagonal of the kernel matrix; an input that adds no more than this to it is no member.
    injection : bool
        How to forget. False, back to the prior: lam Sigma + (1 - lam) K and sqrt(lam) mu; true, uncertainty injection:
        Sigma / lam and mu.

    Returns
    -------
    (n, 3) array
        Mean of the function before the sample, its variance in units of s0^2, and s0^2 after the sample. An observation
        has s2 more variance.
    (n,) array of int
        Sample that left the dictionary: -1 if none, the sample itself if it did not become a member.
    """
    learnt = np.ones(y.size, np.bool_)
    rows, removed = _recursion(
        tracker, x, np.empty((y.size, 0)), y, learnt, np.empty(0), np.empty((0, 0)), s2, lam, jitter, injection
    )
    return rows[:, [1, 2, 4]], removed


def track_beside(
    tracker: Tracker,
    x: FloatArray,
    Z: FloatArray,
    y: FloatArray,
    learnt: NDArray[np.bool_],
    beta: FloatArray,
    P: FloatArray,
    s2: float,
    lam: float,
    jitter: float,
    injection: bool,
) -> FloatArray:
    r"""Predict and take in samples of :math:`y = z^T \beta + f(x) + \varepsilon`, with beta found on the way.

    .. math::
        \tilde y = y - \hat y, \quad \tilde z = z - \hat z, \quad e = \tilde y - \tilde z^T \beta, \quad
        S = \tilde z^T P \tilde z + s_0^2 (s_2 + s_f^2), \quad
        \beta \leftarrow \beta + P \tilde z\, e / S, \quad P \leftarrow P - P \tilde z\, \tilde z^T P / S

    with the predictions :math:`\hat y, \hat z` that one tracker makes of target and regressors, all of which it is
    given as if they were readings of f. It whitens them, so that this is generalised least squares, and
    :math:`\hat f = \hat y - \hat z^T \beta`. P = 0 holds beta where it is. As long as :math:`s_0^2` rests on
    ``FEWEST`` samples or less, the noise in S, its second term, is :math:`e^2` wherever that is larger.

    Parameters
    ----------
    learnt : (n,) array of bool
        Samples that are taken in; the others are predicted only, and leave the state as it is.
    beta, P : (p,), (p, p) arrays, changed in place

    Returns
    -------
    (n, 4) array
        :math:`z^T \beta` before the sample, then as `track`, save that the last column gives s0^2 before the sample; a
        first sample's is its own.
    """
    rows, _ = _recursion(tracker, x, Z, y, learnt, beta, P, s2, lam, jitter, injection)
    before: FloatArray = rows[:, :4]
    return before


@kept
@njit(error_model="numpy")
def _recursion(
    tracker: Tracker,
    x: FloatArray,
    Z: FloatArray,
    y: FloatArray,
    learnt: NDArray[np.bool_],
    beta: FloatArray,
    P: FloatArray,
    s2: float,
    lam: float,
    jitter: float,
    injection: bool,
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return z' beta, mean, variance, s0^2 before and after each sample, and who left the dictionary."""
    members, alpha, beside, QR, power = tracker.members, tracker.alpha, tracker.beside, tracker.QR, tracker.power
    M, m = members.size, beta.size
    if beside.shape[0] != m:
        raise ValueError("The tracker was made for another number of regressors.")
    rows, removed = np.empty((y.size, 5)), np.empty(y.size, np.int64)
    k, qr, loss = np.empty(M), np.empty(2 * M), np.empty(M)
    q, r = qr[:M], qr[M:]
    s, t, p, u, b = np.empty(M), np.empty(M), np.empty(M), np.empty(M), np.empty(M)
    z, Pz = np.empty(m), np.empty(m)
    kxx = 1.0 + jitter
    shrink, keep, scale, share = np.sqrt(lam), lam, lam, 0.0
    if injection:
        shrink, keep, scale, share = 1.0, 1.0, 1.0 / lam, 1.0 / lam - 1.0
    for n in range(y.size):
        kernel_column(tracker.dictionary, x[n], k)
        symmetric_products(QR, k, qr)
        mean = kq = kr = linear = 0.0
        for i in range(M):
            mean += k[i] * alpha[i]
            kq += k[i] * q[i]
            kr += k[i] * r[i]
        function, error = mean, y[n] - shrink * mean
        whitened = error
        for j in range(m):
            fitted = 0.0
            for i in range(M):
                fitted += k[i] * beside[j, i]
            z[j] = Z[n, j] - shrink * fitted
            linear += Z[n, j] * beta[j]
            function -= fitted * beta[j]
            error -= z[j] * beta[j]
        doubt = doubt_of(P, z, Pz)

        if injection and learnt[n]:
            inject_uncertainty(QR, members, lam)
        sv2 = s2 + kxx - (scale * kr - share * kq)
        has_power = power[1] > 0.0
        before = power[0] / power[1] if has_power else error**2 / sv2
        rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 3], rows[n, 4] = linear, function, kxx - kr, before, before
        if not learnt[n]:
            removed[n] = tracker.seen[0]
            tracker.seen[0] += 1
            continue
        weight = lam if has_power else 1.0
        power[0] += weight * error**2 / (sv2 + (doubt / before if has_power and before > 0.0 else 0.0))
        power[1] += weight
        rows[n, 4] = power[0] / power[1]

        noise = before * sv2 if power[1] > FEWEST else max(before * sv2, error**2)
        correct(beta, P, Pz, error, doubt, noise)

        a, g2 = whitened / sv2, kxx - kq
        for i in range(M):
            r[i] = scale * r[i] - share * q[i]
            alpha[i] = shrink * alpha[i] - a * r[i]
            loss[i] = alpha[i]
        gained = a
        for j in range(m):
            z[j] /= sv2
            gained -= z[j] * beta[j]
            for i in range(M):
                beside[j, i] = shrink * beside[j, i] - z[j] * r[i]
                loss[i] -= beside[j, i] * beta[j]
        for i in range(M):
            loss[i] = abs(loss[i] / (QR[i, i] + q[i] ** 2 / g2))
        out, smallest = least(loss)
        enters = g2 > jitter and abs(gained * g2) >= smallest

        # u: column of Q of who leaves over its diagonal element; b, s: what projects that one out of R.
        if enters:
            g = 1.0 / np.sqrt(g2)
            t_out = g * q[out]
            pivot = np.sqrt(QR[out, out] + t_out**2)
            s_out, half = -r[out], 0.5 * keep * QR[out, M + out]
            for i in range(M):
                t[i] = g * q[i]
                p[i] = (QR[out, i] + t_out * t[i]) / pivot
                u[i] = p[i] / pivot
                b[i] = keep * QR[out, M + i]
        else:
            s_out, half = 1.0, 0.0
            for i in range(M):
                u[i] = -q[i]
                b[i] = 0.0
        root = 1.0 / np.sqrt(sv2)
        for i in range(M):
            b[i] -= half * u[i]
            s[i] = root * (-r[i] - s_out * u[i])
        removed[n] = tracker.seen[0]
        if enters:
            removed[n] = members[out]
            t[out], p[out] = -g, -g * t_out / pivot
            u[out] = p[out] / pivot
            b[out], s[out] = -half * u[out], root * (1.0 - s_out * u[out])
        project(alpha, u, a, out, enters)
        for j in range(m):
            project(beside[j], u, z[j], out, enters)
        if enters:
            give_slot(tracker.dictionary, QR, out, x[n])
            update_inverse(QR, t, p)
            members[out] = tracker.seen[0]
        update_reduction(QR, keep, s, u, b)
        tracker.seen[0] += 1
    return rows, removed
