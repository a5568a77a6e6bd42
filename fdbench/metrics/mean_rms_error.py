"""How far the effective value of the force is from the truth."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._segments import no_segments, segments


@final
class MeanRmsError(Metric):
    r"""Mean over the segments of the absolute error of their root mean square force.

    .. math:: \frac{1}{n} \sum_i \left| \mathrm{rms}(\hat d_i) - \mathrm{rms}(d_i) \right|

    It is blind to the phase. An estimate of zero has the mean root mean square of the force.

    Validity and ``worst`` as for ``force_mean_absolute_error``.

    Source: Qu and Vogl (2021), Estimating dynamic cutting forces of machine tools from measured vibrations using sparse
    regression with nonlinear function basis, section 4.2, M-RMSE.

    Examples
    --------
    Effective forces of 4 N and 5 N, claimed as 4 N of the other sign and as nothing.

    >>> from fdbench.metrics import example_segments
    >>> MeanRmsError().score(example_segments([-4.0] * 4 + [0.0] * 4, [4.0] * 4 + [5.0] * 4))
    2.5
    """

    unit = "N"
    worst = 40.0
    track = "disturbance"

    def skip(self, outcome: Outcome) -> str | None:
        return no_segments(outcome)

    def score(self, outcome: Outcome) -> float:
        estimate, truth = (np.sqrt(np.mean(np.square(force), axis=1)) for force in segments(outcome))
        return float(np.mean(np.abs(estimate - truth)))
