"""The verdict: causes with probabilities, shares and intervals, and the chances of an unknown cause and of no gap."""

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fdbench.diagnosis.answer import READING, VALUE, Cause, ForceBalances, Pair, Quantity, Rival, Suspect
from fdbench.diagnosis.evidence.evidence import gather
from fdbench.diagnosis.evidence.sensor_artefacts import Artefact, energies
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.force_balance_check import force_balances_removed
from fdbench.diagnosis.judge.probability_models import Features, ProbabilityModels
from fdbench.diagnosis.judge.reduction import Reductions, channel_gaps, shapley
from fdbench.diagnosis.model.candidates import candidates, middle_shapes
from fdbench.diagnosis.model.hypothesis import Hypothesis, adjustables, nominal_parameters
from fdbench.diagnosis.search.search import SMALLEST_GAIN, Search, Stage, adjustables_of
from fdbench.effects import Effect
from fdbench.record import FloatArray

ALIKE = 0.9  # a rival that removes this share of what the best removes cannot be told apart
BEYOND_DOUBT = 1.5  # standard deviations of a value on paper below which it is no cause
NAMED = 0.5  # probability above which causes stand first
FEWEST = 0.01  # probability of a rival that is worth mentioning
HIDDEN = 0.05  # of its typical size: standard deviation of an effect that is not named
OR = " or "  # between the names of one claim
LEVEL = 0.9  # probability with which the cause is one of a set
ENOUGH = 0.5  # share of the gap that everything named must explain to be believed
UNREPEATED = 10.0  # floors that the mean square of one run may come to by chance, where three repeats gave the floor


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """What the search came to, from which the verdict is drawn.

    Attributes
    ----------
    search : Search
    paper, base, final : Hypothesis
        The model as given, what the search began with, and with effects.
    stages, contests : sequences of Stage
        Of the search, and for each final effect the model without it beside its rivals.
    reductions : Reductions
    marks : sequence of Artefact
        Effects that are seen in the readings themselves.
    """

    search: Search
    paper: Hypothesis
    base: Hypothesis
    final: Hypothesis
    stages: Sequence[Stage]
    contests: Sequence[Stage]
    reductions: Reductions
    marks: Sequence[Artefact]


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """Part of the answer, and the signs that its probabilities were drawn from.

    Attributes
    ----------
    causes : tuple of Cause
    suspects : tuple of Suspect
    nearest : Rival or None
    unknown_probability, no_gap_probability : float
    features : mapping
        By the kind of claim (see `fdbench.diagnosis.judge.probability_models.ProbabilityModels`) and the name
        of what is claimed; names of effects that cannot be told apart are joined by " or ".
    """

    causes: tuple[Cause, ...]
    suspects: tuple[Suspect, ...]
    nearest: Rival | None
    unknown_probability: float
    no_gap_probability: float
    features: Mapping[str, Mapping[str, Features]] = field(default_factory=dict)


class Shares:
    """Shares of a gap; a channel counts by the root mean square of its gap beyond the noise.

    Parameters
    ----------
    gaps : (n_channels,) array
        Mean squared held-out gap in units of the floor.
    interpolated : (n_channels,) array
        What was taken out of the readings beforehand.
    """

    def __init__(self, gaps: FloatArray, interpolated: FloatArray) -> None:
        self.total = gaps + interpolated
        weights = np.sqrt(np.maximum(self.total - 1.0, 0.0))
        self.weights = weights / weights.sum() if weights.sum() > 0.0 else np.full(len(weights), 1.0 / len(weights))

    def of(self, closed: FloatArray) -> float:
        """Return the share of mean squares that are closed in the channels, between 0 and 1."""
        return float(np.clip(np.sum(self.weights * self.by_channel(closed)), 0.0, 1.0))

    def by_channel(self, closed: FloatArray) -> FloatArray:
        """Return the share in each channel."""
        return np.asarray(np.clip(closed / np.maximum(self.total, 1e-12), 0.0, 1.0))


def verdict(found: Findings, models: ProbabilityModels) -> Verdict:
    """Return the verdict; see the contract for the answer.

    Shares of effects are of the gap that re-calibration leaves, those of values on paper of the gap on paper.
    """
    search, reductions = found.search, found.reductions
    plain = search.split.plain
    noise_models = plain.noise_models
    on_paper = channel_gaps(search.replay, plain, found.paper)
    interpolated = sum(
        (energies(mark, noise_models) for mark in found.marks if mark.interpolated), np.zeros(len(noise_models))
    )
    recalibrated = np.array([reductions.of_channel(place)[0] for place in range(len(noise_models))])
    shares = Shares(recalibrated, interpolated)
    repaired = np.array([reductions.of_channel(place)[-1] for place in range(len(noise_models))])
    belief = plausibility_discount(Shares(on_paper, interpolated).of(np.maximum(repaired - UNREPEATED, 0.0)))
    beside_twins = found.final.nominal.beside_twins
    closed = [reductions.of_channel(place)[0] - reductions.of_channel(place) for place in range(len(noise_models))]
    by_subset = {
        subset: np.array([gains[index] for gains in closed]) for index, subset in enumerate(reductions.subsets)
    }
    everything = tuple(range(len(found.final.effects)))
    parts = [
        shapley({subset: own[c] for subset, own in by_subset.items()}, len(everything))
        for c in range(len(noise_models))
    ]
    bounds = intervals(search, found.final)
    causes: list[Cause] = []
    effect_features_of: dict[str, Features] = {}
    for index, (effect, contest) in enumerate(zip(found.final.effects, found.contests, strict=True)):
        alone = tuple(other for other in everything if other != index)
        same = indistinguishable(contest, type(effect))
        features = confidence.effect_features(contest, type(effect), same)
        told = force_balances_removed(search.replay, search.split, contest)
        effect_features_of[OR.join((effect.name, *same))] = features
        odds = divided(contest, type(effect), same, models.effect.probability(features))
        chances = {name: belief * p for name, p in odds.items()}
        own = np.maximum([part[index] for part in parts], 0.0)
        causes.append(
            Cause(
                effect=effect.name,
                probability=chances[effect.name],
                share=shares.of(own),
                share_of_channel=dict(zip(noise_models, shares.by_channel(own).tolist(), strict=True)),
                unique_share=shares.of(np.maximum(by_subset[everything] - by_subset[alone], 0.0)),
                parameters=parameters(effect, bounds[index]),
                indistinguishable_from=tuple(beside_twins([effect.name, *same])[1:]),
                alternatives={name: p for name, p in chances.items() if name != effect.name},
                one_of=tuple(beside_twins(one_of(chances))),
                instead=instead(contest, type(effect), same),
                force_balances=force_balances(told, type(effect), same),
                typical=tuple(not_fitted(effect)),
                at_bound=tuple(at_bound(effect)),
            )
        )
    corrected = Shares(on_paper, interpolated).of(np.maximum(on_paper - recalibrated, 0.0))
    values, value_features_of, moved = deviating_parameters(search, found.final, corrected, models)
    causes += [dataclasses.replace(value, probability=belief * value.probability) for value in values]
    causes += [marked(mark, shares.of(energies(mark, noise_models))) for mark in found.marks]
    causes.sort(key=lambda cause: (cause.probability <= NAMED, -cause.share))
    suspects, suspect_features_of = suspected(found, models, belief)
    before = search.compared(found.base, [(Effect, found.final, True)])
    left = gather(search.replay, search.split, found.final, ())
    unknown = confidence.unknown_features(before.rivals[0].misfit, left.worst())
    rivals = [rival.size for stage in (*found.contests, *found.stages[-1:]) for rival in stage.rivals[:1]]
    none = confidence.no_gap_features(before.misfit, moved, max(rivals, default=0.0))
    surest = max((cause.probability for cause in causes), default=0.0)
    claims = {"effect": effect_features_of, "suspect": suspect_features_of, "value": value_features_of}
    return Verdict(
        causes=tuple(causes),
        suspects=tuple(suspects),
        nearest=nearest(found),
        unknown_probability=max(models.unknown.probability(unknown), 1.0 - belief),
        no_gap_probability=min(models.none.probability(none), 1.0 - surest),
        features={**claims, "unknown": {"unknown": unknown}, "none": {"none": none}},
    )


def plausibility_discount(left: float) -> float:
    """Return by how much to believe what is named, from the share of the gap on paper that it surely leaves.

    It is believed in full from where it explains half of the gap: little of a large gap may be a value or an effect
    that stands in for a cause that the library lacks.

    >>> credit(0.3), credit(0.75)
    (1.0, 0.5)
    """
    return min(1.0, (1.0 - left) / ENOUGH)


def marked(mark: Artefact, share: float) -> Cause:
    """Return the cause that is seen in the readings themselves."""
    amplitude = mark.kind.amplitude
    unit = next(item.unit for item in mark.kind.parameters() if item.name == amplitude)
    return Cause(
        effect=mark.kind.name,
        kind=READING,
        probability=mark.probability,
        share=share,
        unique_share=share,
        parameters={amplitude: Quantity(value=mark.value, ci95=(mark.low, mark.high), unit=unit)},
    )


def suspected(found: Findings, models: ProbabilityModels, belief: float) -> tuple[list[Suspect], dict[str, Features]]:
    """Return the effect that the search came closest to adding when it ended, if any, and its signs."""
    last = found.stages[-1] if found.stages else None
    named = {type(effect) for effect in found.final.effects}
    if last is None or not last.rivals or last.rivals[0].kind in named:
        return [], {}
    best = last.rivals[0]
    features = confidence.effect_features(last, best.kind)
    chance = belief * min(models.suspect.probability(features), NAMED)
    return [Suspect(effect=best.kind.name, probability=chance)], {best.kind.name: features}


def nearest(found: Findings) -> Rival | None:
    """Return the effect that explains most of what the search left, and which share of the excess."""
    last = found.stages[-1] if found.stages else None
    if last is None or not last.rivals:
        return None
    return Rival(effect=last.rivals[0].kind.name, reduction=last.gain(last.rivals[0]))


def intervals(search: Search, final: Hypothesis) -> list[dict[str, Pair]]:
    """Return the 95 % interval of each fitted parameter of each effect.

    From the normal matrix and the scatter of its right-hand sides from segment to segment, which counts what is
    left as it is, correlated in time or not (White 1980; segments as clusters). Every other effect of the library may
    be there too, with a standard deviation of 5 % of its typical size, which the numbers may make up for.
    """
    numbers, others = adjustables_of(final), one_of_each(final)
    evidence = search.probed(final, others)
    inside = ~evidence.held_out
    n, n_all = len(numbers), len(numbers) + len(others)
    prior = np.r_[[float(item.prior) for item in numbers], np.full(len(others), HIDDEN**-2)]
    normal = evidence.products[inside].sum(axis=0)[1:, 1:] + np.diag(prior)
    groups, place = np.unique(evidence.group[inside], return_inverse=True)
    sums = np.zeros((len(groups), n_all))
    np.add.at(sums, place, evidence.products[inside, 0, 1:])
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-9, hermitian=True) / np.outer(scale, scale)
    spread = sums.T @ sums * len(groups) / max(len(groups) - n, 1)
    deviations = 1.96 * np.sqrt(np.diag(inverse @ (spread + np.diag(prior)) @ inverse))
    found, first = [], len(final.shifts)
    for effect in final.effects:
        items = adjustables(effect)
        own: dict[str, Pair] = {}
        for item, deviation in zip(items, deviations[first : first + len(items)].tolist(), strict=True):
            value = float(getattr(effect, item.name))
            half = deviation * item.step
            own[item.name] = max(value - half, item.low), min(value + half, item.high)
        found.append(own)
        first += len(items)
    return found


def one_of_each(final: Hypothesis) -> list[Hypothesis]:
    """Return a hypothesis with each effect that it lacks, at a typical size and in the middle of its shapes."""
    added = (item for item in candidates(final) if item.replaces is None)
    return [item.hypotheses(final)[0] for item in middle_shapes(added)]


def deviating_parameters(
    search: Search, final: Hypothesis, recalibrated: float, models: ProbabilityModels
) -> tuple[list[Cause], dict[str, Features], float]:
    """Return the effects whose size is a value on paper that moved further than it should be wrong, and their signs.

    A kind of value that is corrected on both sides of the screw counts once, with the sum of its changes. The share of
    the gap that re-calibration closes, ``recalibrated``, is divided in proportion to what each correction closes beside
    all others. The third result is the largest distance that any of them moved, in standard deviations.
    """
    replay, split = search.replay, search.split.plain
    scale = nominal_parameters(final.nominal)
    groups: dict[str, list[int]] = {}
    for place, calibration in enumerate(scale):
        groups.setdefault(f"{calibration.kind}_{calibration.index}", []).append(place)
    closed = float(channel_gaps(replay, split, final).mean())
    moves: list[tuple[str, float, float, float, str]] = []
    for places in groups.values():
        sizes = [scale[place].size(final.nominal.drive) for place in places]
        change = sum(final.shifts[place] * size for place, size in zip(places, sizes, strict=True))
        distance = abs(change) / max(math.hypot(*sizes), 1e-30)
        shifts = tuple(0.0 if place in places else shift for place, shift in enumerate(final.shifts))
        without = float(channel_gaps(replay, split, dataclasses.replace(final, shifts=shifts)).mean())
        moves.append((scale[places[0]].cause(final.nominal), change, distance, without, scale[places[0]].unit))
    total = max(sum(max(without - closed, 0.0) for _, _, _, without, _ in moves), 1e-12)
    present = {item.name for item in final.effects}
    found: list[Cause] = []
    all_features: dict[str, Features] = {}
    for name, change, distance, without, unit in moves:
        if distance <= BEYOND_DOUBT or not name or name in present or without - closed < SMALLEST_GAIN * without:
            continue
        share = recalibrated * (without - closed) / total
        all_features[name] = confidence.value_features(distance, without - closed, closed)
        found.append(
            Cause(
                effect=name,
                kind=VALUE,
                probability=models.value.probability(all_features[name]),
                share=share,
                unique_share=share,
                parameters={"change": Quantity(value=change, ci95=None, unit=unit)},
            )
        )
    return found, all_features, max((distance for _, _, distance, _, _ in moves), default=0.0)


def indistinguishable(contest: Stage, kind: type[Effect]) -> list[str]:
    """Return the names of rivals that explain nearly as much as an effect."""
    gains = {rival.kind: contest.gain(rival) for rival in contest.rivals}
    return [rival.name for rival, gain in gains.items() if rival is not kind and gain >= ALIKE * gains[kind]]


def instead(contest: Stage, kind: type[Effect], same: Collection[str]) -> Rival | None:
    """Return the best effect that can be told from one, and the share of the held-out excess that each would remove.

    It is the control against mere flexibility: a wrong effect, fitted just as well, should remove much less.
    """
    gains = {rival.kind.name: contest.gain(rival) for rival in contest.rivals}
    others = {name: gain for name, gain in gains.items() if name != kind.name and name not in same}
    if not others:
        return None
    best = max(others, key=lambda name: others[name])
    return Rival(effect=best, reduction=others[best], reduction_of_named=gains[kind.name])


def force_balances(told: Mapping[type[Effect], float], kind: type[Effect], same: Collection[str]) -> ForceBalances:
    """Return what an effect removes of the force balances, and the best other effect that can be told from it."""
    others = {rival.name: share for rival, share in told.items() if rival is not kind and rival.name not in same}
    best = max(others, key=lambda name: others[name], default=None)
    rival = None if best is None else Rival(effect=best, reduction=others[best])
    return ForceBalances(reduction=told[kind], instead=rival)


def divided(contest: Stage, kind: type[Effect], same: Collection[str], probability: float) -> dict[str, float]:
    """Return the probabilities of an effect and its rivals.

    The effect and those that cannot be told from it divide ``probability`` as the contest has it. The others divide
    the chance that it is another or none, but keep their odds against these.
    """
    chances = {rival.kind.name: p for rival, p in zip(contest.rivals, contest.probabilities(), strict=True)}
    together = sum(p for name, p in chances.items() if name == kind.name or name in same)
    if together <= 0.0:
        return {kind.name: probability}
    own = probability / together
    other = min((1.0 - probability) / (1.0 - together), own) if together < 1.0 else 0.0
    found = {name: p * (own if name == kind.name or name in same else other) for name, p in chances.items()}
    return {name: p for name, p in found.items() if p >= FEWEST or name == kind.name}


def one_of(chances: Mapping[str, float]) -> list[str]:
    """Return the fewest effects that hold the cause with a probability of at least 0.9, or all where that is less.

    >>> one_of({"backlash": 0.8, "dead_time": 0.05, "axial_compliance": 0.12})
    ['backlash', 'axial_compliance']
    """
    found: list[str] = []
    for name in sorted(chances, key=lambda name: -chances[name]):
        if sum(chances[item] for item in found) >= LEVEL:
            break
        found.append(name)
    return found


def parameters(effect: Effect, bounds: Mapping[str, Pair]) -> dict[str, Quantity]:
    """Return the parameters of an effect with units; those that no fit moves have no interval."""
    return {
        item.name: Quantity(value=getattr(effect, item.name), ci95=bounds.get(item.name), unit=item.unit)
        for item in type(effect).parameters()
    }


def not_fitted(effect: Effect) -> list[str]:
    """Return the parameters that are neither searched nor fitted, so that they have their typical values."""
    fitted = {item.name for item in adjustables(effect)}
    return [item.name for item in effect.parameters() if item.name not in fitted and not item.grid]


def at_bound(effect: Effect) -> list[str]:
    """Return the fitted parameters that lie on a bound of what the library allows."""
    return [item.name for item in adjustables(effect) if getattr(effect, item.name) in (item.low, item.high)]
