"""Screen: candidates fitted linearly beside a base, by which classes of effects are ranked before any is refined."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evidence.least_squares import Fit, Scores
from fdbench.diagnosis.model.candidates import Candidate, candidates
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.search.periods import located
from fdbench.diagnosis.search.refinement import Refinement, prior_weight
from fdbench.diagnosis.search.stage import equivalent_misfit, excess_of
from fdbench.diagnosis.settings import SEARCH
from fdbench.effects import Effect

OfClass = dict[type[Effect], tuple[Candidate, Fit]]  # the best candidate of each class, and its fit


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """Linear fits of the base alone and with each candidate; rms of the gap and of the responses to candidates."""

    alone: Fit
    every: list[Candidate]
    fits: list[Fit]
    gap: float
    sizes: list[float]


class Screen:
    """Linear fits beside one base.

    Parameters
    ----------
    refinement : Refinement
        Of the runs.
    base : Hypothesis
    """

    def __init__(self, refinement: Refinement, base: Hypothesis) -> None:
        self.refinement, self.base = refinement, base
        self.split = refinement.split

    def candidates(self) -> list[Candidate]:
        """Return all candidates, with what is located in what the base leaves."""
        lines = located(self.refinement.readings, self.split, self.base)
        return candidates(self.base, lines, self.split.runs[0].period_s)

    def fitted(self, every: Sequence[Candidate], gap: float, n_classes: int | None = None) -> Screened:
        """Return candidates on all that is fitted, none by far larger than the gap; of the best classes, or of all.

        Most that is too large is seen to be so on the shortest record, and which classes have a chance.
        """
        places = self.split.fitted
        if len(places) > 1:
            shortest = [min(places, key=lambda place: self.split.runs[place].n_samples)]
            if n_classes is None:
                every = _not_oversized(self.fits(every, shortest), gap)
            else:
                every = self._of_best_classes(self._of_right_size(every, gap, shortest), n_classes)
        return self._of_right_size(every, gap, places)

    def _of_right_size(self, every: Sequence[Candidate], gap: float, places: Sequence[int]) -> Screened:
        """Return the candidates on some runs; where a response is by far larger than the gap, of one as large."""
        found = self.fits(every, places)
        smaller = _not_oversized(found, gap)
        large = [place for place, item in enumerate(smaller) if item is not found.every[place]]
        if large:
            again = self.fits([smaller[place] for place in large], places)
            for place, fit in zip(large, again.fits, strict=True):
                found.fits[place] = fit
        return dataclasses.replace(found, every=smaller)

    def sized(self, found: Screened) -> tuple[OfClass, Fit]:
        """Return the best candidate of the best classes at the best of several sizes, and the fit of the base alone.

        They are fitted linearly and judged on all samples; the best class comes first.
        """
        best = self.best_of_class(found)
        order = sorted(best, key=lambda kind: self.cost(best[kind][1]))[: SEARCH.rescaled]
        rescaled = [size for kind in order for size in best[kind][0].sizes(SEARCH.sizes)]
        screened = self.fits(rescaled)
        sized = self.best_of_class(screened)
        order = sorted(sized, key=lambda kind: self.cost(sized[kind][1], sized[kind][1].misfit))
        return {kind: sized[kind] for kind in order}, screened.alone

    def _of_best_classes(self, found: Screened, n_classes: int) -> list[Candidate]:
        """Return the candidates of the classes that fit best."""
        best = self.best_of_class(found)
        kinds = sorted(best, key=lambda kind: self.cost(best[kind][1]))[:n_classes]
        return [item for item in found.every if item.kind in kinds]

    def takes_any(self, found: Screened) -> bool:
        """Return whether any fit of what is fitted falls below that of the base alone by what may be evidence."""
        least = min(map(self.cost, found.fits), default=math.inf)
        return self.cost(found.alone) - least >= SEARCH.smallest_fall

    def worthwhile(self, sized: OfClass, alone: Fit) -> set[type[Effect]]:
        """Return the classes that gain most beside a fit of the base alone, held out or where it is fitted.

        A shape that is not fitted yet can be right on what is fitted, and wrong on what is held out. What shows nothing
        in a linear fit may be far from linear, which matters where much is left.
        """
        cost, misfit = self.cost(alone), self._equivalent(alone)
        falls = {kind: cost - self.cost(fit) for kind, (_, fit) in sized.items()}
        gains = {kind: misfit - self._equivalent(fit) for kind, (_, fit) in sized.items()}
        if alone.misfit >= SEARCH.unexplained:
            return foremost(gains) | foremost(falls)
        least = SEARCH.promising * SEARCH.smallest_gain * excess_of(misfit)
        return foremost(gains, least) | foremost(falls, SEARCH.smallest_fall)

    def best_of_class(self, found: Screened) -> OfClass:
        """Return of each class the candidate that fits best, as it is fitted."""
        best: OfClass = {}
        costs: dict[type[Effect], float] = {}
        for candidate, fit in zip(found.every, found.fits, strict=True):
            scaled, cost = self._scaled(candidate, fit), self.cost(fit)
            if scaled is not None and cost < costs.get(candidate.kind, math.inf):
                best[candidate.kind], costs[candidate.kind] = (scaled, fit), cost
        return best

    def cost(self, fit: Fit, misfit: float | None = None) -> float:
        """Return minus twice the tempered log evidence of a linear fit: its misfit, and how far values move.

        The misfit is that of what is fitted where none is given.
        """
        left = max(fit.train if misfit is None else misfit, 1e-9)
        return SEARCH.effective_samples * math.log(left) + self.base.moved(fit.coefficients).prior_penalty()

    def fits(self, every: Sequence[Candidate], places: Sequence[int] | None = None) -> Screened:
        """Fit the base and it with each candidate linearly, on some runs or on all."""
        base = self.base
        columns: list[tuple[int, ...]] = []
        variants: list[Hypothesis] = []
        for candidate in every:
            first = 1 + len(base.shifts) + len(variants)
            variants += candidate.hypotheses(base)
            columns.append(tuple(range(first, 1 + len(base.shifts) + len(variants))))
        most = max((len(own) for own in columns), default=1)
        evidence = self.refinement.responses(base, variants, places, neighbours=most, roughly=True)
        nuisances = list(range(1, 1 + len(base.shifts)))
        inside = ~evidence.held_out
        priors, room = base.priors(prior_weight(float(evidence.squares(held_out=False)[0]))), base.room()
        scores = Scores(evidence, dict(enumerate(priors, start=1)), dict(enumerate(room, start=1)))
        deviations = np.sqrt(np.diagonal(scores.train) / float(evidence.counts[inside].sum()))
        return Screened(
            alone=scores.fit(nuisances),
            every=[*every],
            fits=[_within_bounds(item, scores, nuisances, own) for item, own in zip(every, columns, strict=True)],
            gap=max(float(deviations[0]), 1e-150),
            sizes=[float(deviations[list(own)].max()) for own in columns],
        )

    def _equivalent(self, fit: Fit) -> float:
        return equivalent_misfit(fit.misfit, self.base.moved(fit.coefficients), SEARCH.effective_samples)

    def _scaled(self, candidate: Candidate, fit: Fit) -> Candidate | None:
        return candidate.scaled(fit.coefficients[len(self.base.shifts) :].tolist())


def foremost(gains: Mapping[type[Effect], float], least: float = 0.0) -> set[type[Effect]]:
    """Return the classes that gain most, as far as they gain a share of the most, and no less than the least."""
    most = max(gains.values(), default=0.0)
    first = sorted(gains, key=lambda kind: -gains[kind])[: SEARCH.refined]
    return {kind for kind in first if gains[kind] >= max(SEARCH.serious * most, least)} if most > 0.0 else set()


def _not_oversized(found: Screened, gap: float) -> list[Candidate]:
    """Return candidates as they are, or as large as the gap where their response is by far larger."""
    ratios = [size / gap for size in found.sizes]
    return [
        item if ratio <= SEARCH.oversized or item.replaces is not None else item.sizes([1.0 / ratio])[0]
        for item, ratio in zip(found.every, ratios, strict=True)
    ]


def _within_bounds(candidate: Candidate, scores: Scores, nuisances: Sequence[int], own: Sequence[int]) -> Fit:
    """Return the linear fit of a candidate, or that without its further amplitudes where they break a bound."""
    fit = scores.fit([*nuisances, *own])
    further = len(candidate.kind.further_amplitudes)
    if further == 0 or candidate.scaled(fit.coefficients[len(nuisances) :].tolist()) is not None:
        return fit
    alone = scores.fit([*nuisances, *own[:-further]])
    return dataclasses.replace(alone, coefficients=np.append(alone.coefficients, np.zeros(further)))
