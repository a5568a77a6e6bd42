"""How far mass and frictions, as they follow from the model's parameters, are from the truth."""

from typing import final

from fdbench.metrics._metric import Metric, Outcome
from fdbench.metrics._parameters import comparable, physical_parameters, relative_error_percent


@final
class PhysicalParameterError(Metric):
    r"""Root mean square of the relative errors of the physical parameters.

    .. math:: 100 \sqrt{\frac{1}{q} \sum_{j=1}^{q} \left( \frac{g_j(\hat\beta) - g_j(\beta)}{g_j(\beta)} \right)^2}

    with the plant's conversion g, ``plant.physical_parameters``, over those whose truth is finite and not zero. What
    cannot be converted (a parameter missing, a discrete pole that is not positive) counts as zero, an error of 100 %;
    a physical parameter that the estimate itself names is taken as it is.

    Validity: viscous friction follows from a discrete pole near 1 and multiplies its error: for the shaker
    (pole 0.9967) 1e-4 in the pole are 3 % in the friction. In cutting, the mean force grows with the feed and is taken
    for viscous friction: errors of hundreds of per cent there say little about the estimator.

    ``worst`` is ten times the error of learning nothing.

    Source: McPherson, thesis, 2024, eqs. 2.1 to 2.6, for the conversion.

    Examples
    --------
    A mass that is 3 % wrong, beside a friction that is right: 3 % over the root of two.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> true = {"beta_1": 0.8, "beta_2": 0.19}
    >>> right = example_outcome(Estimate(parameters=true), target=[0, 0], parameters=true)
    >>> mass_kg = physical_parameters(right, true)["mass_kg"]
    >>> claim = Estimate(parameters={**true, "mass_kg": 1.03 * mass_kg})
    >>> round(PhysicalParameterError().score(example_outcome(claim, target=[0, 0], parameters=true)), 6)
    2.12132
    """

    unit = "%"
    worst = 1000.0
    track = "parameters"

    def skip(self, outcome: Outcome) -> str | None:
        if not comparable(physical_parameters(outcome, outcome.truth.parameters)):
            return "the model has no physical parameters beside its own"
        return None if outcome.estimate.parameters else "the estimate claims no parameters"

    def score(self, outcome: Outcome) -> float:
        claimed = outcome.estimate.parameters
        estimates = {**physical_parameters(outcome, claimed), **claimed}
        return relative_error_percent(estimates, physical_parameters(outcome, outcome.truth.parameters))
