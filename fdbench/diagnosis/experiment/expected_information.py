"""The forecast: what a motion is expected to show of the causes that compete.

The motion is simulated with each candidate as the truth, and the others are fitted again to the old records and the
new one together; the misfits that this leaves are read as those of the records are. Candidates are the rivals of the
verdict and, with the probability that it leaves, every other effect of the library, as large as the records may have
hidden. Probabilities before and after are read in the same way, as the verdict would read them.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.answer.experiment import ExpectedProbability, Experiment, Separation
from fdbench.diagnosis.evidence.evidence import Evidence, gather
from fdbench.diagnosis.evidence.least_squares import solved
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.trajectory import Trajectory
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.look_alikes import akin, divided
from fdbench.diagnosis.judge.probability_models import Beside, ProbabilityModels
from fdbench.diagnosis.model.candidates import candidates, middle_shapes
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.search.stage import Rival, Stage
from fdbench.diagnosis.settings import EVIDENCE, EXPERIMENT, SEARCH
from fdbench.record import FloatArray

CERTAIN = 1e-12  # smallest probability that log odds tell from none
NOTHING, OTHER = "no further effect", "any other effect"


@dataclass(frozen=True, kw_only=True)
class VerdictReader:
    """Reads a stage as the verdict does.

    Attributes
    ----------
    models : ProbabilityModels
        Predict the probabilities.
    unknown : float
        Probability of an unknown cause; where no effect was found, "no further effect" has at most the rest.
    worst : float
        See `fdbench.diagnosis.judge.probability_models.Beside`.
    settled : float
        Probability of the surest cause or of no gap, and no more than that of no unknown cause.
    """

    models: ProbabilityModels = field(default_factory=confidence.models)
    unknown: float = 0.0
    worst: float = 1.0
    settled: float = 0.0

    def probabilities(self, stage: Stage) -> dict[str, float]:
        """Return the probabilities that the verdict gives to rivals and to none; what lacks to 1 is what it doubts."""
        own = stage.probabilities()
        none = max(1.0 - sum(own), 0.0)
        best = int(np.argmax(own))
        kind, beside = stage.rivals[best].kind, Beside(worst=self.worst)
        if own[best] > none:
            same = akin(stage, kind)
            features = confidence.effect_features(stage, kind, beside, same)
            chance = self.models.effect.probability(features, [kind.name, *same])
        else:
            same = []
            features = confidence.effect_features(stage, kind, beside)
            chance = min(self.models.suspect.probability(features, [kind.name]), own[best])
        found = divided(stage, kind, same, chance)
        most = 1.0 if stage.base.effects else 1.0 - self.unknown
        return {**found, NOTHING: min(none, most, 1.0 - sum(found.values()))}

    def shortlisted(self, stage: Stage) -> Stage:
        """Return a stage with its most probable rivals alone."""
        belief = self.probabilities(stage)
        every = sorted(stage.rivals, key=lambda rival: -belief.get(rival.kind.name, 0.0))[: EXPERIMENT.most_rivals]
        likely = (rival for rival in every if belief.get(rival.kind.name, 0.0) >= EXPERIMENT.smallest_probability)
        return replace(stage, rivals=tuple(likely))


def undetected(shortlisted: Stage) -> list[Rival]:
    """Return the effects of the library beside the rivals of a stage: of typical size, with nothing explained yet."""
    known = {rival.kind.declared for rival in shortlisted.rivals}
    others = middle_shapes(item for item in candidates(shortlisted.base) if item.kind.declared not in known)
    return [
        Rival(
            kind=item.kind,
            hypothesis=item.hypotheses(shortlisted.base)[0],
            misfit=shortlisted.misfit,
            penalty=shortlisted.penalty,
            refined=False,
            size=0.0,
            own_size=0.0,
        )
        for item in others
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """What a motion is expected to show.

    Attributes
    ----------
    trajectory : Trajectory
    names : list of str
        Candidates: the rivals of a stage, other effects under one name and, last, none of them.
    now : (n_candidates,) array
        How probable it is that each is the truth.
    before : (n_candidates,) array
        What the verdict gives to each without the motion.
    after : (n_candidates, n_candidates) array
        What it gives to each column with the motion, if the row's candidate is the truth.
    """

    trajectory: Trajectory
    names: list[str]
    now: FloatArray
    before: FloatArray
    after: FloatArray

    def gain(self) -> float:
        """Return by how much the expected probability of the truth rises."""
        return float(self.now @ (np.diag(self.after) - self.before))

    def utility(self) -> float:
        """Return the gain less the price of the machine's time."""
        return self.gain() - EXPERIMENT.price_per_s * self.trajectory.duration_s

    def log_odds(self, a: int, b: int) -> float:
        """Return by which the true one of two candidates is expected to gain on the other, in nats."""
        before, after = (np.log(np.maximum(p, CERTAIN)) for p in (self.before, self.after))
        gains = [
            after[true, true] - after[true, other] - before[true] + before[other] for true, other in ((a, b), (b, a))
        ]
        return float(np.average(gains, weights=np.maximum(self.now[[a, b]], CERTAIN)))

    def experiment(self) -> Experiment:
        """Return what the diagnosis says of it."""
        pairs: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for a, b in itertools.combinations(range(len(self.names)), 2):
            if self.names[a] != self.names[b]:
                pairs.setdefault((self.names[a], self.names[b]), []).append((a, b))
        mistaken = self.now[:, None] * (self.before - self.after)
        mistaken += mistaken.T
        first = max(pairs, key=lambda pair: sum(mistaken[own] for own in pairs[pair]))
        chance = {name: self.now[[other == name for other in self.names]].sum() for name in self.names}
        likely = [pair for pair in pairs if min(map(chance.__getitem__, pair)) >= EXPERIMENT.smallest_probability]
        odds = {pair: float(np.mean([self.log_odds(*own) for own in pairs[pair]])) for pair in (first, *likely)}
        return self.trajectory.experiment(
            to_separate=first,
            expected_log_odds=odds[first],
            separates=tuple(
                Separation(effects=pair, expected_log_odds=gain)
                for pair, gain in odds.items()
                if gain >= EXPERIMENT.split_log_odds or pair == first
            ),
            expected_probability=ExpectedProbability(
                now=float(self.now @ self.before), after=float(self.now @ np.diag(self.after))
            ),
            expected_gain_per_s=self.gain() / self.trajectory.duration_s,
        )


class Forecaster:
    """Forecasts for the shortlisted rivals of one stage, and for the effects that its records may have hidden.

    Parameters
    ----------
    readings : Readings
        Of the runs of the split.
    split : Split
    stage : Stage
    reader : VerdictReader
    """

    def __init__(self, readings: Readings, split: Split, stage: Stage, reader: VerdictReader) -> None:
        known = reader.shortlisted(stage)
        missed = undetected(known)
        self.replay, self.split, self.reader = readings.replay, split, reader
        self.stage = replace(known, rivals=(*known.rivals, *missed))
        belief = reader.probabilities(stage)
        own, none = [belief.get(rival.kind.name, 0.0) for rival in known.rivals], belief[NOTHING]
        left = max(1.0 - sum(own) - none, EXPERIMENT.overlooked)
        weights = np.array([*own, *(left / len(missed) for _ in missed), none])
        self.now = weights / weights.sum()
        self.names = [*(rival.kind.name for rival in known.rivals), *(OTHER for _ in missed), NOTHING]
        shifted = stage.base.moved_in_turn()
        self.n_shifts = len(shifted)
        self.variants = [*shifted, *(rival.hypothesis for rival in self.stage.rivals)]
        evidence = gather(readings, split, stage.base, self.variants, split.fitted)
        self.known, _ = evidence.sums
        self.count = float(evidence.counts[~evidence.held_out].sum())
        self.changes = evidence.sizes(split)[self._columns]
        self.alone, now = self._fits(self.known)
        # What would have shown at its typical size is smaller, if it is there.
        missing = self._columns[len(known.rivals) :]
        shown = self._fits(self._as_gap(self.known, missing, np.ones(len(missing))))[0][:, -1]
        largest = np.sqrt((SEARCH.noise_alone - 1.0) * self.count / np.maximum(shown, 1e-12))
        self.sizes = np.concatenate((np.ones(len(known.rivals)), np.minimum(largest, 1.0)))
        # By how much the base hides of a rival, as nominal parameters stand in for it.
        self.hidden = [rival.own_size / rival.size if rival.size > 0.0 else 1.0 for rival in self.stage.rivals]
        self.before = self._read(self._judged(np.zeros(len(self.names)), self.changes * now**2, 0.0))
        visited = np.concatenate([run.reference[:, 0] for run in split.runs])
        self.most_missed_m = EXPERIMENT.followed * float(np.ptp(visited))

    @property
    def _columns(self) -> range:
        """Columns of the responses of the rivals."""
        return range(1 + self.n_shifts, 1 + len(self.variants))

    def forecasts(self, trajectories: Sequence[Trajectory]) -> list[Forecast | None]:
        """Return what each motion is expected to show, or None if the axis would not follow it."""
        every = self._recorded(trajectories)
        runs = [run for run in every if run is not None]
        if not runs:
            return [None] * len(every)
        # What changes from run to run is not known of another motion, and counts as noise.
        split = Split(
            runs=runs,
            held_out=[np.zeros(run.n_samples, dtype=np.bool_) for run in runs],
            noise_models=self.split.plain.noise_models,
        )
        evidence = gather(Readings(self.replay, runs), split, self.stage.base, self.variants)
        parts = map(evidence.of_run, range(len(runs)))
        return [
            None if run is None else self._forecast(trajectory, next(parts), split)
            for trajectory, run in zip(trajectories, every, strict=True)
        ]

    def _forecast(self, trajectory: Trajectory, evidence: Evidence, split: Split) -> Forecast:
        count = float(evidence.counts.sum())
        changes = np.maximum(self.changes, evidence.sizes(split)[self._columns])
        truths, sizes = [*self._columns, 0], np.append(self.sizes, 0.0)
        squares = evidence.products[:, truths, truths].T * (sizes**2)[:, None]
        weights = 1.0 / (1.0 + EVIDENCE.model_error * np.maximum(squares / evidence.counts - 1.0, 0.0))
        sums = np.tensordot(weights, evidence.products, 1)
        left, fitted = self._fits(self.known + self._as_gap(sums, truths, sizes))
        after = [
            self._read(self._judged(own - self.alone, changes * size**2, count))
            for own, size in zip(left, fitted, strict=True)
        ]
        return Forecast(
            trajectory=trajectory, names=self.names, now=self.now, before=self.before, after=np.array(after)
        )

    def _recorded(self, trajectories: Sequence[Trajectory]) -> list[RecordedRun | None]:
        """Return what the base of the stage would do along each motion, or None where it would not follow."""
        runs = [
            RecordedRun(
                name=item.words,
                period_s=item.period_s,
                reference=np.ascontiguousarray(item.reference),
                channels=dict.fromkeys(self.split.runs[0].channels, np.full(len(item.reference), item.reference[0, 0])),
                lap=None,
            )
            for item in trajectories
        ]
        found: list[RecordedRun | None] = []
        for run, channels in zip(runs, self.replay.on_each(runs, self.stage.base.variant), strict=True):
            missed = np.abs(channels["position_m"] - run.reference[:, 0]).max()
            follows = all(np.isfinite(each).all() for each in channels.values()) and missed <= self.most_missed_m
            found.append(replace(run, channels=channels) if follows else None)
        return found

    @staticmethod
    def _as_gap(sums: FloatArray, truths: Sequence[int], sizes: FloatArray) -> FloatArray:
        """Return sums, (n_truths, n_columns, n_columns), in which the response of each truth, resized, is the gap."""
        n = sums.shape[-1]
        columns = np.column_stack((np.asarray(truths, dtype=np.intp), np.tile(np.arange(1, n), (len(truths), 1))))
        scales = np.column_stack((sizes, np.ones((len(truths), n - 1))))
        every = np.broadcast_to(sums, (len(truths), n, n))
        chosen = every[np.arange(len(truths))[:, None, None], columns[:, :, None], columns[:, None, :]]
        return np.asarray(chosen * (scales[:, :, None] * scales[:, None, :]))

    def _fits(self, sums: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what each rival, and last the base, leaves of each gap re-calibrated, and each rival's best size."""
        shifts = np.arange(1, 1 + self.n_shifts)
        rivals = np.array([[*shifts, column] for column in self._columns], dtype=np.intp)
        (left, fitted), (alone, _) = self._fit(sums, rivals), self._fit(sums, shifts[None])
        return np.concatenate((left, alone), axis=-1), fitted[..., -1]

    def _fit(self, sums: FloatArray, columns: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return what each row of columns leaves of each gap, (..., n_rows), and its coefficients."""
        normal, right = sums[..., columns[:, :, None], columns[:, None, :]], sums[..., columns, 0]
        priors = np.arange(self.n_shifts)
        normal[..., priors, priors] += 1.0
        right[..., priors] -= self.stage.base.shifts
        fitted = solved(normal, right)
        return np.asarray(sums[..., 0, 0, None] - np.sum(right * fitted, axis=-1)), fitted

    def _read(self, stage: Stage) -> FloatArray:
        """Return the probability of each rival and, last, of none, as the verdict gives them."""
        found = self.reader.probabilities(stage)
        return np.array([*(found.get(rival.kind.name, 0.0) for rival in stage.rivals), found[NOTHING]])

    def _judged(self, added: FloatArray, sizes: FloatArray, count: float) -> Stage:
        """Return the stage with the misfits that old records and new one have together, and the sizes of its rivals."""
        whole = self.count + count

        def together(misfit: float, more: float) -> float:
            return (self.count * misfit + count + max(more, 0.0)) / whole

        rivals = [
            replace(rival, misfit=together(rival.misfit, more), size=size, own_size=size * hidden)
            for rival, more, size, hidden in zip(
                self.stage.rivals, added[:-1].tolist(), sizes.tolist(), self.hidden, strict=True
            )
        ]
        return replace(
            self.stage,
            misfit=together(self.stage.misfit, float(added[-1])),
            rivals=tuple(rivals),
            effective=min(self.stage.effective * whole / self.count, SEARCH.effective_samples),
        )
