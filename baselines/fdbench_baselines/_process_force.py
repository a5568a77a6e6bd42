"""The periodic part of a process force as columns: harmonics of a spindle that slips and drifts, and the feed."""

import numpy as np

from fdbench.estimator import FloatArray
from fdbench_baselines._slip import below_half, slipped_period

LARGEST_DRIFT_PER_S = 1e-3  # of the frequency
DRIFTS, TRIED_HARMONICS = 25, 4


def turns(time_s: FloatArray, signal: FloatArray, period_s: float) -> FloatArray:
    r"""Return the angle (n,) of the spindle in rad, up to a constant, from the signal that it makes.

    .. math::
        \varphi = 2 \pi (f t + \tfrac12 r t^2), \qquad
        (f, r) = \arg\max \sum_{h=1}^4 \Big| \sum_k s_k e^{-i h \varphi_k} \Big|^2

    with t from the middle of the record, f about what `slipped_period` finds and r within 0.1 % of it a second.

    >>> time_s = 0.003 * np.arange(4000)
    >>> angle = turns(time_s, np.sin(2.0 * np.pi * (55.2 * time_s + 0.01 * time_s**2)), 1.0 / 55.0)
    >>> (np.diff(angle)[[0, -1]] / (2.0 * np.pi * 0.003)).round(2)
    array([55.2 , 55.44])
    """
    from scipy.optimize import minimize

    harmonics = max(1, below_half(time_s, period_s, TRIED_HARMONICS))
    centred = time_s - 0.5 * (time_s[0] + time_s[-1])
    nominal = 1.0 / slipped_period(time_s, signal, period_s, harmonics)
    line, power_unit = 1.0 / (time_s[-1] - time_s[0]), float(signal @ signal) or 1.0

    def angle(frequency: float, drift: float) -> FloatArray:
        return np.asarray(2.0 * np.pi * (frequency * centred + 0.5 * drift * centred**2))

    def lost(point: FloatArray) -> float:
        pointer = np.exp(-1j * angle(nominal + line * float(point[0]), nominal * LARGEST_DRIFT_PER_S * float(point[1])))
        turned, power = np.ones(len(centred), dtype=np.complex128), 0.0
        for _ in range(harmonics):
            turned = turned * pointer
            power += float(np.abs(turned @ signal)) ** 2
        return -power / power_unit

    drifts = np.linspace(-1.0, 1.0, DRIFTS)
    grid = [np.array([slip, drift]) for drift in drifts for slip in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    first = min(grid, key=lost)
    corners = first + np.array([[0.0, 0.0], [0.25, 0.0], [0.0, 0.04]])
    found = minimize(lost, first, method="Nelder-Mead", options={"initial_simplex": corners, "maxfev": 80}).x
    return angle(nominal + line * float(found[0]), nominal * LARGEST_DRIFT_PER_S * float(found[1]))


def process_waves(angle: FloatArray, feed: FloatArray, harmonics: int) -> FloatArray:
    r"""Return cosine and sine of each harmonic times the feed's sign and the feed, (n, 4 H).

    The force on an edge is affine in the chip, and turns with the feed.
    """
    size = float(np.sqrt(np.mean(feed**2))) or 1.0
    columns = []
    for harmonic in range(1, harmonics + 1):
        for amplitude in (np.sign(feed), feed / size):
            columns += [amplitude * np.cos(harmonic * angle), amplitude * np.sin(harmonic * angle)]
    return np.column_stack(columns) if columns else np.empty((len(feed), 0))
