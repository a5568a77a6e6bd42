"""Search: add the effect that explains most, refine it in closed-loop simulation, look again at what is left."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.effects import Effect
from fdbench.gap.candidates import Candidate, candidates
from fdbench.gap.evidence import Evidence, Fit, Scores, Split, gather
from fdbench.gap.hypothesis import Adjustable, Hypothesis, adjustables, calibrations
from fdbench.gap.locate import located
from fdbench.gap.replay import Replay
from fdbench.record import FloatArray

MOST_EFFECTS = 4
RESCALED = 10  # classes that are simulated again at their fitted size
REFINED = 3  # classes that are refined in closed loop before one is chosen, at most
SERIOUS = 0.4  # share of the best gain that makes a class worth refining
SMALLEST_GAIN = 0.04  # share of the excess misfit that an effect must remove
NOISE_ALONE = 1.05  # misfit below which nothing is left to explain
ITERATIONS = 6
CONVERGED = 1e-3  # relative fall of the objective below which a refinement ends
STEPS = (1.0, 0.4, 0.1)


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
    refined : bool
        Whether it was fitted in closed loop, and not only linearly.
    """

    kind: type[Effect]
    hypothesis: Hypothesis
    misfit: float
    penalty: float
    refined: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """One round: the misfit without another effect, and what each class would make of it, best first."""

    base: Hypothesis
    misfit: float
    penalty: float
    test_count: float
    rivals: tuple[Rival, ...]

    def gain(self, rival: Rival) -> float:
        """Return the share of the excess misfit, penalty included, that a rival removes."""
        excess = self.misfit - 1.0 + self.penalty / self.test_count
        removed = self.misfit - rival.misfit + (self.penalty - rival.penalty) / self.test_count
        return removed / max(excess, 1e-12)


class Search:
    """Search of one set of runs.

    Parameters
    ----------
    replay : Replay
    split : Split
    progress : callable, optional
        Told in words what is being done.
    """

    def __init__(self, replay: Replay, split: Split, progress: Callable[[str], None] | None = None) -> None:
        self.replay = replay
        self.split = split
        self.progress = progress or (lambda text: None)

    def run(self, base: Hypothesis) -> tuple[Hypothesis, list[Stage]]:
        """Return the final hypothesis and the stages that led to it."""
        self.progress("re-calibrating the values on paper")
        base = self.refine(base)
        stages: list[Stage] = []
        while len(base.effects) < MOST_EFFECTS:
            self.progress(f"looking for effect {len(base.effects) + 1}")
            stage = self.stage(base)
            stages.append(stage)
            if stage.misfit < NOISE_ALONE or not stage.rivals or stage.gain(stage.rivals[0]) < SMALLEST_GAIN:
                break
            base = stage.rivals[0].hypothesis
        return base, stages

    def stage(self, base: Hypothesis) -> Stage:
        """Rank all classes of effects as the next one."""
        every = candidates(base, located(self.replay, self.split, base))
        scores, alone, fits = self._screen(base, every)
        best = self._best_of_class(base, every, fits, scores)
        order = sorted(best, key=lambda kind: best[kind][1])
        again = [best[kind][0] for kind in order[:RESCALED]]
        scores, alone, fits = self._screen(base, again)
        ranked = self._best_of_class(base, again, fits, scores)
        order = sorted(ranked, key=lambda kind: ranked[kind][1])
        rivals = []
        most = max((self._value(alone, scores) - ranked[kind][1] for kind in order[:1]), default=0.0)
        for place, kind in enumerate(order):
            candidate, value = ranked[kind]
            hypothesis = base.with_effect(candidate.members[0], candidate.replaces)
            serious = place == 0 or (place < REFINED and self._value(alone, scores) - value > SERIOUS * most)
            if serious:
                self.progress(f"refining {kind.name}")
                hypothesis = self.refine(hypothesis)
            rivals.append(self._judged(kind, hypothesis, scores, refined=serious))
        rivals.sort(key=lambda rival: rival.misfit + rival.penalty / scores.test_count)
        return Stage(
            base=base,
            misfit=alone.misfit,
            penalty=alone.penalty,
            test_count=scores.test_count,
            rivals=tuple(rivals),
        )

    def _judged(self, kind: type[Effect], hypothesis: Hypothesis, scores: "StageScores", refined: bool) -> Rival:
        evidence = gather(self.replay, self.split, hypothesis, ())
        weight = scores.weights
        outside = evidence.held_out
        misfit = float(np.sum((weight * evidence.gaps)[outside]) / max(scores.test_count, 1.0))
        penalty = float(np.sum(np.square(hypothesis.shifts)))
        return Rival(kind=kind, hypothesis=hypothesis, misfit=misfit, penalty=penalty, refined=refined)

    def _screen(self, base: Hypothesis, every: Sequence[Candidate]) -> tuple["StageScores", Fit, list[Fit]]:
        shifted = self._shifted(base)
        columns: list[tuple[int, ...]] = []
        variants = list(shifted)
        for candidate in every:
            first = 1 + len(variants)
            variants += candidate.hypotheses(base)
            columns.append(tuple(range(first, 1 + len(variants))))
        evidence = gather(self.replay, self.split, base, variants)
        nuisances = list(range(1, 1 + len(shifted)))
        scores = StageScores(evidence, dict(zip(nuisances, base.shifts, strict=True)))
        return scores, scores.fit(nuisances), [scores.fit([*nuisances, *own]) for own in columns]

    def _best_of_class(
        self, base: Hypothesis, every: Sequence[Candidate], fits: Sequence[Fit], scores: "StageScores"
    ) -> dict[type[Effect], tuple[Candidate, float]]:
        best: dict[type[Effect], tuple[Candidate, float]] = {}
        for candidate, fit in zip(every, fits, strict=True):
            scaled = candidate.scaled(fit.coefficients[len(base.shifts) :].tolist())
            value = self._value(fit, scores)
            if scaled is not None and (candidate.kind not in best or value < best[candidate.kind][1]):
                best[candidate.kind] = (scaled, value)
        return best

    @staticmethod
    def _value(fit: Fit, scores: "StageScores") -> float:
        return fit.misfit + fit.penalty / scores.test_count

    def _shifted(self, base: Hypothesis) -> list[Hypothesis]:
        unit = np.eye(len(base.shifts))
        return [dataclasses.replace(base, shifts=tuple(np.add(base.shifts, row).tolist())) for row in unit]

    def refine(self, hypothesis: Hypothesis) -> Hypothesis:
        """Fit all numbers of a hypothesis on the training segments by guarded Gauss-Newton steps in closed loop."""
        for _ in range(ITERATIONS):
            numbers = numbers_of(hypothesis)
            values = read(hypothesis)
            unit = np.array([item.step for item in numbers])
            probes = [write(hypothesis, values + row) for row in np.diag(unit)]
            evidence = gather(self.replay, self.split, hypothesis, probes, fitted_only=True)
            priors = {1 + index: value for index, value in enumerate(hypothesis.shifts)}
            scores = StageScores(evidence, priors)
            step = scores.fit(range(1, 1 + len(numbers))).coefficients * unit
            low = np.array([item.low for item in numbers])
            high = np.array([item.high for item in numbers])
            trials = [write(hypothesis, np.clip(values + share * step, low, high)) for share in STEPS]
            judged = gather(self.replay, self.split, hypothesis, trials, fitted_only=True)
            inside = ~judged.held_out
            sums = np.diagonal(judged.products, axis1=1, axis2=2)
            cross = judged.products[:, 0, :]
            distance = (sums[:, :1] - 2.0 * cross + sums)[inside].sum(axis=0)
            distance[0] = sums[inside, 0].sum()
            penalty = np.array([np.sum(np.square(item.shifts)) for item in (hypothesis, *trials)])
            objective = distance + penalty
            best = int(np.argmin(objective))
            if best == 0:
                return hypothesis
            hypothesis = trials[best - 1]
            if objective[0] - objective[best] < CONVERGED * objective[0]:
                return hypothesis
        return hypothesis


class StageScores(Scores):
    """Scores that remember the weights of their evidence, so that refined rivals are judged by the same ones."""

    def __init__(self, evidence: Evidence, priors: dict[int, float]) -> None:
        super().__init__(evidence, priors)
        self.weights = evidence.weights


def numbers_of(hypothesis: Hypothesis) -> list[Adjustable]:
    """Return what a fit may move: the shifts of the values on paper, then the numbers of each effect."""
    found = [
        Adjustable(name=item.name, step=1.0, low=-math.inf, high=math.inf, prior=True)
        for item in calibrations(hypothesis.nominal)
    ]
    for effect in hypothesis.effects:
        found += adjustables(effect)
    return found


def read(hypothesis: Hypothesis) -> FloatArray:
    """Return the numbers of a hypothesis in the order of `numbers_of`."""
    values = list(hypothesis.shifts)
    for effect in hypothesis.effects:
        values += [getattr(effect, item.name) for item in adjustables(effect)]
    return np.array(values)


def write(hypothesis: Hypothesis, values: FloatArray) -> Hypothesis:
    """Return a hypothesis with other numbers, kept within the bounds of its effects."""
    n = len(hypothesis.shifts)
    place = n
    effects = []
    for effect in hypothesis.effects:
        changes = {}
        for item in adjustables(effect):
            changes[item.name] = float(min(max(values[place], item.low), item.high))
            place += 1
        phases = {item.name for item in type(effect).parameters() if item.phase}
        changes |= {name: math.remainder(changes[name], 2.0 * math.pi) for name in phases & changes.keys()}
        effects.append(effect.changed(**changes))
    return dataclasses.replace(hypothesis, shifts=tuple(values[:n].tolist()), effects=tuple(effects))
