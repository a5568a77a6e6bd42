"""Search: add the effect that explains most, refine it in closed-loop simulation, look again at what is left.

One class, in one file: its steps hand on what they have simulated.
"""

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from fdbench.diagnosis.evidence.evidence import Evidence, fitted_part, gather
from fdbench.diagnosis.evidence.least_squares import Fit, Scores
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.candidates import Candidate, candidates
from fdbench.diagnosis.model.friction_parameters import FrictionForm
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.parameter_vector import adjustables_of, parameter_vector, with_parameters
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.search.periods import located
from fdbench.diagnosis.search.stage import Rival, Stage, equivalent_misfit
from fdbench.diagnosis.settings import SEARCH
from fdbench.effects import Effect


class Search:
    """Search of one set of runs.

    Parameters
    ----------
    readings : Readings
        Of the runs of the split.
    split : Split
    progress : callable, optional
        Told in words what is being done.
    """

    def __init__(self, readings: Readings, split: Split, progress: Callable[[str], None] | None = None) -> None:
        self.progress = progress or (lambda text: None)
        self.look_at(readings, split)

    def look_at(self, readings: Readings, split: Split) -> None:
        """Search other readings, or the same ones split or weighted otherwise, from now on."""
        self.readings, self.split = readings, split
        self._fitted_readings, self._fitted_split = fitted_part(readings, split)

    def run(self, base: Hypothesis) -> tuple[Hypothesis, list[Stage]]:
        """Return the final hypothesis and the stages that led to it."""
        stages: list[Stage] = []
        while len(base.effects) < SEARCH.most_effects:
            self.progress(f"looking for effect {len(base.effects) + 1}")
            stage = self.stage(base)
            if stage is None:
                break
            stages.append(stage)
            if stage.present() < 0.5 or stage.gain(stage.rivals[0]) < SEARCH.smallest_gain:
                break
            base = stage.rivals[0].hypothesis
        return base, stages

    def stage(self, base: Hypothesis) -> Stage | None:
        """Rank all classes of effects as the next one; None where the base leaves noise alone."""
        every = candidates(base, located(self.readings, self.split, base), self.split.runs[0].period_s)
        alone, fits, responses = self._screen(base, every, fitted_only=True)
        if alone.train < SEARCH.noise_alone:
            return None
        large = [
            place
            for place, response in enumerate(responses)
            if response > SEARCH.oversized and every[place].replaces is None
        ]
        if large:
            smaller = [every[place].sizes([1.0 / responses[place]])[0] for place in large]
            _, fitted_again, _ = self._screen(base, smaller, fitted_only=True)
            for place, candidate, fit in zip(large, smaller, fitted_again, strict=True):
                every[place], fits[place] = candidate, fit
        best = self._best_of_class(base, every, fits)
        order = sorted(best, key=lambda kind: _cost(base, best[kind][1].train, best[kind][1]))[: SEARCH.rescaled]
        again = [size for kind in order for size in best[kind][0].sizes(SEARCH.sizes)]
        alone, fits, _ = self._screen(base, again)
        ranked = self._best_of_class(base, again, fits)
        order = sorted(ranked, key=lambda kind: _cost(base, ranked[kind][1].misfit, ranked[kind][1]))
        without = _equivalent(base, alone)
        gains = {kind: without - _equivalent(base, fit) for kind, (_, fit) in ranked.items()}
        most = max(gains.values(), default=0.0)
        hypotheses = []
        for place, kind in enumerate(order):
            candidate, fit = ranked[kind]
            hypothesis = base.with_effect(candidate.members[0], candidate.replaces).moved(fit.coefficients)
            first = place < SEARCH.refined or gains[kind] == most
            serious = first and gains[kind] >= SEARCH.serious * most > 0.0
            if serious:
                self.progress(f"refining {kind.name}")
                hypothesis = self.refined_anew(hypothesis, base)
            hypotheses.append((kind, hypothesis, serious))
        return self.compared(base, hypotheses)

    def compared(self, base: Hypothesis, hypotheses: Sequence[tuple[type[Effect], Hypothesis, bool]]) -> Stage:
        """Judge hypotheses beside a base on the held-out segments, with the weights of the base."""
        rivalling = [hypothesis for _, hypothesis, _ in hypotheses]
        evidence = gather(self.readings, self.split, base, rivalling, keep=rivalling)
        alone, *misfits = evidence.misfits(held_out=True).tolist()
        outside = evidence.held_out
        sizes = evidence.sizes(self.split)[1:].tolist()
        rivals = [
            Rival(
                kind=kind,
                hypothesis=hypothesis,
                misfit=misfit,
                penalty=hypothesis.prior_penalty(),
                refined=refined,
                size=size,
            )
            for (kind, hypothesis, refined), misfit, size in zip(hypotheses, misfits, sizes, strict=True)
        ]
        stage = Stage(
            base=base,
            misfit=alone,
            penalty=base.prior_penalty(),
            test_count=float(np.sum(evidence.counts[outside])),
            rivals=tuple(rivals),
            effective=min(SEARCH.effective_samples, float(len(np.unique(evidence.group[outside])))),
        )
        rivals.sort(key=lambda rival: -stage.log_evidence(rival.misfit, rival.penalty))
        return dataclasses.replace(stage, rivals=tuple(rivals))

    def review(self, final: Hypothesis, stages: Sequence[Stage]) -> tuple[Hypothesis, list[Stage]]:
        """Pit each effect against its rivals beside all others; what is superfluous goes, what is worse is replaced.

        Returns
        -------
        final : Hypothesis
        contests : list of Stage
            One for each effect of the final hypothesis: the model without it, and what rivals make of that.
        """
        origin = {rival.kind: stage for stage in reversed(stages) for rival in stage.rivals}
        contests = self._contests(final, origin)
        for _ in range(SEARCH.reviews):
            weak = [item for item in contests if item.present() < 0.5]
            beaten = [
                contest
                for contest, effect in zip(contests, final.effects, strict=True)
                if contest.rivals[0].kind is not type(effect)
            ]
            if not weak and not beaten:
                break
            final = min(weak, key=Stage.present).base if weak else beaten[0].rivals[0].hypothesis
            contests = self._contests(final, origin)
        return final, contests

    def _contests(self, final: Hypothesis, origin: Mapping[type[Effect], Stage]) -> list[Stage]:
        return [self._contest(final, type(effect), origin[type(effect)]) for effect in final.effects]

    def _contest(self, final: Hypothesis, kind: type[Effect], origin: Stage) -> Stage:
        present = {type(effect) for effect in final.effects}
        if {type(effect) for effect in origin.base.effects} == present - {kind}:
            return origin
        self.progress(f"doing without {kind.name}")
        others = self.refine(final.without_effect(kind))
        found = [(kind, final, True)]
        for rival in origin.rivals:
            if rival.refined and rival.kind not in present:
                replaced = set(rival.hypothesis.replaced) - set(origin.base.replaced)
                tried = others.with_effect(rival.hypothesis.effects[-1], *replaced)
                found.append((rival.kind, self.refine(tried), True))
        return self.compared(others, found)

    def _screen(
        self, base: Hypothesis, every: Sequence[Candidate], *, fitted_only: bool = False
    ) -> tuple[Fit, list[Fit], list[float]]:
        """Return linear fits of base and candidates, and how large the response to each is beside the gap."""
        shifted = base.moved_in_turn()
        columns: list[tuple[int, ...]] = []
        variants = list(shifted)
        for candidate in every:
            first = 1 + len(variants)
            variants += candidate.hypotheses(base)
            columns.append(tuple(range(first, 1 + len(variants))))
        gathered = self._gather_fitted if fitted_only else self._gather
        evidence = gathered(base, variants, shifted)
        nuisances = list(range(1, 1 + len(shifted)))
        alone = float(evidence.squares()[~evidence.held_out, 0].sum())
        priors, room = base.priors(prior_weight(alone)), base.room()
        scores = Scores(evidence, dict(enumerate(priors, start=1)), dict(enumerate(room, start=1)))
        squares = np.diagonal(evidence.products[~evidence.held_out].sum(axis=0))
        ratios = np.sqrt(squares / max(float(squares[0]), 1e-300))
        responses = [float(ratios[list(own)].max()) for own in columns]
        return scores.fit(nuisances), [scores.fit([*nuisances, *own]) for own in columns], responses

    def _best_of_class(
        self, base: Hypothesis, every: Sequence[Candidate], fits: Sequence[Fit]
    ) -> dict[type[Effect], tuple[Candidate, Fit]]:
        best: dict[type[Effect], tuple[Candidate, Fit]] = {}
        costs: dict[type[Effect], float] = {}
        for candidate, fit in zip(every, fits, strict=True):
            scaled = candidate.scaled(fit.coefficients[len(base.shifts) :].tolist())
            cost = _cost(base, fit.train, fit)
            if scaled is not None and cost < costs.get(candidate.kind, math.inf):
                best[candidate.kind], costs[candidate.kind] = (scaled, fit), cost
        return best

    def calibrate(self, given: Hypothesis) -> Hypothesis:
        """Fit the nominal parameters: first those that a data sheet has, then the form of friction beside them.

        A form that moves from the start can stand in for a friction that is not yet of the right size.
        """
        form = [item.name for item in nominal_parameters(given.nominal) if isinstance(item, FrictionForm)]
        return self.refine(self.refine(given, fixed=form)) if form else self.refine(given)

    def refine(self, hypothesis: Hypothesis, fixed: Collection[str] = (), *, tempered: bool = True) -> Hypothesis:
        """Fit all numbers of a hypothesis but fixed ones on the training segments in closed loop.

        What is minimised are the weighted squares and, `prior_weight` times, the prior penalty, by damped Gauss-Newton
        steps (Levenberg 1944, Marquardt 1963): the normal matrix has its diagonal raised by several factors at once,
        all of these steps are simulated together, and the best is taken. What is to predict best, and is compared with
        nothing, is fitted by all samples as they are, not ``tempered``.
        """
        given = hypothesis
        for _ in range(SEARCH.steps):
            evidence = self.probed(hypothesis, fixed=fixed)
            inside = ~evidence.held_out
            alone = float(evidence.squares()[inside, 0].sum())
            weight = prior_weight(alone) if tempered else 1.0
            before = alone + weight * hypothesis.prior_penalty()
            excess = alone - float((evidence.weights * evidence.counts)[inside].sum())
            enough = max(SEARCH.converged * excess, SEARCH.smallest_fall)
            for dampings in (SEARCH.dampings, SEARCH.further_dampings):
                trials, after, promised = self._steps(hypothesis, evidence, dampings, fixed, weight)
                best, was = int(np.argmin(after)), hypothesis
                if after[best] < before:
                    hypothesis = trials[best]
                self._fitted_readings.forget([item for item in (was, *trials) if item not in (given, hypothesis)])
                if after[best] < before or before - promised < enough:
                    break
            if before - after[best] < enough:
                break
        return hypothesis

    def _steps(
        self,
        hypothesis: Hypothesis,
        probed: Evidence,
        dampings: Sequence[float],
        fixed: Collection[str],
        weight: float,
    ) -> tuple[list[Hypothesis], list[float], float]:
        """Return the steps of several dampings, the objective after each, and what the undamped linear fit promises."""
        numbers, values = adjustables_of(hypothesis), parameter_vector(hypothesis)
        moving = [place for place, item in enumerate(numbers) if item.name not in fixed]
        known = [(column, place) for column, place in enumerate(moving, 1) if numbers[place].prior]
        priors, room = hypothesis.priors(weight), hypothesis.room()
        scores = Scores(
            probed, {column: priors[place] for column, place in known}, {column: room[place] for column, place in known}
        )
        fits = [scores.fit(range(1, 1 + len(moving)), damping) for damping in (0.0, *dampings)]
        steps = np.zeros((len(fits), len(numbers)))
        steps[:, moving] = [fit.coefficients for fit in fits]
        steps *= [item.step for item in numbers]
        undamped, *trials = (with_parameters(hypothesis, values + step) for step in steps)
        judged = self._gather_fitted(hypothesis, trials, trials)
        _, *squares = (judged.squares()[~judged.held_out].sum(axis=0)).tolist()
        after = [own + weight * trial.prior_penalty() for own, trial in zip(squares, trials, strict=True)]
        return trials, after, fits[0].squares + weight * undamped.prior_penalty()

    def refined_anew(self, hypothesis: Hypothesis, base: Hypothesis) -> Hypothesis:
        """Return the better of two refinements: from here, and where the base is far-fetched, from nominal parameters.

        Nominal parameters that stand in for an effect that is not there yet are far off, and stay there beside it.
        """
        found = self.refine(hypothesis)
        if base.far_fetched == 0.0:
            return found
        anew = self.refine(dataclasses.replace(hypothesis, shifts=(0.0,) * len(hypothesis.shifts)))
        evidence = self._gather_fitted(base, [found, anew], [found, anew])
        alone, *squares = evidence.squares()[~evidence.held_out].sum(axis=0).tolist()
        weight = prior_weight(alone)
        return min(
            zip(squares, (found, anew), strict=True), key=lambda item: item[0] + weight * item[1].prior_penalty()
        )[1]

    def probed(
        self, hypothesis: Hypothesis, beside: Sequence[Hypothesis] = (), fixed: Collection[str] = ()
    ) -> Evidence:
        """Return the responses to a step of each number but fixed ones, on the runs of which something is fitted.

        Those of the hypotheses ``beside`` it follow.
        """
        values, numbers = parameter_vector(hypothesis), adjustables_of(hypothesis)
        steps = np.diag([item.step for item in numbers])
        moved = [row for row, item in zip(steps, numbers, strict=True) if item.name not in fixed]
        probes = [with_parameters(hypothesis, values + row) for row in moved]
        return self._gather_fitted(hypothesis, [*probes, *beside])

    def _gather(self, base: Hypothesis, variants: Sequence[Hypothesis], keep: Sequence[Hypothesis] = ()) -> Evidence:
        return gather(self.readings, self.split, base, variants, keep=keep)

    def _gather_fitted(
        self, base: Hypothesis, variants: Sequence[Hypothesis], keep: Sequence[Hypothesis] = ()
    ) -> Evidence:
        return gather(self._fitted_readings, self._fitted_split, base, variants, self.split.fitted, keep=keep)


def prior_weight(squares: float) -> float:
    r"""Return how much a prior penalty p counts beside weighted squares S, so that both fit as they are judged.

    .. math:: n \ln S + p, \qquad \mathrm{d}S + \frac{S}{n}\, \mathrm{d}p = 0

    with the effective samples n of `fdbench.diagnosis.search.stage.Stage`: at least 1, where there are fewer samples.
    """
    return max(1.0, squares / SEARCH.effective_samples)


def _cost(base: Hypothesis, misfit: float, fit: Fit) -> float:
    """Return minus twice the tempered log evidence of a linear fit: its misfit, and how far nominal parameters move."""
    return SEARCH.effective_samples * math.log(max(misfit, 1e-9)) + base.moved(fit.coefficients).prior_penalty()


def _equivalent(base: Hypothesis, fit: Fit) -> float:
    return equivalent_misfit(fit.misfit, base.moved(fit.coefficients), SEARCH.effective_samples)
