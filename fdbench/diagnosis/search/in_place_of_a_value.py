"""In place of a value: an effect that explains what a nominal parameter was moved for, and leaves it as it is known."""

import dataclasses
import math
from collections.abc import Collection
from dataclasses import dataclass

from scipy.special import expit

from fdbench.diagnosis.model.hypothesis import Hypothesis, adjustables
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.search.stage import Rival, Stage
from fdbench.diagnosis.settings import JUDGE, MODEL, SEARCH
from fdbench.effects import Effect, effects


@dataclass(frozen=True, kw_only=True, eq=False)
class Exchange:
    """An effect instead of another value of a nominal parameter.

    Attributes
    ----------
    value : str
        Name of the effect that a large change of the value is.
    kind : Effect class
    without, hypothesis : Hypothesis
        With the value moved, and with the effect instead.
    log_odds : float
        Of the effect against the value.
    """

    value: str
    kind: type[Effect]
    without: Hypothesis
    hypothesis: Hypothesis
    log_odds: float

    @property
    def held(self) -> list[str]:
        """Names of the nominal parameters that a delay is in place of: beside each other nothing holds both."""
        if self.kind.cause_type != "delay":
            return []
        nominal = self.hypothesis.nominal
        return [item.name for item in nominal_parameters(nominal) if item.cause(nominal) == self.value]

    @property
    def odds(self) -> float:
        """Probability that it is the effect, if it is one of the two."""
        return float(expit(self.log_odds))


def in_place_of_a_value(search: Search, base: Hypothesis, stage: Stage, calibrated: Hypothesis) -> Exchange | None:
    r"""Return the most probable exchange of a value for an effect of its family, such as friction, if there is one.

    The search weighs what friction may do in each run, so that a value moves there for nothing, and an effect that
    would make this unnecessary has nothing to explain. Compared as they are, with the misfits M and penalties p of one
    model for all runs,

    .. math:: \ln\frac{p(\text{effect})}{p(\text{value})} = \frac{n}{2} \ln\frac{M_v}{M_e} + \frac{p_v - p_e}{2} - \ln N

    one of the N effects of the library being as likely as a value that is wrong. One that scales every value takes the
    place of all at once, as what moves together has one cause, and removes nothing that they do not. It is as likely as
    any one of them that is a cause by itself, and nothing is taken off. Nor is anything for a delay in place of another
    one that is known, from which motions hardly tell it, and for one that is there already and takes longer than
    records: what of a friction hardly falls in them is not another size of it besides.

    Parameters
    ----------
    search : Search
        Of the runs as they are judged.
    base : Hypothesis
        Fitted to these.
    stage : Stage
        The last one, with the rivals that are tried.
    calibrated : Hypothesis
        What predicts best without any effect: no tempered step leads as far as it may be.
    """
    return _exchanged(search, base, stage) or _already_exchanged(search, base, calibrated)


def _already_exchanged(search: Search, base: Hypothesis, calibrated: Hypothesis) -> Exchange | None:
    """Return the most probable exchange of a known delay that is longer for another one that a hypothesis has already.

    Without it the known one would be far longer, so that both say the same.
    """
    found = []
    for effect in base.effects:
        kind = type(effect)
        known = [name for name in _distances(base) if family(effects.get(name)) == family(kind)]
        if kind.cause_type != "delay" or not known:
            continue
        bare = base.without_effect(kind)
        moved = dataclasses.replace(bare, shifts=calibrated.shifts)
        without = search.refinement.best_from(base, [moved], search.refinement.refine(bare))
        compared = search.compared(without, [(kind, base, True)])
        log_odds = compared.evidence_of(compared.of(kind)) - compared.log_evidence(compared.misfit, compared.penalty)
        found += [
            Exchange(value=name, kind=kind, without=without, hypothesis=base, log_odds=log_odds)
            for name in known
            if _wrong(without).get(name, 0.0) * SEARCH.back > _distances(base)[name]
        ]
    return max(found, key=lambda item: item.log_odds, default=None)


def _wrong(hypothesis: Hypothesis) -> dict[str, float]:
    """Return the values that are moved beyond doubt, and how far."""
    moved = _distances(hypothesis)
    return {name: size for name, size in moved.items() if size > JUDGE.beyond_doubt and not _named(hypothesis, name)}


def _exchanged(search: Search, base: Hypothesis, stage: Stage) -> Exchange | None:
    """Return the most probable exchange of a value that a hypothesis has moved for an effect that it has not."""
    wrong = _wrong(base)
    if not wrong:
        return None
    families = {family(effects.get(name)) for name in wrong}
    absent = [rival.kind for rival in stage.rivals if not base.has(rival.kind) and rival.kind.name not in wrong]
    scaling = [kind for kind in absent if kind.scales_every_value]
    late = [kind for kind in absent if kind.cause_type == "delay" and family(kind) in families]
    tried = [rival for rival in stage.rivals if _is_tried(rival, base, families) and rival.kind not in late]
    slower = [item for effect in base.effects if family(type(effect)) in families for item in _slower(base, effect)]
    if not tried and not scaling and not late and not slower:
        return None
    hypotheses = [(rival.kind, search.refinement.refine(rival.added_to(base, stage.base)), True) for rival in tried]
    as_likely = [*scaling, *late]
    hypotheses += [(kind, _as_given_beside(search.refinement, base, stage.of(kind)), True) for kind in as_likely]
    hypotheses += [(kind, search.refinement.refine(begun), True) for kind, begun in slower]
    compared = search.compared(base, hypotheses)
    as_a_cause = compared.log_evidence(compared.misfit, compared.penalty)
    as_it_is = as_a_cause + 0.5 * base.cost_of_a_cause

    def log_odds(rival: Rival) -> float:
        if base.has(rival.kind):
            return compared.log_evidence(rival.misfit, rival.hypothesis.named_penalty()) - as_a_cause
        return compared.evidence_of(rival) - (as_a_cause if rival.kind in as_likely else as_it_is)

    found = [
        Exchange(
            value=name,
            kind=rival.kind,
            without=base,
            hypothesis=rival.hypothesis,
            log_odds=log_odds(rival),
        )
        for rival in compared.rivals
        for name, size in wrong.items()
        if (rival.kind in scaling or family(effects.get(name)) == family(rival.kind))
        and _distances(rival.hypothesis)[name] < SEARCH.back * size
    ]
    return max(found, key=lambda item: item.log_odds, default=None)


def _as_given_beside(refinement: Refinement, base: Hypothesis, rival: Rival) -> Hypothesis:
    """Return the best fit of an effect from values as they are given, and from where it was fitted before."""
    first = refinement.refine(base.as_on_paper().with_effect(rival.kind.typical()))
    before = [rival.hypothesis] if rival.refined and rival.hypothesis.has(rival.kind) else []
    return refinement.best_from(base, before, first)


def _slower(base: Hypothesis, effect: Effect) -> list[tuple[type[Effect], Hypothesis]]:
    """Return a hypothesis, if a time of an effect is at the length of records, with a longer one and values as given.

    Its size and time are as many times as large, so that it changes as fast at the start.
    """
    covered = base.nominal.covered
    most = covered.most("s")
    times = [item for item in adjustables(effect, covered) if item.high == most < math.inf]
    if not any(item.of(effect) >= (1.0 - MODEL.at_bound) * most for item in times):
        return []
    longer = base.nominal.beside(dataclasses.replace(covered, longest_s=SEARCH.longest_time * covered.longest_s))
    names = [type(effect).amplitude, *(item.name for item in times)]
    begun = effect.within(**{name: math.sqrt(SEARCH.longest_time) * getattr(effect, name) for name in names})
    every = tuple(begun if item is effect else item for item in base.effects)
    return [(type(effect), dataclasses.replace(base, nominal=longer, effects=every).as_on_paper())]


def _distances(hypothesis: Hypothesis) -> dict[str, float]:
    """Return for each value that has a name how far it is moved, in standard deviations, on the side where it is most.

    A value that is gone with a known effect that another one replaces has not moved.
    """
    found: dict[str, float] = {}
    for item, shift in zip(nominal_parameters(hypothesis.nominal), hypothesis.shifts, strict=True):
        name = item.cause(hypothesis.nominal)
        if name and not item.nuisance:
            far = 0.0 if item.gone_with(hypothesis.replaced) else abs(shift)
            found[name] = max(found.get(name, 0.0), far)
    return found


def family(kind: type[Effect]) -> str:
    """Return what a type of cause is, whatever it depends on: friction over velocity and over time are friction."""
    return kind.type_of().partition("_over_")[0]


def _named(hypothesis: Hypothesis, name: str) -> bool:
    return any(item.name == name for item in hypothesis.effects)


def _is_tried(rival: Rival, base: Hypothesis, families: Collection[str]) -> bool:
    is_new = not base.has(rival.kind) and rival.hypothesis.has(rival.kind)
    return rival.refined and is_new and family(rival.kind) in families
