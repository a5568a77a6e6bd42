"""How far the disturbance force is from the truth."""

from typing import final

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._series import alternating_disturbance, no_disturbance
from fdbench.statistics import rms


@final
class DisturbanceError(Metric):
    r"""Root mean square error of the alternating disturbance relative to its own.

    .. math:: 100 \frac{\mathrm{rms}(\tilde{\hat d} - \tilde d)}{\mathrm{rms}(\tilde d)}, \quad
              \tilde d_k = d_k - \bar d

    Both forces without their mean over the scenario's window. The mean is left out because no estimator of the plant's
    parameters can tell it: a mean force acts like Coulomb friction at constant speed and, growing with the feed as a
    cutting force does, like viscous friction. An estimate of zero, or of any constant, has 100 %.

    Validity: one mean for the whole window; where the feed changes within it, the change of the mean force counts.
    Skipped where the true disturbance does not vary, as in control trials.

    ``decades`` is 2, an error of 1 %: a convention, no bound.

    ``worst`` is ten times the error of claiming nothing.

    Source: definition; the case is that of McPherson, thesis, 2024, chapter 4.

    Examples
    --------
    Half of the amplitude is missing; the mean of 7 N does not count.

    >>> import numpy as np
    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> claim = Estimate(disturbance_N=np.array([1.0, -1.0, 1.0, -1.0]))
    >>> DisturbanceError().score(example_outcome(claim, disturbance_N=[9.0, 5.0, 9.0, 5.0]))
    50.0
    """

    unit = "%"
    worst = 1000.0
    track = "disturbance"
    primary = True
    decades = 2.0

    def skip(self, outcome: Outcome) -> str | None:
        return no_disturbance(outcome)

    def score(self, outcome: Outcome) -> float:
        estimate, truth = alternating_disturbance(outcome)
        return 100.0 * rms(estimate - truth) / rms(truth)
