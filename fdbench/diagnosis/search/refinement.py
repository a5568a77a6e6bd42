"""Refinement: fit the numbers of a hypothesis in closed loop by damped Gauss-Newton steps."""

import dataclasses
import math
from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evidence.evidence import Evidence, fitted_part, gather
from fdbench.diagnosis.evidence.least_squares import Fit, Scores
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.friction_parameters import FrictionForm, KnownAmplitude
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.parameter_vector import adjustables_of, parameter_vector, with_parameters
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.settings import SEARCH
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Tangent:
    """Hypotheses with one number moved by a step each, and those about which it was moved.

    Attributes
    ----------
    about, moved : list of Hypothesis
        One for each nominal parameter, in their order, and for each number of an effect.
    scale : float
        Of the steps.
    """

    about: list[Hypothesis]
    moved: list[Hypothesis]
    scale: float = 1.0

    @classmethod
    def at(cls, hypothesis: Hypothesis, scale: float = 1.0) -> "Tangent":
        """Return the tangent about one hypothesis."""
        values = parameter_vector(hypothesis)
        steps = scale * np.diag([item.step for item in adjustables_of(hypothesis)])
        moved = [with_parameters(hypothesis, values + row) for row in steps]
        return cls(about=[hypothesis] * len(moved), moved=moved, scale=scale)

    def of(self, places: Sequence[int]) -> "Tangent":
        """Return that of some of the numbers."""
        about, moved = ([items[place] for place in places] for items in (self.about, self.moved))
        return Tangent(about=about, moved=moved, scale=self.scale)

    def followed_by(self, other: "Tangent") -> "Tangent":
        """Return that of these numbers and then of others."""
        return Tangent(about=[*self.about, *other.about], moved=[*self.moved, *other.moved], scale=self.scale)

    @property
    def is_fine(self) -> bool:
        """Whether the numbers are moved by less than their steps."""
        return self.scale < 1.0

    def is_about(self, hypothesis: Hypothesis) -> bool:
        """Whether all numbers are moved about this very hypothesis."""
        return all(item is hypothesis for item in self.about)

    def distance(self, hypothesis: Hypothesis) -> float:
        """Return how far a hypothesis is from those about which numbers are moved, in standard deviations of one."""
        if any(hypothesis.replaced != item.replaced for item in self.about):
            return math.inf
        return max(map(hypothesis.apart_from, self.about), default=0.0)


class Refinement:
    """Fits on one set of runs.

    Parameters
    ----------
    readings : Readings
        Of the runs of the split.
    split : Split
    nominal : sequence of Tangent, optional
        Those of the nominal parameters of an earlier refinement on the same runs.

    Attributes
    ----------
    nominal : list of Tangent
        Of the nominal parameters; what was made last comes last.
    """

    def __init__(self, readings: Readings, split: Split, nominal: Sequence[Tangent] = ()) -> None:
        self.nominal = [*nominal]
        self.look_at(readings, split)

    def look_at(self, readings: Readings, split: Split) -> None:
        """Fit to other readings, or to the same ones split or weighted otherwise, from now on."""
        self.readings, self.split = readings, split
        self._fitted_readings, self._fitted_split = fitted_part(readings, split)
        self._refined: dict[Hashable, Hypothesis] = {}

    def look_closely(self, hypothesis: Hypothesis) -> Hypothesis:
        """Return a hypothesis that effects were added to fitted closely, to readings that few substeps are right for.

        What a fit that is stuck leaves would be explained by effects that are not there. Other readings are taken only
        beside a process force, such as that of a tooth that enters a cut: it comes at once. Where a friction or a play
        is chaotic, no number of substeps reads what another one does.
        """
        if any(item.disturbance for item in hypothesis.effects):
            readings = self.readings.about(hypothesis, self.split.noise_models)
            if readings is not self.readings:
                self.look_at(readings, self.split)
        return self.refine(hypothesis, closely=True) if hypothesis.effects else hypothesis

    def calibrate(self, given: Hypothesis, *, narrow: bool = False) -> Hypothesis:
        """Fit the nominal parameters: first those that a data sheet has, then the form of friction beside them.

        A form that moves from the start can stand in for a friction that is not yet of the right size. What moved far
        on one side of a screw is tried on the other. From a ``narrow`` prior, which has a second valley far off where a
        value has changed, no step leads there: what records say with hardly any prior is a start, too. So it is of the
        sizes of known effects that may have grown many times, such as a play, as friction does not.
        """
        scale = nominal_parameters(given.nominal)
        form = [item.name for item in scale if isinstance(item, FrictionForm)]
        found = self.refine(self.refine(given, fixed=form)) if form else self.refine(given)
        others = found.on_one_side()
        if any(isinstance(item, KnownAmplitude) and not item.is_friction for item in scale):
            others += [self.refine(found, tempered=False), *found.with_grown()]
        if narrow:
            far = self.refine(given, fixed=form, tempered=False)
            others += [far, *far.on_one_side()]
        return self.best_from(found, others, found)

    def best_from(
        self, base: Hypothesis, starts: Sequence[Hypothesis], best: Hypothesis, ahead: Hypothesis | None = None
    ) -> Hypothesis:
        """Return the best of a hypothesis and of refinements from several starts, with the weights of a base.

        A refinement that falls hopelessly behind the best so far, or what is ``ahead`` of all, is given up.
        """
        for start in starts:
            leader = best if ahead is None else self.better(base, [ahead, best])
            best = self.better(base, [best, self.refine(start, ahead=leader)])
        return best

    def refine(
        self,
        given: Hypothesis,
        fixed: Collection[str] = (),
        *,
        tempered: bool = True,
        ahead: Hypothesis | None = None,
        away_from: Hypothesis | None = None,
        closely: bool = False,
    ) -> Hypothesis:
        """Fit all numbers of a hypothesis but fixed ones on the training segments in closed loop.

        What is minimised are the weighted squares and, `prior_weight` times, the prior penalty, by Gauss-Newton steps.
        Where one does not keep what it promises, steps of which the normal matrix has its diagonal raised by several
        factors (Levenberg 1944, Marquardt 1963) are simulated together, and the best is taken. The responses to the
        numbers serve for further steps as long as steps keep what they promise (chords: Shamanskii 1967), and are
        simulated anew otherwise: to numbers moved by less where those had told too small a slope. What is to
        predict best, and is compared with nothing, is fitted by all samples as they are, not ``tempered``. From where a
        fit has begun before it ends where it did. One of which ``SEARCH.hopeless`` times what a step promises would not
        come near what a hypothesis ``ahead`` has is given up. So is one whose nominal parameters are nearer to those of
        what it is to keep ``away_from`` than to those on paper. Where no step comes near what it promises, a fit ends,
        unless it is to look ``closely``: then responses are simulated to numbers moved by less first.
        """
        begun = given.key, frozenset(fixed), tempered, *(item and item.key for item in (ahead, away_from)), closely
        if begun not in self._refined:
            self._refined[begun] = self._descended(given, fixed, tempered, ahead, away_from, closely)
        return self._refined[begun]

    def _descended(
        self,
        given: Hypothesis,
        fixed: Collection[str],
        tempered: bool,
        ahead: Hypothesis | None,
        away_from: Hypothesis | None,
        closely: bool,
    ) -> Hypothesis:
        hypothesis, tangent, kept = given, self.tangent(given), True
        moving = [place for place, item in enumerate(adjustables_of(given)) if item.name not in fixed]
        for place in range(SEARCH.steps):
            probed = self._gather(hypothesis, tangent.of(moving), self.split.fitted, kept=len(moving))
            inside = ~probed.held_out
            alone = float(probed.squares(held_out=False)[0])
            weight = prior_weight(alone) if tempered else 1.0
            excess = alone - float((probed.weights * probed.counts)[inside].sum())
            enough = max(SEARCH.converged * excess, SEARCH.unnoticed * alone, SEARCH.smallest_fall)
            steps, fresh = _Steps(hypothesis, probed, moving, weight, tangent.scale), tangent.is_about(hypothesis)
            if steps.promise < enough or (ahead is not None and self._is_hopeless(steps, ahead)):
                break
            hypothesis, fell = self._stepped(steps, given, fresh=fresh, likely=kept, slow=place >= SEARCH.quick)
            stuck = fresh and fell < enough
            ends = tangent.is_fine or not closely
            if (stuck and ends) or (away_from and hypothesis.is_nearer_to(away_from)):
                break
            kept = fell >= SEARCH.kept_promise * steps.promise
            if not kept or fell > steps.promise / SEARCH.kept_promise:
                own = self._own(tangent, given)
                self._forget(own, given, hypothesis)
                if tangent.is_fine or stuck or (fresh and fell > steps.promise):
                    tangent = Tangent.at(hypothesis, SEARCH.fine)
                else:
                    tangent = self.tangent(hypothesis, anew=own.is_about(steps.hypothesis))
        self._forget(self._own(tangent, given), given, hypothesis)
        return hypothesis

    def _stepped(
        self, steps: "_Steps", given: Hypothesis, *, fresh: bool, likely: bool, slow: bool
    ) -> tuple[Hypothesis, float]:
        """Return where the best of a step and of damped ones ends, and how far the objective falls to there.

        Readings of the others are forgotten, but those of what a fit was ``given``. Steps are damped no further than
        to any fall where their responses are not ``fresh``, and better ones can be simulated. Unless an undamped one is
        ``likely`` to do, the first dampings are simulated beside it, which fills the lanes of a block. Where a ``slow``
        fit creeps along a valley, the best step is tried several times as long, too.
        """
        hypothesis, fell = steps.hypothesis, 0.0
        tried = [steps.hypothesis]
        rounds = [(0.0,), SEARCH.dampings] if likely else [(0.0, *SEARCH.dampings)]
        for dampings in (*rounds, SEARCH.further_dampings):
            trials = steps.damped(dampings)
            hypothesis, fell = max((hypothesis, fell), self._deepest(steps, trials), key=lambda end: end[1])
            tried += trials
            is_damped = dampings != (0.0,)
            if fell >= SEARCH.kept_promise * steps.promise or (is_damped and (fell > 0.0 or not fresh)):
                break
        if slow and 0.0 < fell < SEARCH.creeping * steps.before:
            trials = steps.longer(hypothesis)
            hypothesis, fell = max((hypothesis, fell), self._deepest(steps, trials), key=lambda end: end[1])
            tried += trials
        self._fitted_readings.forget([item for item in tried if item not in (given, hypothesis)])
        return hypothesis, fell

    def _deepest(self, steps: "_Steps", trials: Sequence[Hypothesis]) -> tuple[Hypothesis, float]:
        """Return the trial at which the objective is lowest, and how far it falls to there."""
        after = _objectives(self._squares(steps.hypothesis, trials)[1:], trials, steps.weight)
        best = int(np.argmin(after))
        return trials[best], steps.before - after[best]

    def _is_hopeless(self, steps: "_Steps", ahead: Hypothesis) -> bool:
        """Return whether several times what is promised would still be far behind a hypothesis, in log evidence."""
        most = SEARCH.hopeless * steps.promise + 2.0 * SEARCH.far_behind * steps.weight
        return most < steps.before and self._deepest(steps, [ahead])[1] > most

    def _own(self, tangent: Tangent, given: Hypothesis) -> Tangent:
        """Return the part of a tangent that serves no other fit."""
        if tangent.is_fine:
            return tangent
        return tangent.of(range(len(given.shifts), len(tangent.moved)))

    def promise(self, hypothesis: Hypothesis) -> tuple[Evidence, float, Hypothesis]:
        """Return the evidence about a hypothesis, the weighted squares that one step promises, and where that ends."""
        tangent = Tangent.at(hypothesis)
        probed = self._gather(hypothesis, tangent, self.split.fitted)
        weight = prior_weight(float(probed.squares(held_out=False)[0]))
        steps = _Steps(hypothesis, probed, range(len(tangent.moved)), weight)
        return probed, steps.squares, steps.undamped

    def tangent(self, hypothesis: Hypothesis, *, anew: bool = False) -> Tangent:
        """Return that of a hypothesis: its effects' about itself, its nominal parameters' perhaps about one near it."""
        here, n = Tangent.at(hypothesis), len(hypothesis.shifts)
        nearest = min(self.nominal, key=lambda tangent: tangent.distance(hypothesis), default=None)
        if anew or nearest is None or nearest.distance(hypothesis) > SEARCH.near:
            while self.nominal and len(self.nominal) >= self._most_tangents(n):
                self._forget(self.nominal.pop(0), hypothesis)
            nearest = here.of(range(n))
            self.nominal.append(nearest)
        return nearest.followed_by(here.of(range(n, len(here.moved))))

    def _most_tangents(self, n_numbers: int) -> int:
        """Return how many tangents of the nominal parameters there is room for."""
        n_samples = sum(self._fitted_readings.runs[place].n_samples for place in self.split.fitted)
        return min(SEARCH.tangents, SEARCH.tangents_held // max(n_numbers * n_samples, 1))

    def responses(
        self,
        base: Hypothesis,
        others: Sequence[Hypothesis] = (),
        places: Sequence[int] | None = None,
        *,
        effects: bool = False,
        neighbours: int | None = None,
        roughly: bool = False,
    ) -> Evidence:
        """Return the responses to a step of each nominal parameter, perhaps of each number of effects, and to others.

        Parameters
        ----------
        base : Hypothesis
        others : sequence of Hypothesis
            Their columns follow.
        places : sequence of int, optional
            Of runs of which something is fitted, and what is fitted of them alone; without, all runs, whole.
        effects : bool
            Whether numbers of effects are moved, too.
        neighbours : int, optional
            How many of the others in a row are fitted together; without, all.
        roughly : bool
            Whether one substep is enough for those to the others.
        """
        tangent = self.tangent(base)
        known = tangent if effects else tangent.of(range(len(base.shifts)))
        every = known.followed_by(Tangent(about=[base] * len(others), moved=[*others]))
        common = None if neighbours is None else 1 + len(known.moved)
        kept = len(base.shifts)
        if roughly and others:
            # Responses to nominal parameters serve on, and are simulated by all substeps first.
            self._gather(base, known, places, kept=kept)
        return self._gather(base, every, places, common, neighbours or 1, kept=kept, roughly=roughly and bool(others))

    def better(self, base: Hypothesis, rivals: Sequence[Hypothesis]) -> Hypothesis:
        """Return which of several has the lowest objective, with the weights of a base; one alone is not simulated."""
        if len(rivals) == 1:
            return rivals[0]
        alone, *squares = self._squares(base, rivals)
        return rivals[int(np.argmin(_objectives(squares, rivals, prior_weight(alone))))]

    def predicting_best(self, weighed: Hypothesis, calibrated: Hypothesis, held: Collection[str] = ()) -> Hypothesis:
        """Return the best fit that is not tempered: from a hypothesis, and from where its base came to by such a fit.

        That may be another valley, and a deeper one; from near it no other fit is made. Nor beside an effect that
        scales every value, for from all of these moved to none there is one valley, and what differs from run to run
        would decide where in it. Values that are ``held`` stay.
        """
        found = self.refine(weighed, held, tempered=False)
        scaling = any(effect.scales_every_value for effect in weighed.effects)
        if held or scaling or weighed.apart_from(calibrated) <= SEARCH.near:
            return found
        other = dataclasses.replace(weighed, shifts=calibrated.shifts)
        fits = [found, self.refine(other, tempered=False, ahead=found)]
        squares = self._squares(weighed, fits)[1:]
        return fits[int(np.argmin(_objectives(squares, fits, 1.0)))]

    def is_closer(self, base: Hypothesis, rival: Hypothesis, other: Hypothesis) -> bool:
        """Return whether a rival leaves less than another one by a share that matters of what a base leaves."""
        alone, own, others = self._squares(base, [rival, other])
        return others - own > SEARCH.smallest_gain * alone

    def _squares(self, base: Hypothesis, trials: Sequence[Hypothesis]) -> list[float]:
        """Return the weighted squares of a base and of trials, with the weights of the base."""
        about = Tangent(about=[base] * len(trials), moved=[*trials])
        evidence = self._gather(base, about, self.split.fitted, common=1, keep=trials)
        squares: list[float] = evidence.squares(held_out=False).tolist()
        return squares

    def _gather(
        self,
        base: Hypothesis,
        tangent: Tangent,
        places: Sequence[int] | None,
        common: int | None = None,
        neighbours: int = 1,
        *,
        keep: Sequence[Hypothesis] = (),
        kept: int = 0,
        roughly: bool = False,
    ) -> Evidence:
        """Gather the responses of what is fitted of some runs; of all runs, whole, where none are given."""
        whole = places is None
        readings, split = (self.readings, self.split) if whole else (self._fitted_readings, self._fitted_split)
        readings = readings.roughly(base) if roughly else readings
        return gather(readings, split, base, tangent.moved, places, keep, tangent.about, common, neighbours, kept)

    def _forget(self, tangent: Tangent, *but: Hypothesis) -> None:
        gone = [item for item in (*tangent.about, *tangent.moved) if all(item is not other for other in but)]
        for readings in (self.readings, self._fitted_readings):
            readings.forget(gone)


class _Steps:
    """Steps of a hypothesis that its probed responses suggest.

    Parameters
    ----------
    hypothesis : Hypothesis
    probed : Evidence
        The responses to the numbers that move, in units of their steps.
    moving : sequence of int
        Their places among all numbers.
    weight : float
        Of the prior penalty.
    """

    def __init__(
        self, hypothesis: Hypothesis, probed: Evidence, moving: Sequence[int], weight: float, scale: float = 1.0
    ) -> None:
        self.hypothesis, self.moving, self.weight, self.scale = hypothesis, list(moving), weight, scale
        self.numbers, self.values = adjustables_of(hypothesis), parameter_vector(hypothesis)
        self.sizes = scale * np.array([item.step for item in self.numbers])
        self._known = [(column, place) for column, place in enumerate(moving, 1) if self.numbers[place].prior]
        limits = np.array([(item.low, item.high) for item in self.numbers]) - self.values[:, None]
        room = (limits / np.where(self.sizes > 0.0, self.sizes, math.inf)[:, None]).tolist()
        room[: len(hypothesis.shifts)] = [(low / scale, high / scale) for low, high in hypothesis.room()]
        self.scores = Scores(probed, {}, {column: room[place] for column, place in enumerate(moving, 1)})
        near = self._fitted(hypothesis.priors(weight))
        self.undamped, self.squares = self._to(near.coefficients), near.squares
        self._look_far()
        self.before = float(probed.squares(held_out=False)[0]) + weight * hypothesis.prior_penalty()
        self.promise = self.before - self.squares - weight * self.undamped.prior_penalty()

    def _fitted(self, priors: Sequence[tuple[float, float]]) -> Fit:
        """Return the step in which the squares of shifts have the weights of these priors."""
        stands = self.hypothesis.shifts
        self.scores.priors = {
            column: (stands[place] / self.scale, priors[place][1] * self.scale**2) for column, place in self._known
        }
        return self.scores.fit(self._columns)

    def _look_far(self) -> None:
        """Step to where priors weigh little, if the objective is lower there.

        A quadratic in place of a Student's t far overrates what a large shift costs, and a fit would creep towards it.
        Weights follow the shifts (iteratively reweighted least squares: Holland, Welsch 1977).
        """
        priors, far = self.scores.priors, self._fitted(self.hypothesis.priors(1.0))
        if self.squares - far.squares > 2.0 * SEARCH.far_behind * self.weight:
            for _ in range(SEARCH.reweighings):
                far = self._fitted(self._to(far.coefficients).priors(self.weight))
            there = self._to(far.coefficients)
            gained = self.weight * (self.undamped.prior_penalty() - there.prior_penalty())
            if far.squares < self.squares + gained:
                self.undamped, self.squares = there, far.squares
                return
        self.scores.priors = priors

    def damped(self, dampings: Sequence[float]) -> list[Hypothesis]:
        """Return the hypothesis after the step of each damping, of which 0 is none."""
        return [
            self._to(self.scores.fit(self._columns, damping).coefficients) if damping else self.undamped
            for damping in dampings
        ]

    def longer(self, stepped: Hypothesis) -> list[Hypothesis]:
        """Return the hypothesis after steps in the direction of one, several times as long."""
        step = parameter_vector(stepped) - self.values
        return [with_parameters(self.hypothesis, self.values + factor * step) for factor in SEARCH.lengths]

    @property
    def _columns(self) -> range:
        return range(1, 1 + len(self.moving))

    def _to(self, coefficients: FloatArray) -> Hypothesis:
        step = np.zeros(len(self.numbers))
        step[self.moving] = coefficients
        return with_parameters(self.hypothesis, self.values + step * self.sizes)


def _objectives(squares: Sequence[float], trials: Sequence[Hypothesis], weight: float) -> list[float]:
    return [own + weight * trial.prior_penalty() for own, trial in zip(squares, trials, strict=True)]


def prior_weight(squares: float) -> float:
    r"""Return how much a prior penalty p counts beside weighted squares S, so that both fit as they are judged.

    .. math:: n \ln S + p, \qquad \mathrm{d}S + \frac{S}{n}\, \mathrm{d}p = 0

    with the effective samples n of `fdbench.diagnosis.search.stage.Stage`: at least 1, where there are fewer samples.
    """
    return max(1.0, squares / SEARCH.effective_samples)
