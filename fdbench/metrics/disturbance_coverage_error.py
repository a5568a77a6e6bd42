"""Whether the stated variance of the disturbance force is that of its errors."""

from typing import final

from fdbench.errors import PluginError
from fdbench.metrics._coverage import coverage_error_percent
from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._series import claimed, in_window, not_claimed, true_disturbance


@final
class DisturbanceCoverageError(Metric):
    r"""Distance of the coverage of stated 95 % intervals from 95 %, in percentage points.

    .. math:: \left| \frac{100}{n} \sum_k \left[ |d_k - \hat d_k| \le 1.96 \sqrt{v_k} \right] - 95 \right|

    with the claimed ``disturbance_N`` :math:`\hat d` and ``disturbance_variance_N2`` v, over the scenario's window.
    Means are not removed: an interval that knows how little it can say about the mean is wide enough. Too wide
    intervals cost at most 5 points, too narrow ones up to 95.

    Validity: a disturbance of zero, as in control trials, counts as well. Errors of a smoother are correlated, so that
    the coverage scatters more than that of independent ones.

    ``worst`` is that of intervals that hold nothing.

    Source: Gneiting, Balabdaoui, Raftery (2007), J. R. Statist. Soc. B 69, for coverage as a sign of calibration.
    """

    unit = "%"
    worst = 95.0
    track = "disturbance"

    def skip(self, outcome: Outcome) -> str | None:
        truth = true_disturbance(outcome)
        if truth is None:
            return "the true disturbance is not known"
        if len(truth) == 0:
            return "no rows in the window"
        return not_claimed(outcome, "disturbance_N") or not_claimed(outcome, "disturbance_variance_N2")

    def score(self, outcome: Outcome) -> float:
        truth, window = true_disturbance(outcome), in_window(outcome)
        if truth is None:
            raise PluginError("disturbance_N: asked for although the true disturbance is not known.")
        errors = truth - claimed(outcome, "disturbance_N")[window]
        return coverage_error_percent(errors, claimed(outcome, "disturbance_variance_N2")[window])
