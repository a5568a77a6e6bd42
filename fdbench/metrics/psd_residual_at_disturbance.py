"""What is left of the disturbance in the prediction error, at its own frequency."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._spectrum import bins, decibels_above_floor, no_density


@final
class PsdResidualAtDisturbance(Metric):
    r"""Power density of the prediction error at the disturbance's frequency, above the noise floor.

    .. math:: 10 \log_{10} \frac{\tfrac13 (S_{k-1} + S_k + S_{k+1})}{2 \sigma^2 T_s}, \quad
              k = \mathrm{round}(f_d / \Delta f)

    S: one-sided Welch density of :math:`y - \hat y` in the scenario's window (Hann, segments of 1024 rows or, in short
    windows, of the largest power of two that leaves three, overlapping by half); :math:`f_d`: reciprocal of
    ``disturbance_period_s``, folded at Nyquist; :math:`\sigma`: equation noise per sample; :math:`T_s`: sampling time;
    :math:`\Delta f`: spacing of the bins. A sinusoid of amplitude a gives :math:`a^2 / 6 \Delta f` within 0.1 dB,
    wherever it lies between the bins.

    0 dB, ``ideal``, is a model that predicts all but the noise. Below 0 the estimator has fitted the noise as well:
    a smoother in sample such as PL-LSSVM reaches -30 dB and knows no more for it. The value is kept, as differences
    between estimators are what papers print; a ranking takes all below 0 for 0, where no gain is left.

    Where the noise has a colour, as that of noisy readings or of inverse dynamics, what true parameters and force
    leave of this record in the same bins stands in the place of :math:`2 \sigma^2 T_s`.

    Validity: linear equations of a rigid drive. With three segments the noise itself scatters by 2 dB.

    ``worst`` is a residual of 1e5 times the noise's amplitude.

    Source: Welch (1967), IEEE Trans. Audio Electroacoustics 15; McPherson, thesis, 2024, figs. 4.9 and 4.10.

    Examples
    --------
    A wave of 55 Hz whose power is 1e4 times that of the noise in the three bins.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> rate_Hz, floor = 333.0, 2.0 * 2e-5**2 / 333.0  # noise of 2e-5 m/s
    >>> amplitude = (1e4 * 6.0 * floor * rate_Hz / 1024) ** 0.5
    >>> wave = amplitude * np.sin(2.0 * np.pi * 55.0 * np.arange(2048) / rate_Hz)
    >>> round(PsdResidualAtDisturbance().score(example_outcome(Estimate(output=np.zeros(2048)), target=wave)), 1)
    40.0
    """

    unit = "dB"
    worst = 100.0
    track = "output"
    practical_change = 0.5

    def skip(self, outcome: Outcome) -> str | None:
        if outcome.scenario.estimation.disturbance_period_s is None:
            return "the scenario gives no disturbance period"
        return no_density(outcome)

    def score(self, outcome: Outcome) -> float:
        chosen = bins(outcome).disturbance
        return decibels_above_floor(outcome, lambda density: float(np.mean(density[chosen])))
