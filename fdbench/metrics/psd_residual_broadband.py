"""How far the prediction error is above the noise beside the disturbance."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._spectrum import (
    bins,
    decibels_above_floor,
    median_of_mean,
    n_rows_in_window,
    no_density,
)


@final
class PsdResidualBroadband(Metric):
    r"""Median power density of the prediction error beside the disturbance and its harmonics, above the noise floor.

    .. math:: 10 \log_{10} \frac{\mathrm{median}_k\, S_k / \mu}{2 \sigma^2 T_s}

    over all bins but those of ``psd_residual_at_disturbance`` and ``psd_residual_at_harmonics``; :math:`\mu < 1` is the
    median of a Welch density of white noise over its mean, so that white noise gives 0 dB. The median leaves single
    lines and the low frequencies of friction out of account; ``prediction_error`` has them.

    0 dB is a model that predicts all but the noise. Below 0 the noise is fitted over the whole band: more than the
    share of the rows that p parameters take, :math:`10 \log_{10}(1 - p/n)`, is over-fitting. A ranking takes all
    below 0 for 0. Validity as for ``psd_residual_at_disturbance``; without a period all bins count.

    ``worst`` is a residual of 1e5 times the noise's amplitude.

    Source: Welch (1967), IEEE Trans. Audio Electroacoustics 15.

    Examples
    --------
    Twice the residual is 6 dB more.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> noise = np.random.default_rng(0).standard_normal(2048)
    >>> claim = Estimate(output=np.zeros(2048))
    >>> once, twice = (PsdResidualBroadband().score(example_outcome(claim, target=a * noise)) for a in (1e-4, 2e-4))
    >>> round(twice - once, 2)
    6.02
    """

    unit = "dB"
    worst = 100.0
    track = "output"
    practical_change = 0.5

    def skip(self, outcome: Outcome) -> str | None:
        return no_density(outcome)

    def score(self, outcome: Outcome) -> float:
        others, share = bins(outcome).others, median_of_mean(n_rows_in_window(outcome))
        return decibels_above_floor(outcome, lambda density: float(np.median(density[others])) / share)
