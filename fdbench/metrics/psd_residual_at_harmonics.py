"""What is left of the disturbance in the prediction error, at its harmonics."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._spectrum import bins, decibels_above_floor, no_density


@final
class PsdResidualAtHarmonics(Metric):
    r"""Power density of the prediction error at harmonics 2 to 5 of the disturbance, above the noise floor.

    .. math:: 10 \log_{10} \frac{\bar S}{2 \sigma^2 T_s}, \quad
              k_h = \mathrm{round}(|h f_d - f_s\, \mathrm{round}(h f_d / f_s)| / \Delta f), \quad h = 2 \dots 5

    :math:`\bar S` is the mean density of the bins :math:`k_h - 1, k_h, k_h + 1` and :math:`f_s` the sampling rate;
    harmonics above Nyquist appear at their alias. One nearer than four bins to the fundamental or to zero is left out.
    Density, window, other symbols, sign and ranking are those of ``psd_residual_at_disturbance``.

    Example: of 50 Hz at 333.33 Hz harmonics 2 and 3 lie at 100 and 150 Hz, 4 and 5 at 133.3 and 83.3 Hz.

    ``worst`` is a residual of 1e5 times the noise's amplitude.

    Source: Welch (1967), IEEE Trans. Audio Electroacoustics 15; McPherson, thesis, 2024, chapter 4, for the harmonics.

    Examples
    --------
    A wave at twice 55 Hz, of 1e4 times the noise; the four harmonics share it, which costs 6 dB.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> rate_Hz, floor = 333.0, 2.0 * 2e-5**2 / 333.0  # noise of 2e-5 m/s
    >>> amplitude = (1e4 * 6.0 * floor * rate_Hz / 1024) ** 0.5
    >>> wave = amplitude * np.sin(2.0 * np.pi * 110.0 * np.arange(2048) / rate_Hz)
    >>> round(PsdResidualAtHarmonics().score(example_outcome(Estimate(output=np.zeros(2048)), target=wave)), 1)
    34.0
    """

    unit = "dB"
    worst = 100.0
    track = "output"
    practical_change = 0.5

    def skip(self, outcome: Outcome) -> str | None:
        if outcome.scenario.estimation.disturbance_period_s is None:
            return "the scenario gives no disturbance period"
        reason = no_density(outcome)
        if reason is None and not bins(outcome).harmonics:
            return "all harmonics fold onto the disturbance or onto zero"
        return reason

    def score(self, outcome: Outcome) -> float:
        chosen = bins(outcome).harmonics
        return decibels_above_floor(outcome, lambda density: float(np.mean(density[chosen])))
