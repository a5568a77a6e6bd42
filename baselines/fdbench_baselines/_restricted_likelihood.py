"""Hyperparameters of a locally periodic kernel beside a linear model, from the record itself."""

from collections.abc import Callable

import numpy as np

from fdbench.estimator import FloatArray
from fdbench_baselines._locally_periodic import Kernel, is_uniform, kernel_system, locally_periodic

LARGEST_SLIP, HARMONICS, PADDING = 0.12, 3, 16
LENGTHS_S, WIDTHS = np.geomspace(0.1, 10.0, 7), np.geomspace(0.2, 3.2, 7)
GAMMAS = np.geomspace(1e-2, 1e3, 16)
SECTION = 4000
NEWTON_STEPS, DIFFERENCE, SMALLEST_CURVATURE, LARGEST_STEP = 4, 0.1, 1.0, 1.0
SHARES, ROUNDING = (1.0, 0.5, 0.25, 0.125), 1e-6
# Logarithms of sigma_1 in s, sigma_2, gamma sigma_1 / sigma_2^2, which is how far a line stands above the noise, and
# the frequency's change in units of 1 / (2 pi sigma_1). Lines that stand higher make equations that are not solved.
LOWEST, HIGHEST = np.array([-4.0, -2.0, -8.0, -2.0]), np.array([4.5, 2.0, 7.5, 2.0])


def likeliest_kernel(time_s: FloatArray, basis: FloatArray, target: FloatArray, start: Kernel) -> Kernel:
    r"""Return the hyperparameters of greatest restricted likelihood, by Newton steps of fixed number.

    .. math::
        \log L = -\tfrac12 \big( \nu \log \tfrac{q}{\nu} + \log|A| + \log|P^T A^{-1} P| \big), \quad
        q = \min_\theta (y - P \theta)^T A^{-1} (y - P \theta), \quad \nu = n - m

    with the scale :math:`s^2 = q / \nu` that suits best. Derivatives are differences.

    Parameters
    ----------
    time_s, target : (n,) arrays
        t, y.
    basis : (n, m) array
        P.
    start : Kernel
        Near the greatest; see `nearby_kernel`.

    References
    ----------
    Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eq. 5.8 (likelihood); Patterson and Thompson,
    Recovery of inter-block information when block sizes are unequal, Biometrika 58 (1971), 545-554 (restricted).
    """
    unit_Hz = 0.5 / (np.pi * start.sigma_1_s)

    def kernel(place: FloatArray) -> Kernel:
        sigma_1_s, sigma_2, height = np.exp(place[:3]).tolist()
        turn_Hz = float(place[3]) * unit_Hz
        return Kernel(sigma_1_s, sigma_2, height * sigma_2**2 / sigma_1_s, 1.0 / (1.0 / start.period_s + turn_Hz))

    def value(place: FloatArray) -> float:
        return restricted_likelihood(time_s, kernel(place), basis, target)

    height = start.gamma * start.sigma_1_s / start.sigma_2**2
    first = np.append(np.log([start.sigma_1_s, start.sigma_2, height]), 0.0)
    return kernel(climb(value, np.clip(first, LOWEST, HIGHEST)))


def restricted_likelihood(time_s: FloatArray, kernel: Kernel, basis: FloatArray, target: FloatArray) -> float:
    """Return log L of `likeliest_kernel`, of more than 4000 rows on a uniform clock that of their sections.

    Sections are of equal length, independent of each other and have one theta in common.
    """
    n = len(target)
    sections = -(-n // SECTION) if is_uniform(time_s) else 1
    length = n // sections
    rows = np.column_stack((basis, target))[: sections * length]
    m = basis.shape[1]
    beside = rows.reshape(sections, length, m + 1).transpose(1, 0, 2).reshape(length, -1)
    whitened, log_determinant = kernel_system(time_s[:length], *kernel).whitened(beside)
    triangle = np.abs(np.diag(np.linalg.qr(whitened.reshape(-1, m + 1), mode="r")))
    degrees = sections * length - m
    fidelity = degrees * np.log(triangle[m] ** 2 / degrees)
    return float(-0.5 * (fidelity + sections * log_determinant) - np.sum(np.log(triangle[:m])))


def nearby_kernel(time_s: FloatArray, basis: FloatArray, target: FloatArray, nominal: Kernel) -> Kernel:
    """Return roughly the likeliest hyperparameters: the period of the strongest comb of lines, the others on a grid.

    A clock that is not uniform has no lines: there the nominal values are returned.
    """
    if not is_uniform(time_s):
        return nominal
    residual = target - basis @ np.linalg.lstsq(basis, target)[0]
    step_s = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
    return likeliest_on_grid(residual, step_s, strongest_comb(residual, step_s, nominal.period_s))


def strongest_comb(signal: FloatArray, step_s: float, period_s: float) -> float:
    """Return the period within 12 % in frequency whose first three harmonics hold most power, under a Hann window."""
    n = len(signal)
    bins = PADDING * n
    power = np.abs(np.fft.rfft(np.hanning(n) * (signal - signal.mean()), bins)) ** 2
    nominal = bins * step_s / period_s
    places = np.arange(int(np.ceil((1.0 - LARGEST_SLIP) * nominal)), int((1.0 + LARGEST_SLIP) * nominal) + 1)
    comb = np.zeros(len(places))
    for harmonic in range(1, HARMONICS + 1):
        below = harmonic * places < len(power)
        comb[below] += power[harmonic * places[below]]
    return float(bins * step_s / places[np.argmax(comb)])


def likeliest_on_grid(signal: FloatArray, step_s: float, period_s: float) -> Kernel:
    r"""Return the point of the grid with the greatest Whittle likelihood, at a given period.

    .. math:: -\sum_j \Big( \log s^2 E_j + \frac{I_j}{s^2 E_j} \Big)

    with the periodogram I under a Hann taper and its expectation E under each kernel, the taper's leakage included.

    References
    ----------
    Sykulski, Olhede, Guillaumin, Lilly and Early, The debiased Whittle likelihood, Biometrika 106 (2019), 251-266.
    """
    n = len(signal)
    taper = np.hanning(n)
    taper /= np.sqrt(np.mean(taper**2))
    periodogram = np.abs(np.fft.rfft(taper * (signal - signal.mean()))[1:]) ** 2 / n
    overlap: FloatArray = np.fft.irfft(np.abs(np.fft.rfft(taper, 2 * n)) ** 2)[:n] / n
    time_s = step_s * np.arange(n, dtype=np.float64)
    best, found = -np.inf, Kernel(float(LENGTHS_S[0]), float(WIDTHS[0]), float(GAMMAS[0]), period_s)
    for sigma_1_s in LENGTHS_S.tolist():
        for sigma_2 in WIDTHS.tolist():
            covariance = overlap * locally_periodic(time_s, sigma_1_s, sigma_2, period_s)
            covariance[1:] += covariance[:0:-1]
            expected = np.maximum(np.fft.rfft(covariance).real[1:], 0.0) + 1.0 / GAMMAS[:, None]
            scale = np.mean(periodogram / expected, axis=1)
            likelihood = -len(periodogram) * np.log(np.maximum(scale, 1e-300)) - np.sum(np.log(expected), axis=1)
            place = int(np.argmax(likelihood))
            if likelihood[place] > best:
                best, found = float(likelihood[place]), Kernel(sigma_1_s, sigma_2, float(GAMMAS[place]), period_s)
    return found


def climb(value: Callable[[FloatArray], float], start: FloatArray) -> FloatArray:
    """Return where a few Newton steps lead, each halved while it goes down by more than rounding errors.

    Directions in which the value hardly bends, or bends upwards, are taken as if they bent by ``SMALLEST_CURVATURE``
    or as much downwards. Where the value is not finite nearby, the climb ends.
    """
    place = start
    for _ in range(NEWTON_STEPS):
        with np.errstate(divide="ignore", invalid="ignore"):
            here, gradient, curvature = derivatives(value, place)
        if not (np.isfinite(gradient).all() and np.isfinite(curvature).all()):
            break
        bends, directions = np.linalg.eigh(-curvature)
        bends = np.maximum(np.abs(bends), SMALLEST_CURVATURE)
        step = directions @ ((directions.T @ gradient) / bends)
        step /= max(1.0, float(np.max(np.abs(step))) / LARGEST_STEP)
        for share in SHARES:
            there = np.clip(place + share * step, LOWEST, HIGHEST)
            if value(there) > here - ROUNDING:
                place = there
                break
    return place


def derivatives(value: Callable[[FloatArray], float], place: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return value, gradient (d,) and second derivatives (d, d) by differences of `DIFFERENCE`."""
    d, steps = len(place), DIFFERENCE * np.eye(len(place))
    here = value(place)
    above, below = np.array([[value(place + sign * step) for step in steps] for sign in (1.0, -1.0)])
    second = np.diag((above - 2.0 * here + below) / DIFFERENCE**2)
    for i in range(d):
        for j in range(i):
            both = value(place + steps[i] + steps[j])
            second[i, j] = second[j, i] = (both - above[i] - above[j] + here) / DIFFERENCE**2
    return here, np.asarray((above - below) / (2.0 * DIFFERENCE)), second
