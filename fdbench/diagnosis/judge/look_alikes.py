"""Look-alikes: effects that these records do not tell apart, and how they share a probability."""

from collections.abc import Collection, Mapping

from fdbench.diagnosis.answer.cause import ForceBalances, RivalReduction
from fdbench.diagnosis.search.stage import Stage
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect


def akin(contest: Stage, kind: type[Effect]) -> list[str]:
    """Return the names of rivals that explain nearly as much as an effect: one of them is there, if any."""
    own = contest.of(kind)
    return [rival.kind.name for rival in contest.alike(contest.gain(own)) if rival is not own]


def instead(contest: Stage, kind: type[Effect], same: Collection[str]) -> RivalReduction | None:
    """Return the best effect that differs from one, and the share of the held-out excess that each would remove.

    It is the control against mere flexibility: a wrong effect, fitted just as well, should remove much less.
    """
    gains = {rival.kind.name: contest.gain(rival) for rival in contest.rivals}
    others = {name: gain for name, gain in gains.items() if name != kind.name and name not in same}
    if not others:
        return None
    best = max(others, key=lambda name: others[name])
    return RivalReduction(effect=best, reduction=others[best], reduction_of_named=gains[kind.name])


def force_balances(removed: Mapping[type[Effect], float], kind: type[Effect], same: Collection[str]) -> ForceBalances:
    """Return what an effect removes of the force balances, and the best other effect that is distinguished from it."""
    others = {rival.name: share for rival, share in removed.items() if rival is not kind and rival.name not in same}
    best = max(others, key=lambda name: others[name], default=None)
    rival = None if best is None else RivalReduction(effect=best, reduction=others[best])
    return ForceBalances(reduction=removed[kind], instead=rival)


def divided(contest: Stage, kind: type[Effect], same: Collection[str], probability: float) -> dict[str, float]:
    """Return the probabilities of an effect and its rivals.

    The effect and those ``same`` as it divide ``probability`` as the contest has it. The others divide
    the chance that it is another or none, but keep their odds against these.
    """
    chances = {rival.kind.name: p for rival, p in zip(contest.rivals, contest.probabilities(), strict=True)}
    together = sum(p for name, p in chances.items() if name == kind.name or name in same)
    if together <= 0.0:
        return {kind.name: probability}
    own = probability / together
    other = min((1.0 - probability) / (1.0 - together), own) if together < 1.0 else 0.0
    found = {name: p * (own if name == kind.name or name in same else other) for name, p in chances.items()}
    return {name: p for name, p in found.items() if p >= JUDGE.fewest or name == kind.name}


def one_of(chances: Mapping[str, float]) -> list[str]:
    """Return the fewest effects that hold the cause with a probability of at least 0.9, or all where that is less.

    >>> one_of({"backlash": 0.8, "dead_time": 0.05, "axial_compliance": 0.12})
    ['backlash', 'axial_compliance']
    """
    found: list[str] = []
    for name in sorted(chances, key=lambda name: -chances[name]):
        if sum(chances[item] for item in found) >= JUDGE.level:
            break
        found.append(name)
    return found
