"""Search: add the effect that explains most, refine it in closed-loop simulation, look again at what is left."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fdbench.diagnosis.evidence.evidence import gather
from fdbench.diagnosis.evidence.least_squares import Fit
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.candidates import Candidate, with_other_numbers
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.search.beside_traces import beside_traces
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.search.screen import Screen
from fdbench.diagnosis.search.stage import (
    Rival,
    Stage,
    in_order,
    log_odds_of_pairs,
    look_alikes,
    ranked,
    told,
)
from fdbench.diagnosis.settings import JUDGE, SEARCH
from fdbench.effects import Effect


class Search:
    """Search of one set of runs.

    Parameters
    ----------
    refinement : Refinement
        Of the runs.
    progress : callable, optional
        Told in words what is being done.
    """

    def __init__(self, refinement: Refinement, progress: Callable[[str], None] | None = None) -> None:
        self.refinement, self.progress = refinement, progress or (lambda text: None)

    @property
    def readings(self) -> Readings:
        """Readings of the runs of the split."""
        return self.refinement.readings

    @property
    def split(self) -> Split:
        """Runs, and which samples of each are judged on."""
        return self.refinement.split

    def run(self, base: Hypothesis) -> tuple[Hypothesis, list[Stage]]:
        """Return the final hypothesis and the stages that led to it."""
        stages: list[Stage] = []
        while len(base.effects) < SEARCH.most_effects:
            base = self.refinement.look_closely(base)
            self.progress(f"looking for effect {len(base.effects) + 1}")
            stage = self.stage(base)
            if stage is None:
                break
            stages.append(stage)
            if not stage.is_last():
                base = stage.rivals[0].hypothesis
            elif (pair := self._pair(stage)) is not None:
                stages.append(pair)
                base = pair.rivals[0].hypothesis
            else:
                break
        return base, stages

    def _pair(self, stage: Stage) -> Stage | None:
        """Return the stage of a second effect, where the last stage has none that is worth adding, but two together.

        Beside an effect that is not found yet another one may explain what is fitted, and nothing of what is held out.
        """
        first = stage.closest_where_fitted()
        room = len(stage.base.effects) + 2 <= SEARCH.most_effects
        if stage.misfit < SEARCH.unexplained or first is None or not room:
            return None
        second = self.stage(first.hypothesis)
        if second is None or second.is_last():
            return None
        best = second.rivals[0]
        (both,) = self.compared(stage.base, [(best.kind, best.hypothesis, True)]).rivals
        gain = stage.evidence_of(both) - stage.log_evidence(stage.misfit, stage.penalty)
        return second if gain > stage.base.cost_of_a_cause else None

    def stage(self, base: Hypothesis) -> Stage | None:
        """Rank all classes of effects as the next one; None where there is nothing to be explained by any.

        So it is where the base does not strain and leaves noise alone, or where no value of it may be a cause and no
        class takes anything of what it leaves, if that is not much.
        """
        screen = Screen(self.refinement, base)
        before = screen.fits((), self.split.fitted)
        # Values that strain may hide an effect where noise alone is left, too.
        strains = base.named_penalty() > base.cost_of_a_cause
        if before.alone.train < SEARCH.noise_alone and not strains:
            return None
        every = screen.candidates()
        fitted = screen.fitted(every, before.gap)
        is_near = base.apart_from(base.as_on_paper()) <= JUDGE.beyond_doubt
        if is_near and not screen.takes_any(fitted) and self._most_left(base) < SEARCH.unexplained:
            return None
        sized, alone = screen.sized(fitted)
        worthwhile, unhidden = screen.worthwhile(sized, alone), self._unhidden(base, every, before.gap)
        hypotheses, ahead = [], self.refinement.better(base, [base, *unhidden.values()])
        for kind in dict.fromkeys((*sized, *unhidden)):
            found = None
            if kind in worthwhile:
                found = self.with_best_number(base, self._refined(base, *sized[kind], ahead))
                ahead = self.refinement.better(base, [ahead, found])
            if kind in unhidden and (found is None or self.refinement.is_closer(base, unhidden[kind], found)):
                found = unhidden[kind]
            hypotheses.append((kind, _linear(base, *sized[kind]) if found is None else found, found is not None))
        stage = self.contested(base, hypotheses)
        if not stage.is_last() or before.alone.train < SEARCH.unexplained:
            return stage
        fruitful = {rival.kind for rival in stage.rivals if rival.refined and stage.gain(rival) >= SEARCH.smallest_gain}
        return self.contested(
            base, [item if item[0] in fruitful else self._looked_at_again(base, *item[:2]) for item in hypotheses]
        )

    def _most_left(self, base: Hypothesis) -> float:
        """Return the misfit of a base where it is fitted or where it is judged, whichever is more."""
        evidence = gather(self.readings, self.split, base, ())
        return max(float(evidence.misfits(held_out=part)[0]) for part in (True, False))

    def _refined(self, base: Hypothesis, candidate: Candidate, fit: Fit, ahead: Hypothesis) -> Hypothesis:
        """Return the best refinement of a candidate; one that falls hopelessly behind what is ``ahead`` is given up."""
        self.progress(f"refining {candidate.kind.name}")
        first, *others = self._starts(base, _linear(base, candidate, fit), candidate)
        found = self.refinement.best_from(base, others, self.refinement.refine(first, ahead=ahead), ahead)
        return self.refined_anew(found, base, ahead)

    def with_best_number(self, base: Hypothesis, found: Hypothesis) -> Hypothesis:
        """Return the best refinement over the whole numbers of the effect that a hypothesis ends with.

        No fit moves these, and a linear one tells them badly: tools of two teeth and of three may have the same line.
        """
        starts = [[base.with_effect(item) for item in own] for own in with_other_numbers(found.effects[-1])]
        return self.refinement.best_from(found, [self.refinement.better(found, own) for own in starts], found)

    def refined_anew(self, found: Hypothesis, base: Hypothesis, ahead: Hypothesis | None = None) -> Hypothesis:
        """Return the better of a refinement and, where the base may stand in, of one from nominal parameters as given.

        Those that stand in for an effect that is not there yet are far off, and stay there beside it; so does a free
        form of friction beside an effect that is friction over velocity.
        """
        if base.far_fetched == 0.0 and found.effects[-1].type_of() != "friction_over_velocity":
            return found
        return self.refinement.best_from(base, [found.as_on_paper()], found, ahead)

    def _looked_at_again(
        self, base: Hypothesis, kind: type[Effect], linear: Hypothesis
    ) -> tuple[type[Effect], Hypothesis, bool]:
        """Return a class that was only fitted linearly, or refined in vain, from its usual size, if that is better.

        What is far from proportional to its size, such as a resonance that moves, shows nothing in a linear fit. What
        stands in place of a known effect has no other size.
        """
        if linear.replaced != base.replaced:
            return kind, linear, False
        self.progress(f"refining {kind.name}")
        effect = linear.effects[-1]
        amplitude = next(item for item in kind.parameters() if item.name == kind.amplitude)
        sizes = (amplitude.typical, -amplitude.typical) if amplitude.low < 0.0 else (amplitude.typical,)
        starts = [base.with_effect(effect.within(**{amplitude.name: size})) for size in sizes]
        return kind, self.refinement.best_from(base, starts, linear), True

    def _unhidden(self, base: Hypothesis, every: Sequence[Candidate], gap: float) -> dict[type[Effect], Hypothesis]:
        """Return the classes that fit best beside nominal parameters as given, refined, where those of the base strain.

        An effect that they stand in for has nothing to explain beside them, and their responses are others there. One
        beside which they go back to the base is refined from there, if at all.
        """
        given = base.as_on_paper()
        if base.apart_from(given) <= SEARCH.strained:
            return {}
        screen = Screen(self.refinement, given)
        best = screen.best_of_class(screen.fitted(every, gap, SEARCH.tried_unhidden))
        found, ahead = {}, base
        for kind in sorted(best, key=lambda kind: screen.cost(best[kind][1]))[: SEARCH.unhidden]:
            self.progress(f"refining {kind.name}")
            candidate, _ = best[kind]
            begun = given.with_effect(candidate.members[0], candidate.replaces)
            refined = self.refinement.refine(begun, ahead=ahead, away_from=base)
            if not refined.is_nearer_to(base) and self.refinement.better(base, [base, refined]) is refined:
                found[kind], ahead = refined, self.refinement.better(base, [ahead, refined])
        return found

    def contested(self, base: Hypothesis, hypotheses: Sequence[tuple[type[Effect], Hypothesis, bool]]) -> Stage:
        """Judge hypotheses beside a base; what looks like the best one also begins where that ended.

        A fit that stopped elsewhere would decide between effects that differ by less.
        """
        stage = self.compared(base, hypotheses)
        alike = [] if stage.is_last() else look_alikes(stage)
        if len(alike) < 2:
            return stage
        best, *others = alike
        again: dict[type[Effect], Hypothesis] = {}
        for rival in others:
            if rival.hypothesis.replaced == best.hypothesis.replaced:
                self.progress(f"{rival.kind.name} in place of {best.kind.name}")
                exchanged = best.hypothesis.without_effect(best.kind).with_effect(rival.effect)
                exchanged = self.refinement.refine(exchanged, ahead=rival.hypothesis)
                if self.refinement.better(base, [rival.hypothesis, exchanged]) is exchanged:
                    again[rival.kind] = exchanged
        if again:
            stage = self.compared(base, [(kind, again.get(kind, own), refined) for kind, own, refined in hypotheses])
        return self._with_delays_told(stage)

    def _with_delays_told(self, stage: Stage) -> Stage:
        r"""Return a stage in which delays that look alike are told beside traces of all other effects, by all substeps.

        A force that changes within a substep h is delivered as its mean, by which the motion is as late as by

        .. math:: h^2 s^2 / 12

        beyond the delay itself: as much as a lag and a dead time of a third of a sampling time differ by. A fit that
        stopped where its shape makes up for this begins anew from the usual one, too. Where much else is missing,
        traces would only take up a part of it.
        """
        delays = [rival for rival in look_alikes(stage) if rival.kind.cause_type == "delay"]
        if len(delays) < 2:
            return stage
        finer = self.readings.finer
        own = self.refinement if finer is None else Refinement(finer.up_to(finer.runs), self.split)
        if finer is not None:
            closely = Search(own, self.progress)
            fits = [(rival.kind, closely._refined_from_usual_shape(stage.base, rival), True) for rival in delays]
            finely = {rival.kind: rival for rival in closely.compared(stage.base, fits).rivals}
            told_finely = tuple(finely.get(rival.kind, rival) for rival in stage.rivals)
            stage = in_order(dataclasses.replace(stage, rivals=told_finely))
            delays = sorted(finely.values(), key=lambda rival: rival.misfit)
        if delays[0].misfit >= SEARCH.unexplained:
            return stage
        squares, imitating = beside_traces(own, delays)
        order = np.argsort(squares.sum(axis=0))
        odds = log_odds_of_pairs(squares[:, order], imitating[order], SEARCH.beside_traces, SEARCH.imitation)
        return in_order(told(stage, [delays[place] for place in order], odds))

    def _refined_from_usual_shape(self, base: Hypothesis, rival: Rival) -> Hypothesis:
        """Return the better refinement of a rival and of it with the usual shape of its effect."""
        found = self.refinement.refine(rival.hypothesis)
        usual = {item.name: item.typical for item in rival.kind.parameters() if item.grid}
        if not usual:
            return found
        begun = rival.hypothesis.with_effect(rival.effect.within(**usual))
        return self.refinement.best_from(base, [begun], found)

    def compared(self, base: Hypothesis, hypotheses: Sequence[tuple[type[Effect], Hypothesis, bool]]) -> Stage:
        """Judge hypotheses beside a base on the held-out segments, with the weights of the base."""
        rivalling = [hypothesis for _, hypothesis, _ in hypotheses]
        bare = [(item, item.without_effect(kind)) for kind, item, refined in hypotheses if refined and item.has(kind)]
        formed = [(item, origin) for item in rivalling if (origin := base.with_form_of(item)) is not base]
        variants = [*rivalling, *(without for _, without in bare), *(item for item, _ in formed)]
        n, about = len(rivalling), [*[base] * len(rivalling), *(item for item, _ in bare), *(own for _, own in formed)]
        evidence = gather(self.readings, self.split, base, variants, keep=rivalling, about=about, common=1)
        alone, *misfits = evidence.misfits(held_out=True)[: 1 + n].tolist()
        fitted_alone, *fitted = evidence.misfits(held_out=False)[: 1 + n].tolist()
        outside = evidence.held_out
        sizes, own, shown = np.split(evidence.sizes(self.split)[1:], [n, n + len(bare)])
        own_sizes = {id(item): size for (item, _), size in zip(bare, own.tolist(), strict=True)}
        beside_form = {id(item): size for (item, _), size in zip(formed, shown.tolist(), strict=True)}
        stretches = len(np.unique(evidence.group[outside]))
        stage = Stage(
            base=base,
            misfit=alone,
            fitted=fitted_alone,
            penalty=base.named_penalty(),
            test_count=float(np.sum(evidence.counts[outside])),
            rivals=(),
            effective=min(SEARCH.effective_samples, SEARCH.of_a_stretch * stretches),
        )
        rivals = tuple(
            stage.rival(
                kind,
                item,
                misfit,
                fitted=where_fitted,
                refined=refined,
                size=beside_form.get(id(item), size),
                own_size=own_sizes.get(id(item), size) if item.has(kind) else 0.0,
            )
            for (kind, item, refined), misfit, where_fitted, size in zip(
                hypotheses, misfits, fitted, sizes.tolist(), strict=True
            )
        )
        stage = dataclasses.replace(stage, rivals=rivals)
        every = np.concatenate([evidence.by_group(held_out=outside) for outside in (True, False)])
        return ranked(stage, every[:, 1 : 1 + n])

    def review(self, final: Hypothesis, stages: Sequence[Stage]) -> tuple[Hypothesis, list[Stage]]:
        """Pit each effect against its rivals beside all others; what is superfluous goes, what is worse is replaced.

        Returns
        -------
        final : Hypothesis
        contests : list of Stage
            One for each effect of the final hypothesis: the model without it, and what rivals make of that.
        """
        origin = {rival.kind: stage for stage in reversed(stages) for rival in stage.rivals}
        # What was added has the rivals that it was chosen from, not those of a stage in which it was far behind.
        origin |= {stage.rivals[0].kind: stage for stage in stages if not stage.is_last()}
        contests = self._contests(final, origin)
        for _ in range(SEARCH.reviews):
            own = [contest.of(type(effect)) for contest, effect in zip(contests, final.effects, strict=True)]
            weak = [contest for contest, rival in zip(contests, own, strict=True) if contest.is_doubtful(rival)]
            beaten = [
                contest
                for contest, effect in zip(contests, final.effects, strict=True)
                if contest.ahead_of(type(effect)) > SEARCH.tie
            ]
            if not weak and not beaten:
                break
            final = min(weak, key=Stage.present).base if weak else beaten[0].rivals[0].hypothesis
            contests = self._contests(final, origin)
        return final, contests

    def _contests(self, final: Hypothesis, origin: Mapping[type[Effect], Stage]) -> list[Stage]:
        return [self._contest(final, type(effect), origin[type(effect)]) for effect in final.effects]

    def _contest(self, final: Hypothesis, kind: type[Effect], origin: Stage) -> Stage:
        # Beside an effect that has gone since, a fit may come further than its round did, and so may all others.
        if any(rival.kind is kind and rival.hypothesis is final for rival in origin.rivals):
            return origin
        present = {type(effect) for effect in final.effects}
        self.progress(f"doing without {kind.name}")
        others = self.refinement.refine(final.without_effect(kind))
        found = [(kind, final, True)]
        for rival in origin.rivals:
            if rival.refined and rival.kind not in present:
                tried = rival.added_to(others, origin.base)
                found.append((rival.kind, self.refinement.refine(tried), True))
        return self.contested(others, found)

    def _starts(self, base: Hypothesis, hypothesis: Hypothesis, candidate: Candidate) -> list[Hypothesis]:
        """Return where a refinement begins: also at a smaller size, where the fitted one is worse than no effect.

        And at sizes beyond, where a fit from below stops short.
        """
        effect, amplitude = candidate.members[0], candidate.kind.amplitude
        sizes = [size * getattr(effect, amplitude) for size in candidate.kind.starts]
        larger = [base.with_effect(effect.within(**{amplitude: size}), candidate.replaces) for size in sizes]
        found = [hypothesis, *larger]
        if self.refinement.better(base, [base, hypothesis]) is hypothesis:
            return found
        smaller = [one for item in candidate.sizes(SEARCH.starts) for one in item.hypotheses(base)]
        return [*found, self.refinement.better(base, smaller)]


def _linear(base: Hypothesis, candidate: Candidate, fit: Fit) -> Hypothesis:
    """Return a base with a candidate of one member as it is fitted linearly."""
    return base.with_effect(candidate.members[0], candidate.replaces).moved(fit.coefficients)
