"""Contested: each effect of the final hypothesis beside the rivals that might be in its place."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.findings import Findings
from fdbench.diagnosis.judge.look_alikes import akin, divided
from fdbench.diagnosis.judge.probability_models import Beside, Features, ProbabilityModels
from fdbench.diagnosis.judge.shares import Parts
from fdbench.diagnosis.model.friction_parameters import KnownAmplitude
from fdbench.diagnosis.model.hypothesis import Hypothesis, is_beyond_its_form, is_corner, is_hollow
from fdbench.diagnosis.model.known_effects import amplitude_of, known_friction
from fdbench.diagnosis.model.loop_parameters import LoopLag
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.search.beside_the_known import Remainder
from fdbench.diagnosis.search.stage import Stage
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect


@dataclass(frozen=True, kw_only=True, eq=False)
class Contested:
    """An effect beside its rivals.

    Attributes
    ----------
    effect : Effect
    contest : Stage
    same : list of str
        Names of the rivals that it shares its probability with, see `look_alikes.akin`.
    own_size : float
        See `fdbench.diagnosis.search.stage.Rival`; 0 of what is no cause.
    features : mapping of str to float
    probability : float
        That it is it or one of them, as though no cause could be unknown.
    odds : mapping of str to float
        How it is divided among the effect, them, and others that may be there instead.
    instead_of_a_value : bool
        Whether it is in place of a value, whose odds these are, and of what that explains.
    in_part : float
        Probability that it is only a part of what it is called, see `is_hollow`, `Remainder`, and
        `Parts.is_worse_in_a_channel`: then an unknown cause is as probable.
    no_cause : bool
        Whether it says no more than how a known friction turns its sign, than how large that may be, or than how late
        every drive's force may be.
    """

    effect: Effect
    contest: Stage
    same: list[str]
    own_size: float
    features: Features
    probability: float
    odds: Mapping[str, float]
    instead_of_a_value: bool
    in_part: float
    no_cause: bool

    @property
    def indistinguishable(self) -> list[str]:
        """Names of those that hold so much of the shared probability that records do not tell them from it."""
        own = {name: self.odds.get(name, 0.0) for name in (self.effect.name, *self.same)}
        return [name for name in self.same if own[name] > (1.0 - JUDGE.level) * sum(own.values())]

    def most(self, is_seen: bool) -> float:
        """Return the highest probability that it may have: unseen or at a bound of its form, it is not named."""
        if self.no_cause:
            return JUDGE.fewest
        return 1.0 if is_seen and not is_beyond_its_form(self.effect) else JUDGE.named


def contested(
    found: Findings, worst: float, exchanged: Mapping[str, float], parts: Parts, models: ProbabilityModels
) -> list[Contested]:
    """Return each effect of the final hypothesis beside its rivals."""
    pairs = list(zip(found.final.effects, found.contests, strict=True))
    sizes = [size_as_cause(effect, contest, found.final) for effect, contest in pairs]
    every = []
    for index, ((effect, contest), own_size) in enumerate(zip(pairs, sizes, strict=True)):
        same = akin(contest, type(effect))
        beside = Beside(largest=max((*sizes[:index], *sizes[index + 1 :]), default=0.0), worst=worst)
        features = confidence.effect_features(contest, type(effect), beside, same)
        own = models.effect.probability(features, [effect.name, *same])
        odds = divided(contest, type(effect), same, own)
        instead_of_a_value = exchanged.get(effect.name, 0.0) > odds[effect.name]
        if instead_of_a_value:
            odds, own = dict(exchanged), max(own, exchanged[effect.name])
        every.append(
            Contested(
                effect=effect,
                contest=contest,
                same=same,
                own_size=own_size,
                features=features,
                probability=own,
                odds=odds,
                instead_of_a_value=instead_of_a_value,
                in_part=_in_part(effect, found.remainder, stands_in=parts.is_worse_in_a_channel(index)),
                no_cause=is_no_cause(effect, found.final),
            )
        )
    return every


def _in_part(effect: Effect, remainder: Remainder | None, *, stands_in: bool) -> float:
    if is_hollow(effect):
        return 1.0
    beside = 0.0 if remainder is None or type(effect) not in remainder.kinds else remainder.odds
    return max(beside, JUDGE.named) if stands_in else beside


def is_no_cause(effect: Effect, final: Hypothesis) -> bool:
    """Return whether an effect says how a known friction turns its sign, or no more than what that is in doubt of.

    A friction whose turn is known exactly has no other rounding. Of another law on top of the known one, it is no cause
    where both together are as large as that may be: within what is no cause of a friction of the same law either. Nor
    is it where it is less than that may be, and than that is larger by than on paper: then that says it. A lag is none
    where all that is late together is no later than the force of every drive may be.
    """
    drive, scale = final.nominal.drive, list(zip(nominal_parameters(final.nominal), final.shifts, strict=True))
    if effect.trace_of == LoopLag.kind and (passed_on := effect.linear_part()) is not None:
        lags = ((item, shift) for item, shift in scale if isinstance(item, LoopLag))
        return any(passed_on.late_s + item.lag_s(shift) <= item.lag_s(item.room[1]) for item, shift in lags)
    known = [
        (item.size(drive), shift) for item, shift in scale if isinstance(item, KnownAmplitude) and item.is_friction
    ]
    moved_N = sum(size * shift for size, shift in known)
    if effect.calibrates != KnownAmplitude.kind:
        turns_anyhow = final.nominal.uncertainty.transition_velocity > 0.0
        return turns_anyhow and is_corner(effect, known_friction(drive) + moved_N)
    own_N, doubt_N = amplitude_of(effect), math.hypot(*(size for size, _ in known))
    says_little = own_N * moved_N > 0.0 and abs(own_N) <= min(abs(moved_N), doubt_N)
    return says_little or abs(own_N + moved_N) <= JUDGE.beyond_doubt * doubt_N


def size_as_cause(effect: Effect, contest: Stage, final: Hypothesis) -> float:
    """Return the size of an effect of the final hypothesis; what is no cause is no large one that others are beside."""
    if is_no_cause(effect, final):
        return 0.0
    return contest.of(type(effect)).own_size
