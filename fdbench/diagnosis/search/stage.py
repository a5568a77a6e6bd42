"""One round of the search: rival effects beside a base, and their tempered evidence."""

import math
from dataclasses import dataclass, field

from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.settings import SEARCH
from fdbench.effects import Effect


@dataclass(frozen=True, kw_only=True, eq=False)
class Rival:
    """A class of effect at one stage of the search.

    Attributes
    ----------
    kind : Effect class
    hypothesis : Hypothesis
        The base of the stage with the effect.
    misfit : float
        On held-out segments, weighted, after the fit.
    penalty : float
        Minus twice the log prior of the nominal parameters.
    refined : bool
        Whether it was fitted in closed loop, and not only linearly.
    size : float
        Mean square of what it changes in the base, in the run where that is most, in units of what repeats differ by.
    own_size : float
        The same of what it changes in its own hypothesis, where nothing is fitted again without it. It is larger where
        nominal parameters of the base stand in for the effect.
    """

    kind: type[Effect]
    hypothesis: Hypothesis
    misfit: float
    penalty: float
    refined: bool
    size: float
    own_size: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    r"""One round: the misfit without another effect, and what each class would make of it, best first.

    Attributes
    ----------
    base : Hypothesis
    misfit, penalty : float
        Of the base; all misfits of a stage have the weights of its base.
    test_count : float
        Weighted samples that are judged on.
    rivals : tuple of Rival
    effective : float
        Independent samples :math:`n` that a misfit M is worth in the tempered log evidence
        :math:`-\tfrac12 [n \ln M + \text{penalty}]`.
    """

    base: Hypothesis
    misfit: float
    penalty: float
    test_count: float
    rivals: tuple[Rival, ...]
    effective: float = field(default_factory=lambda: SEARCH.effective_samples)

    def gain(self, rival: Rival) -> float:
        r"""Return the share of the excess misfit that a rival removes.

        Nominal parameters that are far-fetched count too: see `equivalent_misfit`.
        """
        alone = equivalent_misfit(self.misfit, self.base, self.effective)
        return (alone - equivalent_misfit(rival.misfit, rival.hypothesis, self.effective)) / max(alone - 1.0, 1e-12)

    def log_evidence(self, misfit: float, penalty: float) -> float:
        """Return the tempered log evidence of a misfit."""
        return -0.5 * (self.effective * math.log(max(misfit, 1e-9)) + penalty)

    def probabilities(self) -> list[float]:
        """Return the probability of each rival; what is missing to 1 is that there is none.

        That one of the library is present is taken to be as likely beforehand as that none is.
        """
        logs = [self.log_evidence(rival.misfit, rival.penalty) for rival in self.rivals]
        logs.append(self.log_evidence(self.misfit, self.penalty) + math.log(max(len(self.base.nominal.library), 1)))
        weights = [math.exp(log - max(logs)) for log in logs]
        return [weight / sum(weights) for weight in weights[:-1]]

    def present(self) -> float:
        """Return the probability that one of the rivals is there."""
        return sum(self.probabilities())


def equivalent_misfit(misfit: float, hypothesis: Hypothesis, effective: float) -> float:
    r"""Return the misfit that has the same evidence without what is far-fetched of the nominal parameters.

    .. math:: M e^{p / n}

    with p of `Hypothesis.far_fetched`: up to there values are what data sheets may be wrong by.
    """
    return misfit * math.exp(hypothesis.far_fetched / effective)
