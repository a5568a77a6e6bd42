"""The verdict: causes with probabilities, shares and intervals, and the chances of an unknown cause and of no gap."""

import dataclasses
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fdbench.diagnosis.answer.cause import READING, Cause, RivalReduction, Suspect, chances
from fdbench.diagnosis.answer.quantity import Pair, Quantity
from fdbench.diagnosis.evidence.sensor_artefacts import Artefact, energies
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.composed import Credit, noise_alone, nothing, plausibility_discount
from fdbench.diagnosis.judge.contested import Contested, contested, is_no_cause
from fdbench.diagnosis.judge.findings import Findings
from fdbench.diagnosis.judge.force_balance_check import force_balances_removed
from fdbench.diagnosis.judge.intervals import intervals, not_fitted, parameters
from fdbench.diagnosis.judge.left import left_of, within_repeats
from fdbench.diagnosis.judge.look_alikes import force_balances, instead, one_of
from fdbench.diagnosis.judge.nominal_values import Deviating, deviating_parameters, with_mass_of
from fdbench.diagnosis.judge.probability_models import Beside, Features, ProbabilityModels
from fdbench.diagnosis.judge.reduction import Reductions
from fdbench.diagnosis.judge.shares import Parts, Shares
from fdbench.diagnosis.model.hypothesis import at_bound
from fdbench.diagnosis.search.stage import Rival
from fdbench.diagnosis.settings import JUDGE
from fdbench.rotary import spoken_unit

OR = " or "  # between the names of one claim


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """Part of the answer, and the features that its probabilities are predicted from.

    Attributes
    ----------
    causes : tuple of Cause
    suspects : tuple of Suspect
    nearest : RivalReduction or None
    unknown_probability, no_gap_probability : float
    features : mapping
        By the kind of claim (see `fdbench.diagnosis.judge.probability_models.ProbabilityModels`) and the name
        of what is claimed; names of effects that share a probability are joined by " or ".
    worst : float
        See `fdbench.diagnosis.judge.probability_models.Beside`.
    """

    causes: tuple[Cause, ...]
    suspects: tuple[Suspect, ...]
    nearest: RivalReduction | None
    unknown_probability: float
    no_gap_probability: float
    features: Mapping[str, Mapping[str, Features]] = field(default_factory=dict)
    worst: float = 1.0

    def surest(self) -> float:
        """Return the probability of the surest cause or suspect, 0 without any."""
        return max(self.chances().values(), default=0.0)

    def settled(self) -> float:
        """Return the probability of the surest cause or of no gap, and no more than that of no unknown cause."""
        return min(max(self.surest(), self.no_gap_probability), 1.0 - self.unknown_probability)

    def chances(self) -> dict[str, float]:
        """Return the probability of each effect that is named, suspected or an alternative to one that is named."""
        return chances(self.causes, self.suspects)

    def alike(self) -> list[tuple[str, ...]]:
        """Return each cause with those that it is not told from."""
        return [(cause.effect, *cause.indistinguishable_from, *cause.one_of) for cause in self.causes]


def verdict(found: Findings, models: ProbabilityModels) -> Verdict:
    """Return the verdict; see the contract for the answer.

    Shares of effects are of the gap that re-calibration leaves, those of nominal parameters of the nominal gap.
    """
    search, reductions = found.search, found.reductions
    plain = search.split.plain
    noise_models = plain.noise_models
    interpolated = sum(
        (energies(artefact, noise_models) for artefact in found.artefacts if artefact.interpolated),
        np.zeros(len(noise_models)),
    )
    recalibrated = np.array([reductions.of_channel(place)[0] for place in range(len(noise_models))])
    shares, of_nominal = Shares(recalibrated, interpolated), Shares(found.as_given, interpolated)
    repaired = np.array([reductions.of_channel(place)[-1] for place in range(len(noise_models))])
    discount = plausibility_discount(of_nominal.of(np.maximum(repaired - JUDGE.unrepeated, 0.0)))
    corrected = of_nominal.of(np.maximum(found.as_given - recalibrated, 0.0))
    deviating, exchanged = _values(found, corrected, models)
    left = left_of(found, repaired)
    parts = Parts(reductions, shares, list(noise_models))
    effects = contested(found, left.worst, exchanged, parts, models)
    if any(item.effect.carried_mass_kg > 0.0 and item.probability <= JUDGE.named for item in effects):
        recalibrated_values = deviating_parameters(search, found.calibrated, corrected, models)
        deviating = with_mass_of(deviating, recalibrated_values, found.final)
    sound = [item for item in effects if item.in_part <= JUDGE.named and not item.no_cause]
    readings = [
        artefact_cause(artefact, shares.of(energies(artefact, noise_models)))
        for artefact in found.artefacts
        if artefact.probability >= JUDGE.fewest
    ]
    unknown = confidence.unknown_features(
        misfit=left.misfit,
        worst=left.worst,
        strain=found.final.strain,
        at_limits=found.final.at_limits,
        closed=left.closed,
        measured=plain.is_measured,
        surest=max(
            (*(item.probability for item in sound), *(item.probability for item in (*deviating.causes, *readings))),
            default=0.0,
        ),
    )
    # What is left of the gap, a value that is off and has no name, and a part of an effect that is none without the
    # rest speak for an unknown cause independently of each other.
    stand_ins = math.prod(1.0 - item.in_part * item.probability for item in effects)
    known = (1.0 - models.unknown.probability(unknown)) * stand_ins
    of_the_rest, as_repeats = max(1.0 - known, 1.0 - discount), within_repeats(found, recalibrated)
    has_a_name = 1.0 - deviating.nameless
    doubt = 1.0 - (1.0 - of_the_rest) * has_a_name
    credit = Credit(discount=discount, doubt=doubt, small=JUDGE.small_share * shares.of(repaired))
    # A value without a name is off, however little it leaves.
    unknown_probability = 1.0 - (1.0 - min(of_the_rest, 1.0 - as_repeats)) * has_a_name
    causes = [
        *_effects(found, effects, credit, parts),
        *(dataclasses.replace(value, probability=discount * value.probability) for value in deviating.causes),
        *readings,
    ]
    causes.sort(key=lambda cause: (cause.probability <= JUDGE.named, -cause.share))
    beside = Beside(largest=max((item.own_size for item in effects), default=0.0), worst=left.worst)
    suspects, suspect_features_of = suspected(found, models, beside, discount, chances(causes, ()))
    effect_features_of = {OR.join((item.effect.name, *item.same)): item.features for item in sound}
    claims = {"effect": effect_features_of, "suspect": suspect_features_of, "value": deviating.features}
    within_noise = noise_alone(max(float(reductions.mean()[0]), float(found.where_fitted.mean())))
    no_gap = max(within_noise, as_repeats)
    if not any(cause.probability > JUDGE.named for cause in causes):
        # What is neither told nor no gap has to be something.
        unknown_probability = max(unknown_probability, nothing(causes, suspects, 0.0) - no_gap)
    return Verdict(
        causes=tuple(causes),
        suspects=tuple(suspects),
        nearest=nearest(found),
        unknown_probability=unknown_probability,
        no_gap_probability=min(no_gap, nothing(causes, suspects, unknown_probability)),
        features={**claims, "unknown": {"unknown": unknown}},
        worst=left.worst,
    )


def _effects(found: Findings, items: Sequence[Contested], credit: Credit, parts: Parts) -> Iterator[Cause]:
    """Yield the effects of the final hypothesis as causes, but those that the readings themselves tell of."""
    bounds, shown_by = intervals(found.search, found.final), found.shown_by
    for index, item in enumerate(items):
        if any(artefact.tells_of(item.effect) for artefact in found.artefacts):
            continue
        most, reductions = item.most(index in shown_by), shown_by.get(index, found.reductions)
        beside_changes = reductions is not found.reductions
        own = _parts_of(reductions, parts.channels) if beside_changes else parts
        # What a value explains that an effect is in place of is no part of what re-calibration leaves.
        factor = credit.discount if item.instead_of_a_value else credit.of_share(own.share(index))
        believed = factor * (1.0 - item.in_part)
        odds = {name: min(believed * p, most) for name, p in item.odds.items()}
        cause = _named(found, item, odds, own, index, bounds[index])
        yield dataclasses.replace(cause, beside_changes=beside_changes)


def _parts_of(reductions: Reductions, channels: list[str]) -> Parts:
    gaps = np.array([reductions.of_channel(place)[0] for place in range(len(channels))])
    return Parts(reductions, Shares(gaps, np.zeros(len(gaps))), channels)


def _named(
    found: Findings,
    item: Contested,
    odds: Mapping[str, float],
    parts: Parts,
    index: int,
    bounds: Mapping[str, Pair],
) -> Cause:
    """Return an effect of the final hypothesis as a cause."""
    effect, contest, same, search = item.effect, item.contest, item.indistinguishable, found.search
    with_equivalents = found.final.nominal.with_equivalents
    fitted = [rival for rival in contest.rivals if rival.refined or rival.kind is type(effect)]
    removed = force_balances_removed(search.readings, search.split, dataclasses.replace(contest, rivals=tuple(fitted)))
    share = parts.share(index)
    return Cause(
        effect=effect.name,
        probability=odds[effect.name],
        share=share,
        share_of_channel=parts.by_channel(index),
        unique_share=min(share, parts.unique(index)),
        parameters=parameters(effect, bounds),
        indistinguishable_from=tuple(with_equivalents([effect.name, *same])[1:]),
        alternatives={name: p for name, p in odds.items() if name != effect.name},
        one_of=tuple(with_equivalents(one_of(odds))),
        instead=instead(contest, type(effect), same),
        force_balances=force_balances(removed, type(effect), same),
        typical=tuple(not_fitted(effect)),
        at_bound=tuple(at_bound(effect)),
        within_known=item.no_cause,
    )


def _values(found: Findings, corrected: float, models: ProbabilityModels) -> tuple[Deviating, dict[str, float]]:
    """Return the values that are off, and the probabilities of an effect that is in place of one and of that value.

    What is in doubt is which of the two it is, not that it is one of them.
    """
    deviating, exchange = deviating_parameters(found.search, found.weighed, corrected, models), found.exchange
    if exchange is None:
        return deviating, {}
    is_taken = found.weighed is exchange.hypothesis
    moved = deviating_parameters(found.search, exchange.without, corrected, models) if is_taken else deviating
    off = next((cause for cause in moved.causes if cause.effect == exchange.value), None)
    if off is None or off.probability * exchange.odds < JUDGE.fewest:
        return deviating, {}
    shared = {
        exchange.kind.name: off.probability * exchange.odds,
        exchange.value: off.probability * (1.0 - exchange.odds),
    }
    if is_taken:
        return deviating, shared
    # An effect that is there already, and would only change more slowly, is no alternative.
    other = {} if found.weighed.has(exchange.kind) else {exchange.kind.name: shared[exchange.kind.name]}
    others = {**off.alternatives, **other}
    doubted = dataclasses.replace(off, probability=shared[exchange.value], alternatives=others)
    causes = [doubted if cause is off else cause for cause in deviating.causes]
    return dataclasses.replace(deviating, causes=causes), {}


def artefact_cause(artefact: Artefact, share: float) -> Cause:
    """Return the cause that is seen in the readings themselves."""
    amplitude = artefact.kind.amplitude
    units = {item.name: spoken_unit(item.unit) for item in artefact.kind.parameters()}
    further = {name: Quantity(value=value, ci95=None, unit=units[name]) for name, value in artefact.further.items()}
    size = Quantity(value=artefact.value, ci95=(artefact.low, artefact.high), unit=units[amplitude])
    return Cause(
        effect=artefact.kind.name,
        kind=READING,
        probability=artefact.probability,
        share=share,
        unique_share=share,
        parameters={amplitude: size, **further},
    )


def suspected(
    found: Findings, models: ProbabilityModels, beside: Beside, discount: float, taken: Collection[str]
) -> tuple[list[Suspect], dict[str, Features]]:
    """Return the effects that were not added when the search ended, most probable first, and their features.

    Not those that are ``taken``, as a cause or in place of one.
    """
    last = found.stages[-1] if found.stages else None
    kinds = [] if last is None else [rival.kind for rival in last.rivals if _is_suspect(rival, taken)]
    features: dict[str, Features] = {}
    if last is not None:
        features = {kind.name: confidence.effect_features(last, kind, beside) for kind in kinds}
    suspects = [
        Suspect(effect=name, probability=discount * min(models.suspect.probability(own, [name]), JUDGE.named))
        for name, own in features.items()
    ]
    return sorted(suspects, key=lambda suspect: -suspect.probability), features


def _is_suspect(rival: Rival, taken: Collection[str]) -> bool:
    acting = rival.hypothesis.as_it_acts()
    return rival.kind.name not in taken and not is_no_cause(acting.effect_of(rival.kind), acting)


def nearest(found: Findings) -> RivalReduction | None:
    """Return the effect that explains most of what the search left, and which share of the excess."""
    last = found.stages[-1] if found.stages else None
    if last is None or not last.rivals:
        return None
    return RivalReduction(effect=last.rivals[0].kind.name, reduction=last.gain(last.rivals[0]))
