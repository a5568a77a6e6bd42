"""How far the force is from the truth, sample by sample."""

from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._segments import no_segments, segments


@final
class ForceMeanAbsoluteError(Metric):
    r"""Mean absolute error of the withheld force as a time signal.

    .. math:: \frac{1}{n} \sum_k |\hat d_k - d_k|

    over all rows. It counts errors of size and of phase alike. An estimate of zero has the mean of |d|.

    Validity: plants that are measured in segments, see `fdbench.plants.SpectralPlant`.

    ``worst``, 40 N, is the highest force level of the published measurements.

    Source: Qu and Vogl (2021), Estimating dynamic cutting forces of machine tools from measured vibrations using sparse
    regression with nonlinear function basis, section 4.2, MAE.

    Examples
    --------
    The right size with the wrong sign in half of the samples.

    >>> from fdbench.metrics import example_segments
    >>> ForceMeanAbsoluteError().score(example_segments([3.0, 3.0, -3.0, -3.0], [3.0, -3.0, 3.0, -3.0]))
    3.0
    """

    unit = "N"
    worst = 40.0
    track = "disturbance"

    def skip(self, outcome: Outcome) -> str | None:
        return no_segments(outcome)

    def score(self, outcome: Outcome) -> float:
        estimate, truth = segments(outcome)
        return float(np.mean(np.abs(estimate - truth)))
