"""Whether the stated variance of the disturbance force is that of its errors."""

from typing import final

from fdbench.metrics._coverage import coverage_error_percent
from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._series import alternating_disturbance, claimed, in_window, not_claimed, true_disturbance


@final
class DisturbanceCoverageError(Metric):
    r"""Distance of the coverage of stated 95 % intervals from 95 %, in percentage points.

    .. math:: \left| \tfrac{100}{n} \sum_k [ |\tilde d_k - \tilde{\hat d}_k| \le 1.96 \sqrt{v_k} ] - 95 \right|,
              \quad \tilde d_k = d_k - \bar d

    with the claimed ``disturbance_N`` :math:`\hat d` and ``disturbance_variance_N2`` v. Both forces without their mean
    over the scenario's window, for the reason that ``disturbance_error`` gives: the mean of a cutting force is part of
    the friction to every estimator, and with it no interval in milling holds anything. Too wide intervals cost at most
    5 points, too narrow ones up to 95.

    Validity: a disturbance of zero, as in control trials, counts as well. Errors of a smoother are correlated, so that
    the coverage scatters more than that of independent ones.

    ``worst`` is that of intervals that hold nothing.

    Source: Gneiting, Balabdaoui, Raftery (2007), J. R. Statist. Soc. B 69, for coverage as a sign of calibration.

    Examples
    --------
    Of four intervals two hold: 50 % in place of 95 %.

    >>> import numpy as np
    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> claim = Estimate(disturbance_N=np.zeros(4), disturbance_variance_N2=np.ones(4))
    >>> DisturbanceCoverageError().score(example_outcome(claim, disturbance_N=[1.0, -1.0, 3.0, -3.0]))
    45.0
    """

    unit = "%"
    worst = 95.0
    track = "disturbance"
    practical_change = 1.0

    def skip(self, outcome: Outcome) -> str | None:
        truth = true_disturbance(outcome)
        if truth is None:
            return "the true disturbance is not known"
        if len(truth) < 3:
            return "fewer than 3 rows in the window"
        return not_claimed(outcome, "disturbance_N") or not_claimed(outcome, "disturbance_variance_N2")

    def score(self, outcome: Outcome) -> float:
        estimate, truth = alternating_disturbance(outcome)
        return coverage_error_percent(truth - estimate, claimed(outcome, "disturbance_variance_N2")[in_window(outcome)])
