"""How far the gap shrinks as effects are added, and which part of it each one explains."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.answer.parametric import Parametric
from fdbench.diagnosis.answer.quantity import Pair, Quantity
from fdbench.diagnosis.answer.shrinkage import Shrinkage, Step
from fdbench.diagnosis.evidence.evidence import gather
from fdbench.diagnosis.evidence.sensor_artefacts import Artefact, mean_energy
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.judge.nameless_values import nameless
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.nominal_parameter import NominalParameter
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.diagnosis.settings import JUDGE, MODEL, SEARCH
from fdbench.effects import Effect
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray
from fdbench.rotary import spoken_unit
from fdbench.statistics import drawn_counts, percentile_interval


@dataclass(frozen=True, kw_only=True, eq=False)
class Reductions:
    """Mean squared gaps on the held-out segments, in units of the floor, of the model and every subset of effects.

    Attributes
    ----------
    subsets : list of tuple of int
        Which of the effects are added; the first is empty, the last has all.
    by_segment : (n_segments, n_subsets) array
        Squared gap of each held-out segment.
    counts : (n_segments,) array
    groups : (n_segments,) array of int
    channel : (n_segments,) array of int
        Place of the segment's channel in those of the runs.
    implausible : list of float
        What speaks against the nominal parameters of each subset, see `Hypothesis.implausible`.
    """

    subsets: list[tuple[int, ...]]
    by_segment: FloatArray
    counts: FloatArray
    groups: FloatArray
    channel: NDArray[np.intp]
    implausible: list[float]

    def of_channel(self, place: int) -> FloatArray:
        """Return the mean squared gap of each subset in one channel."""
        inside = self.channel == place
        return np.asarray(self.by_segment[inside].sum(axis=0) / self.counts[inside].sum())

    def closed_in_channel(self, place: int) -> dict[tuple[int, ...], float]:
        """Return what each subset closes of the gap in one channel, between 0 and what all effects close.

        A subset is worth what the best of its own subsets is: an effect of size zero leaves the others as they are.
        """
        gaps = self.of_channel(place)
        most = max(float(gaps[0] - gaps[-1]), 0.0)
        closed: dict[tuple[int, ...], float] = {}
        for subset, gap in zip(self.subsets, gaps, strict=True):
            smaller = (closed[subset[:index] + subset[index + 1 :]] for index in range(len(subset)))
            closed[subset] = min(max(float(gaps[0] - gap), 0.0, *smaller), most)
        closed[self.subsets[-1]] = most
        return closed

    def mean(self, draws: FloatArray | None = None) -> FloatArray:
        """Return the mean squared gap of each subset, or of each bootstrap draw and subset."""
        if draws is None:
            return np.asarray(self.by_segment.sum(axis=0) / self.counts.sum())
        return np.asarray((draws @ self.by_segment) / (draws @ self.counts)[:, None])

    def loses_by(self, index: int) -> float:
        """Return how much more is left with an effect than without it, beside all others; negative where it is less.

        What values that are implausible close does not count, as in `equivalent_misfit`.
        """
        left = zip(self.mean().tolist(), self.implausible, strict=True)
        equivalent = [gap * math.exp(own / SEARCH.effective_samples) for gap, own in left]
        without = tuple(other for other in self.subsets[-1] if other != index)
        return float(equivalent[-1] - equivalent[self.subsets.index(without)])

    def may_hide(self, index: int) -> bool:
        """Return whether less is left without an effect, but by less than the noise, of which friction is a part."""
        return 0.0 <= self.loses_by(index) < 1.0

    def draws(self, seed: int = 0) -> FloatArray:
        """Return how often each segment is drawn, (n_resamples, n_segments); a stretch of time is drawn whole."""
        return drawn_counts(self.groups, JUDGE.resamples, seed)

    @cached_property
    def resampled(self) -> FloatArray:
        """Mean squared gap of each bootstrap draw and subset."""
        return self.mean(self.draws())


def explained_fraction(before: float, after: float) -> float | None:
    """Return the fraction of a mean squared gap beyond the noise that goes, both in units of the noise floor.

    None where there is too little of it to say.

    >>> explained_fraction(11.0, 3.0), explained_fraction(1.2, 1.0)
    (0.8, None)
    """
    return 1.0 - (after - 1.0) / (before - 1.0) if before > JUDGE.measurable else None


def channel_gaps(
    readings: Readings, split: Split, hypotheses: Sequence[Hypothesis], *, held_out: bool = True
) -> FloatArray:
    """Return the mean squared gap of each channel in units of the floor, (n_hypotheses, n_channels), of one part."""
    places = split.judged if held_out else split.fitted
    evidence = gather(readings, split, hypotheses[0], hypotheses[1:], places, common=1)
    out = evidence.held_out == held_out
    squares = evidence.squared_gaps()[out]
    inside = evidence.channel[out] == np.arange(len(split.noise_models))[:, None]
    return np.asarray((inside @ squares / np.maximum(inside @ evidence.counts[out], 1.0)[:, None]).T)


def reductions_of(readings: Readings, split: Split, base: Hypothesis, final: Hypothesis) -> Reductions:
    """Simulate every subset of the final effects at their final values; each is re-calibrated on its own.

    Of a proper subset re-calibration is linear around the final hypothesis and made on the training segments; the model
    without effects is ``base``, and that with all of them ``final``. The gaps are those of the held-out segments.
    """
    effects = list(final.effects)
    subsets = [c for n in range(len(effects) + 1) for c in itertools.combinations(range(len(effects)), n)]
    variants = [_subset(base, final, [effects[index] for index in subset]) for subset in subsets]
    # Both ends are fitted as they are: nothing is re-calibrated where no subset lies between them.
    shifted = final.moved_in_turn() if len(effects) > 1 else []
    evidence = gather(readings, split, variants[0], [*variants, *shifted], keep=[final, *shifted])
    outside = evidence.held_out
    judged, (train, _) = evidence.products[outside], evidence.sums
    n, m = len(subsets), len(shifted)
    responses = np.zeros((m, 1 + n + m))
    responses[:, 1 + n :] = np.eye(m)
    responses[:, n] -= 1.0
    gaps, implausible = [], []
    for place, variant in enumerate(variants):
        residual = np.zeros(1 + n + m)
        residual[0], residual[1 + place] = 1.0, -1.0
        if variant not in (base, final):
            normal = responses @ train @ responses.T + np.eye(m)
            right = responses @ train @ residual - np.asarray(variant.shifts)
            change = np.linalg.solve(normal, right)
            residual -= change @ responses
            implausible.append(variant.moved(change).implausible)
        else:
            implausible.append(variant.implausible)
        gaps.append(np.einsum("i,sij,j->s", residual, judged, residual))
    return Reductions(
        subsets=subsets,
        by_segment=np.array(gaps).T,
        counts=evidence.counts[outside],
        groups=evidence.group[outside].astype(np.float64),
        channel=evidence.channel[outside],
        implausible=implausible,
    )


def _subset(base: Hypothesis, final: Hypothesis, effects: Sequence[Effect]) -> Hypothesis:
    if not effects:
        return base
    hypothesis = final
    for effect in final.effects:
        if effect not in effects:
            hypothesis = hypothesis.without_effect(type(effect))
    return hypothesis


def shapley(values: dict[tuple[int, ...], float], n: int) -> list[float]:
    """Return the Shapley value of each of n players for a function of subsets.

    >>> shapley({(): 0.0, (0,): 1.0, (1,): 2.0, (0, 1): 4.0}, 2)
    [1.5, 2.5]
    """
    result = []
    for player in range(n):
        others = [index for index in range(n) if index != player]
        total = 0.0
        for size in range(n):
            weight = math.factorial(size) * math.factorial(n - size - 1) / math.factorial(n)
            for subset in itertools.combinations(others, size):
                joined = tuple(sorted((*subset, player)))
                total += weight * (values[joined] - values[subset])
        result.append(total)
    return result


def shrinkage(
    reductions: Reductions,
    shown_by: Mapping[int, Reductions],
    final: Hypothesis,
    seen: Sequence[Artefact],
    split: Split,
    judged_on: str,
    raw: float,
) -> Shrinkage:
    """Return how the held-out mean squared gap falls as the effects are added one by one, with intervals.

    The step of an effect is that of the reductions which it is ``shown_by``.
    """
    means, draws = reductions.mean(), reductions.resampled
    by_channel = _by_channel(reductions, split)
    steps = [
        held_step(artefact, float(means[0]), by_channel, split.noise_models)
        for artefact in seen
        if artefact.interpolated
    ]
    of_readings = len(steps)
    for count, effect in enumerate(final.effects):
        own = shown_by.get(count, reductions)
        steps.append(replace(_step(effect.name, count, own, split), beside_changes=own is not reductions))
    total = 1.0 - draws[:, -1] / draws[:, 0]
    return Shrinkage(
        judged_on=judged_on,
        on_paper=raw,
        recalibrated=steps[0].before if of_readings else float(means[0]),
        left=float(means[-1]),
        steps=tuple(steps),
        total=1.0 - float(means[-1] / means[0]),
        ci95=_interval(total),
        reducible_left=max(0.0, 1.0 - 1.0 / max(float(means[-1]), 1e-12)),
        explained_fraction=explained_fraction(raw, float(means[-1])),
    )


def _step(name: str, index: int, reductions: Reductions, split: Split) -> Step:
    """Return the step from the effects before one to those with it."""
    own, draws = reductions.mean(), reductions.resampled
    before, after = (reductions.subsets.index(tuple(range(count))) for count in (index, index + 1))
    return Step(
        added=name,
        before=float(own[before]),
        after=float(own[after]),
        reduction=1.0 - float(own[after] / own[before]),
        ci95=_interval(1.0 - draws[:, after] / draws[:, before]),
        channels={name: 1.0 - float(of[after] / of[before]) for name, of in _by_channel(reductions, split).items()},
        explained_fraction=explained_fraction(float(own[before]), float(own[after])),
    )


def _by_channel(reductions: Reductions, split: Split) -> dict[str, FloatArray]:
    return {name: reductions.of_channel(index) for index, name in enumerate(split.noise_models)}


def held_step(
    artefact: Artefact, after: float, by_channel: Mapping[str, FloatArray], noise_models: Mapping[str, NoiseModel]
) -> Step:
    """Return the step from the samples as they were logged to those that are compared."""
    energy = mean_energy(artefact, noise_models)
    own = {name: artefact.energy[name] / floor.rms**2 for name, floor in noise_models.items()}
    low, high = (energy * bound / artefact.value for bound in (artefact.low, artefact.high))
    return Step(
        added=artefact.kind.name,
        before=after + energy,
        after=after,
        reduction=energy / (after + energy),
        ci95=(low / (after + low), high / (after + high)),
        channels={name: own[name] / (own[name] + float(means[0])) for name, means in by_channel.items()},
        explained_fraction=explained_fraction(after + energy, after),
    )


def parametric(
    raw: float,
    reductions: Reductions,
    calibrated: Hypothesis,
    final: Hypothesis,
    set_anew: Mapping[str, float],
) -> Parametric:
    """Return what re-calibration alone does: the parametric gap, and how far each nominal parameter moved."""
    structural = float(reductions.mean()[0])
    items, drive = nominal_parameters(calibrated.nominal), calibrated.nominal.drive
    names = [item.name for item in items]
    return Parametric(
        closed_by_recalibration=max(0.0, 1.0 - structural / raw),
        moved_in_standard_deviations=dict(zip(names, calibrated.shifts, strict=True)),
        moved_beside_effects=dict(zip(names, final.shifts, strict=True)),
        changes=_changes(zip(items, calibrated.shifts, strict=True), drive),
        values=dict(_far_values(calibrated)),
        nameless=_changes(nameless(final), drive),
        set_anew={name: Quantity(value=share, ci95=None, unit="") for name, share in set_anew.items()},
    )


def _changes(moved: Iterable[tuple[NominalParameter, float]], drive: FeedDrive) -> dict[str, Quantity]:
    return {
        item.name: Quantity(value=shift * item.size(drive), ci95=None, unit=spoken_unit(item.unit_on(drive)))
        for item, shift in moved
    }


def _far_values(calibrated: Hypothesis) -> Iterator[tuple[str, Quantity]]:
    """Yield the name of each cause that changes nominal parameters which moved far, and by how much in all."""
    places: dict[str, list[int]] = {}
    scale = nominal_parameters(calibrated.nominal)
    for place, item in enumerate(scale):
        if (name := item.cause(calibrated.nominal)) and not item.nuisance:
            places.setdefault(name, []).append(place)
    for name, own in places.items():
        change, deviation = calibrated.change(own)
        if abs(change) > MODEL.far_fetched * deviation:
            unit = spoken_unit(scale[own[0]].unit_on(calibrated.nominal.drive))
            yield name, Quantity(value=change, ci95=None, unit=unit)


def _interval(resampled: FloatArray) -> Pair:
    low, high = percentile_interval(resampled)
    return float(low), float(high)
