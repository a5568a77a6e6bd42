"""Whether the stated variance of the output is that of its errors."""

from typing import final

from fdbench.metrics._coverage import coverage_error_percent
from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._series import claimed, not_claimed


@final
class OutputCoverageError(Metric):
    r"""Distance of the coverage of stated 95 % intervals from 95 %, in percentage points.

    .. math:: \left| \frac{100}{n} \sum_k \left[ |y_k - \hat y_k| \le 1.96 \sqrt{v_k} \right] - 95 \right|

    with the claimed ``output`` :math:`\hat y` and ``output_variance`` v, that of a new observation, over all rows.
    Too wide intervals cost at most 5 points, too narrow ones up to 95.

    Validity: correct independent Gaussian intervals scatter around 95 % by :math:`\sqrt{95 \cdot 5 / n}` points, 0.34
    for 4000 rows. The smoother's output in sample is nearer to the target than a new observation would be.

    ``worst`` is that of intervals that hold nothing.

    Source: Gneiting, Balabdaoui, Raftery (2007), J. R. Statist. Soc. B 69, for coverage as a sign of calibration.

    Examples
    --------
    All four intervals hold: 100 % in place of 95 %.

    >>> import numpy as np
    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> claim = Estimate(output=np.zeros(4), output_variance=np.ones(4))
    >>> OutputCoverageError().score(example_outcome(claim, target=[1.0, -1.0, 0.5, -0.5]))
    5.0
    """

    unit = "%"
    worst = 95.0
    track = "output"
    practical_change = 1.0

    def skip(self, outcome: Outcome) -> str | None:
        return not_claimed(outcome, "output") or not_claimed(outcome, "output_variance")

    def score(self, outcome: Outcome) -> float:
        errors = outcome.regression.target - claimed(outcome, "output")
        return coverage_error_percent(errors, claimed(outcome, "output_variance"))
