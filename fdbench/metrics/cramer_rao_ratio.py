"""Squared parameter errors over the smallest variance that an unbiased estimator can have."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._parameters import value_of
from fdbench.metrics._series import no_white_floor
from fdbench.regression import FloatArray

# Regressors that are exact samples of the simulation: command and velocity, without the dead band of friction.
EXACT = frozenset({"beta_1", "beta_2"})


@final
class CramerRaoRatio(Metric):
    r"""Mean squared error of the parameters in units of the Cramér-Rao bound.

    .. math:: \frac{1}{p} \sum_{i=1}^{p} \frac{(\hat\beta_i - \beta_i)^2}{B_{ii}}, \quad
              B = \sigma^2 (Z^T Z)^{-1}

    with the scenario's equation noise :math:`\sigma` and the regressors Z of the record at hand (observed information:
    Z holds past outputs). For an efficient estimator the expectation is 1, with the variance of chi squared, at most 2,
    on each seed; efficiency is the reciprocal of the mean over seeds. A mean below 1 is that of a biased
    estimator, one that knows something beforehand; ``ideal`` is 0, reached by one that knows the truth.

    Validity: white Gaussian equation noise only and a model that is exact, which is a velocity loop without nominal
    friction, unmodelled effects and reading noise; skipped elsewhere. A missing parameter counts as zero.

    ``worst`` is a standard deviation a thousand times that of the bound.

    Source: Ljung, System Identification (1999), chapter 9, for the bound; Bar-Shalom, Li, Kirubarajan, Estimation with
    Applications to Tracking and Navigation (2001), section 5.4, for the normalised estimation error squared, of which
    this is the part on the diagonal.

    Examples
    --------
    Two errors, of one and of three standard deviations of the bound: (1 + 9) / 2.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> true = {"beta_1": 0.8, "beta_2": 0.19}
    >>> bound = 2e-5  # noise of 2e-5 m/s, one row for each parameter
    >>> claim = Estimate(parameters={"beta_1": 0.8 + bound, "beta_2": 0.19 - 3 * bound})
    >>> rows = [[1.0, 0.0], [0.0, 1.0]]
    >>> round(CramerRaoRatio().score(example_outcome(claim, target=[0, 0], regressors=rows, parameters=true)), 6)
    5.0
    """

    unit = ""
    worst = 1e6
    track = "parameters"

    def skip(self, outcome: Outcome) -> str | None:
        names = outcome.regression.names
        if outcome.scenario.reality.effects:
            return "unmodelled effects: there is no bound"
        if not set(names) <= EXACT:
            return "the regressors of friction are not exact: there is no bound"
        if any(name not in outcome.truth.parameters for name in names):
            return "the true parameters are not known"
        scaled, _ = unit_columns(outcome.regression.regressors)
        if np.linalg.matrix_rank(scaled) < len(names):
            return "the record does not identify the parameters"
        return no_white_floor(outcome) or (None if outcome.estimate.parameters else "the estimate claims no parameters")

    def score(self, outcome: Outcome) -> float:
        names, truths = outcome.regression.names, outcome.truth.parameters
        scaled, length = unit_columns(outcome.regression.regressors)
        sigma = outcome.scenario.reality.noise.equation_velocity_m_per_s
        bound = sigma**2 * np.diag(np.linalg.inv(scaled.T @ scaled)) / length**2
        errors = np.array([value_of(outcome.estimate.parameters, name) - truths[name] for name in names])
        return float(np.mean(errors**2 / bound))


def unit_columns(regressors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the regressors with columns of unit length (those of zeros as they are), and the lengths."""
    length = np.linalg.norm(regressors, axis=0)
    length[length == 0.0] = 1.0
    return regressors / length, length
