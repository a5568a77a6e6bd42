"""Beside the known: an effect that is to take the place of a known one, and explains more where that one stays."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

from scipy.special import expit

from fdbench.diagnosis.model.friction_parameters import KnownAmplitude
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.known_effects import amplitude_of
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.search.in_place_of_a_value import family
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.settings import SEARCH
from fdbench.effects import Effect


@dataclass(frozen=True, kw_only=True, eq=False)
class Remainder:
    """A known effect that stays beside one that is to take its place.

    Attributes
    ----------
    kinds : tuple of Effect class
        That is to take its place, and those that were there for what is missing without the known one.
    log_odds : float
        That the known one stays against that it is gone.
    """

    kinds: tuple[type[Effect], ...]
    log_odds: float

    @property
    def odds(self) -> float:
        """Probability that it stays."""
        return float(expit(self.log_odds))


def beside_the_known(search: Search, base: Hypothesis) -> Remainder | None:
    r"""Return what speaks for a known effect staying beside the one that took its place; None where none did.

    An axis has bristles or Coulomb friction. Where both explain more, something resists beside a friction that is as it
    was, such as a seal or a cable chain: no effect of the library is that. Compared with the misfits M and penalties p,

    .. math:: \ln\frac{p(\text{beside})}{p(\text{in place})}
        = \frac{n}{2} \ln\frac{M_i}{M_b} + \frac{p_i - p_b}{2} + (k_i - k_b - 1) \ln N

    with N effects of the library, one of which is as likely as none, and as what is in none: of the k effects of
    either, those of the same type may have been added for what is missing without the known one.

    Parameters
    ----------
    search : Search
        Of the runs as they are judged.
    base : Hypothesis
        Fitted to these.
    """
    found = next(_replacements(base), None)
    if found is None:
        return None
    effect, index = found
    others = tuple(item for item in base.effects if item is not effect)
    apart = tuple(item for item in others if family(type(item)) != family(type(effect)))
    tried = [_beside(base, effect, index, kept) for kept in dict.fromkeys((others, apart))]
    refined = [search.refinement.refine(item) for item in tried]
    stays = [item for item in refined if _left(item, index) > SEARCH.stays]
    if not stays:
        return None
    kind = type(effect)
    compared = search.compared(base.without_effect(kind), [(kind, item, True) for item in (base, *stays)])
    evidence = {
        id(rival.hypothesis): compared.log_evidence(rival.misfit, rival.penalty)
        - 0.5 * base.cost_of_a_cause * len(rival.hypothesis.effects)
        for rival in compared.rivals
    }
    best = max(stays, key=lambda item: evidence[id(item)])
    superfluous = tuple(type(item) for item in others if not best.has(type(item)))
    log_odds = evidence[id(best)] - evidence[id(base)] - 0.5 * base.cost_of_a_cause
    return Remainder(kinds=(kind, *superfluous), log_odds=log_odds)


def _replacements(base: Hypothesis) -> Iterator[tuple[Effect, int]]:
    """Yield each effect that is in place of a known one, and the index of that."""
    for effect in base.effects:
        for index in base.replaced:
            if effect.in_place_of(base.nominal.drive.effects[index]) is not None:
                yield effect, index


def _beside(base: Hypothesis, effect: Effect, index: int, others: tuple[Effect, ...]) -> Hypothesis:
    """Return a hypothesis with half of an effect, and half as much of the known one that it is in place of."""
    known, half = base.nominal.drive.effects[index], effect.scaled(0.5)
    ratio = amplitude_of(half) / amplitude_of(known)
    shifts = [
        (ratio - 1.0) / item.deviation if isinstance(item, KnownAmplitude) and item.index == index else shift
        for item, shift in zip(nominal_parameters(base.nominal), base.shifts, strict=True)
    ]
    replaced = tuple(place for place in base.replaced if place != index)
    return dataclasses.replace(base, shifts=tuple(shifts), effects=(*others, half), replaced=replaced)


def _left(hypothesis: Hypothesis, index: int) -> float:
    """Return the share of a known effect that is left, on whichever side it acts."""
    scale = zip(nominal_parameters(hypothesis.nominal), hypothesis.shifts, strict=True)
    return sum(
        max(1.0 + shift * item.deviation, 0.0)
        for item, shift in scale
        if isinstance(item, KnownAmplitude) and item.index == index
    )
