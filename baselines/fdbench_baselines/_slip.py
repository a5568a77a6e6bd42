"""By how much a spindle or shaker runs slower or faster than its nominal period says."""

import numpy as np

from fdbench.estimator import FloatArray

LARGEST_SLIP = 0.015
POINTS_PER_LINE = 8


def slipped_period(time_s: FloatArray, signal: FloatArray, period_s: float, harmonics: int) -> float:
    r"""Return the period near the nominal one at which most of a signal's power is periodic.

    .. math:: \hat\psi = \arg\max_\psi \sum_{h=1}^H \Big| \sum_k w_k s_k e^{-2 \pi i h t_k / \psi} \Big|^2

    with a Hann window w, over frequencies within 1.5 % of the nominal one, an eighth of a line 1/T apart.

    Parameters
    ----------
    time_s, signal : (n,) arrays
    period_s : float
        Nominal period.
    harmonics : int
        H, fewer where half of the sampling frequency ends the series.

    >>> time_s = 0.003 * np.arange(4000)
    >>> round(1.0 / slipped_period(time_s, np.sin(2.0 * np.pi * 55.2 * time_s), 1.0 / 55.0, 1), 2)
    55.2
    """
    duration_s = time_s[-1] - time_s[0]
    window = np.sin(np.pi * (time_s - time_s[0]) / duration_s) ** 2 * signal
    width = LARGEST_SLIP / period_s
    n = 2 * int(np.ceil(POINTS_PER_LINE * width * duration_s)) + 1
    frequency = 1.0 / period_s + np.linspace(-width, width, n)
    # The sum over time is that of a turning pointer; its step turns by the same angle at every frequency of the grid.
    power = np.zeros(n)
    for harmonic in range(1, max(1, below_half(time_s, period_s, harmonics)) + 1):
        lines = np.exp(-2j * np.pi * harmonic * np.outer(frequency, time_s)) @ window
        power += np.abs(lines) ** 2
    return float(1.0 / frequency[np.argmax(power)])


def below_half(time_s: FloatArray, period_s: float, harmonics: int) -> int:
    """Return how many of the harmonics lie below half of the sampling frequency."""
    step_s = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    return min(harmonics, int(0.5 * period_s / step_s * (1.0 - LARGEST_SLIP)))
