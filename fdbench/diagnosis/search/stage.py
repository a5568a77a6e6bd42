"""One round of the search: rival effects beside a base, and their tempered evidence."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.model.hypothesis import Hypothesis, at_bound, is_hollow
from fdbench.diagnosis.settings import JUDGE, SEARCH
from fdbench.effects import Effect
from fdbench.record import FloatArray

HOLLOW = 50.0  # log odds against what is hollow beside a look-alike that is not


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
        Minus twice the log prior of the nominal parameters, of a paraphrase as though one of the base stayed off.
    refined : bool
        Whether it was fitted in closed loop, and not only linearly.
    size : float
        Mean square of what it changes in the base, in the run where that is most, in units of what repeats differ by.
        A form of friction that stands in for it there does not count: the base has that of the hypothesis.
    own_size : float
        The same of what it changes in its own hypothesis, where nothing is fitted again without it. It is larger where
        nominal parameters of the base stand in for the effect.
    paraphrase : bool
        Whether it says what a nominal parameter of the base says by a change that has a name, and no more.
    fitted : float
        The misfit on the segments that were fitted.
    paired : float
        Log odds beyond the tempered evidence, from a comparison with look-alikes stretch by stretch: see `ranked`.
    """

    kind: type[Effect]
    hypothesis: Hypothesis
    misfit: float
    penalty: float
    refined: bool
    size: float
    own_size: float
    paraphrase: bool = False
    fitted: float = 1.0
    paired: float = 0.0

    @property
    def effect(self) -> Effect:
        """The effect that it adds to its base."""
        return self.hypothesis.effect_of(self.kind)

    def added_to(self, other: Hypothesis, base: Hypothesis) -> Hypothesis:
        """Return another hypothesis with its effect, in place of what it replaced of its base."""
        return other.with_effect(self.effect, *(set(self.hypothesis.replaced) - set(base.replaced)))


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
    fitted : float
        Misfit of the base on the segments that were fitted.
    """

    base: Hypothesis
    misfit: float
    penalty: float
    test_count: float
    rivals: tuple[Rival, ...]
    effective: float = field(default_factory=lambda: SEARCH.effective_samples)
    fitted: float = 1.0

    def rival(
        self,
        kind: type[Effect],
        hypothesis: Hypothesis,
        misfit: float,
        *,
        fitted: float,
        refined: bool,
        size: float,
        own_size: float,
    ) -> Rival:
        """Return a hypothesis with an effect of a class as a rival, and whether it paraphrases the base.

        A mode far above the band of the motion is a mass that rides along, and a mass that is wrong on paper is named
        as such. That a value is back where paper has it speaks for an effect only where that explains a good part of
        the misfit besides, or where the values of the base say nothing that has a name.
        """
        named, cheaper = hypothesis.named_penalty(), self.base.cause_penalty() - hypothesis.cause_penalty()
        has_a_name = cheaper > 0.0 and self.base.contradiction == 0.0
        paraphrase = has_a_name and self.misfit - misfit < SEARCH.besides * excess_of(self.misfit)
        return Rival(
            kind=kind,
            hypothesis=hypothesis,
            misfit=misfit,
            fitted=fitted,
            penalty=named + min(cheaper, self.base.cost_of_a_cause) if paraphrase else named,
            refined=refined,
            size=size,
            own_size=own_size,
            paraphrase=paraphrase,
        )

    def gain(self, rival: Rival) -> float:
        r"""Return the share of the excess misfit that a rival removes.

        Nominal parameters that are far-fetched count too, see `equivalent_misfit`, unless it is a paraphrase of them.
        Noise that repeats have more of than a run has within itself is no bound: half the misfit is always an excess.
        Of less than that noise there is no gain but by what takes half of it, by itself.
        """
        alone = equivalent_misfit(self.misfit, self.base, self.effective)
        if alone < 1.0 and rival.misfit > SEARCH.of_noise * self.misfit:
            return 0.0
        gain = alone - equivalent_misfit(
            rival.misfit, self.base if rival.paraphrase else rival.hypothesis, self.effective
        )
        return gain / excess_of(alone)

    def log_evidence(self, misfit: float, penalty: float) -> float:
        """Return the tempered log evidence of a misfit."""
        return -0.5 * (self.effective * math.log(max(misfit, 1e-9)) + penalty)

    def evidence_of(self, rival: Rival) -> float:
        """Return the log evidence of a rival, with what pairs say."""
        return self.log_evidence(rival.misfit, rival.penalty) + rival.paired

    def closest_where_fitted(self) -> Rival | None:
        """Return the refined rival that explains most of what is fitted, where that is worth a cause."""
        refined = (rival for rival in self.rivals if rival.refined)
        best = max(refined, key=lambda rival: self.log_evidence(rival.fitted, rival.penalty), default=None)
        alone = self.log_evidence(self.fitted, self.penalty) + 0.5 * self.base.cost_of_a_cause
        return best if best is not None and self.log_evidence(best.fitted, best.penalty) > alone else None

    def of(self, kind: type[Effect]) -> Rival:
        """Return the rival of a class."""
        return next(rival for rival in self.rivals if rival.kind is kind)

    def ahead_of(self, kind: type[Effect]) -> float:
        """Return the log odds of the best rival against that of a class."""
        return self.evidence_of(self.rivals[0]) - self.evidence_of(self.of(kind))

    def alike(self, gain: float) -> list[Rival]:
        """Return the rivals that remove nearly as much of the excess misfit, or more."""
        return [rival for rival in self.rivals if self.gain(rival) >= JUDGE.alike * gain]

    def probabilities(self) -> list[float]:
        """Return the probability of each rival; what is missing to 1 is that there is none.

        That one of the library is present is taken to be as likely beforehand as that none is.
        """
        logs = [self.evidence_of(rival) for rival in self.rivals]
        logs.append(self.log_evidence(self.misfit, self.penalty) + math.log(max(len(self.base.nominal.library), 1)))
        weights = [math.exp(log - max(logs)) for log in logs]
        return [weight / sum(weights) for weight in weights[:-1]]

    def present(self) -> float:
        """Return the probability that one of the rivals is there."""
        return sum(self.probabilities())

    def is_doubtful(self, rival: Rival) -> bool:
        """Whether it is too improbable that there is an effect for one to be added.

        What may be a trace, as every machine has of many effects, is there more probably than not.
        """
        is_trace = min(rival.size, rival.own_size) <= JUDGE.trace_size
        return self.present() < (0.5 if is_trace else SEARCH.worth_adding)

    def is_last(self) -> bool:
        """Whether no rival is worth adding, or there is none."""
        best = next(iter(self.rivals), None)
        return best is None or self.is_doubtful(best) or self.gain(best) < SEARCH.smallest_gain


def ranked(stage: Stage, squares: FloatArray) -> Stage:
    """Return a stage with its rivals in order, the most probable first, those that look alike told by pairs.

    Stretches that were fitted count, too: what look-alikes differ by is far more than another number fits there, which
    costs nothing. The number that brought one near a bound of its form costs 1 (Akaike 1974), by half, for at a bound
    it is free to one side alone (Self, Liang 1987, J. American Statistical Association 82, 605-610, case 5).

    Parameters
    ----------
    stage : Stage
    squares : (n_stretches, n_rivals) array
        Weighted squared gaps.
    """
    alike = look_alikes(stage)
    if len(alike) > 1 and len(squares) > 1:
        own = squares[:, [stage.rivals.index(rival) for rival in alike]]
        imitating = np.array([any(at_bound(item, SEARCH.imitates) for item in _own(rival)) for rival in alike])
        stage = told(stage, alike, log_odds_of_pairs(own, imitating, SEARCH.paired, 0.5))
    return in_order(stage)


def in_order(stage: Stage) -> Stage:
    """Return a stage with its rivals in order, the most probable first."""
    return replace(stage, rivals=tuple(sorted(stage.rivals, key=stage.evidence_of, reverse=True)))


def log_odds_of_pairs(
    squares: FloatArray, imitating: NDArray[np.bool_], certainty: float, of_imitation: float
) -> FloatArray:
    r"""Return the log odds of look-alikes, the closest first, by what they leave in stretches of time.

    Beside a rival that removes as much, errors of the model are the same, and cancel in the difference d of the
    weighted squared gaps over n stretches. The closest one has the log odds

    .. math:: \ln \frac{\Phi(c z)}{\Phi(-c z)}, \qquad z = \frac{\sum d}{\sqrt{n} s_d}

    against another one (Vuong 1989, Econometrica 57, 307-333, eq. 4.1). One that is near a bound of its form imitates
    another as far as it may: it is no closer for it than the closest that does not.

    Parameters
    ----------
    squares : (n_stretches, n_rivals) array
    imitating : (n_rivals,) array of bool
    certainty : float
        c: of standard errors, what counts.
    of_imitation : float
        Log odds against one that imitates.
    """
    behind = squares - squares[:, [int(np.argmin(imitating))]]
    scatter = np.sqrt(len(squares)) * behind.std(axis=0, ddof=1)
    scores = np.divide(behind.sum(axis=0), scatter, out=np.zeros(len(scatter)), where=scatter > 0.0)
    odds = np.array([_log_odds(certainty * max(float(z), 0.0)) for z in scores])
    return np.asarray(odds - of_imitation * imitating)


def told(stage: Stage, alike: Sequence[Rival], log_odds: FloatArray) -> Stage:
    """Return a stage in which look-alikes have these log odds, with their priors; together they stay as probable.

    What is hollow, see `is_hollow`, is none of its class beside one that is not.
    """
    own = [stage.evidence_of(rival) for rival in alike]
    hollow = np.array([any(map(is_hollow, _own(rival))) for rival in alike])
    odds = log_odds - 0.5 * np.array([rival.penalty for rival in alike]) - HOLLOW * (hollow & ~hollow.all())
    level = float(np.logaddexp.reduce(own) - np.logaddexp.reduce(odds))
    paired = dict(zip(map(id, alike), (odds + level - own + [rival.paired for rival in alike]).tolist(), strict=True))
    rivals = [replace(rival, paired=paired.get(id(rival), rival.paired)) for rival in stage.rivals]
    return replace(stage, rivals=tuple(rivals))


def _own(rival: Rival) -> list[Effect]:
    # A fit without an effect is compared as any other.
    return [rival.effect] if rival.hypothesis.has(rival.kind) else []


def look_alikes(stage: Stage) -> list[Rival]:
    """Return the rivals that were refined and remove nearly as much as the best, that with the least misfit first."""
    most = max(map(stage.gain, stage.rivals), default=0.0)
    found = stage.alike(most) if most > 0.0 else []
    return sorted((rival for rival in found if rival.refined), key=lambda rival: rival.misfit)


def _log_odds(z: float) -> float:
    """Return the log odds of what lies z standard errors behind."""
    z = min(z, 30.0) / math.sqrt(2.0)
    return math.log(math.erfc(z) / math.erfc(-z))


def excess_of(misfit: float) -> float:
    """Return what of a misfit an effect may explain: what is over noise, but at least half of it."""
    return max(misfit - 1.0, 0.5 * misfit)


def equivalent_misfit(misfit: float, hypothesis: Hypothesis, effective: float) -> float:
    r"""Return the misfit that has the same evidence without what is far-fetched of the nominal parameters.

    .. math:: M e^{p / n}

    with p of `Hypothesis.implausible`: up to there values are what data sheets may be wrong by.
    """
    return misfit * math.exp(hypothesis.implausible / effective)
