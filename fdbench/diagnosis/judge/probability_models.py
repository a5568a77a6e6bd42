"""Confidence: how often what the search shows has turned out right, as logistic models learned on simulated trials."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from fdbench.diagnosis.search.stage import Stage
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect
from fdbench.specification import load_toml, read

FILE = Path(__file__).with_name("probability_models.toml")

Features = Mapping[str, float]
"""What speaks for a claim, by name."""


@dataclass(frozen=True, kw_only=True)
class Feature:
    """One feature of a logistic model: its mean and scatter in the trials that were learned from, and its weight."""

    centre: float
    scatter: float
    weight: float


@dataclass(frozen=True, kw_only=True)
class ProbabilityModel:
    r"""Probability that a claim is right, :math:`p = 1 / (1 + e^{-z})`.

    .. math:: z = b + \sum_i w_i (s_i - c_i) / d_i + \overline{n}

    with features s and the mean of what speaks for those names one of which is claimed: some effects pass for others,
    and some are what errors of a form look like.

    Attributes
    ----------
    bias : float
        :math:`b`.
    features : mapping of str to Feature
        Centre :math:`c`, scatter :math:`d` and weight :math:`w` of each.
    names : mapping of str to float
        :math:`n` of each effect, 0 for others.
    claims, right : int
        How many claims were learned from, and how many of them were right.
    """

    bias: float
    features: Mapping[str, Feature]
    claims: int
    right: int
    names: Mapping[str, float] = field(default_factory=dict)

    def probability(self, found: Features, names: Sequence[str] = ()) -> float:
        """Return the probability of a claim, clipped by Laplace's rule of succession to [1/(n+2), 1 - 1/(n+2)]."""
        z = self.bias + sum(
            own.weight * (found[name] - own.centre) / own.scatter for name, own in self.features.items()
        )
        z += sum(self.names.get(name, 0.0) for name in names) / max(len(names), 1)
        surest = 1.0 / (self.claims + 2.0)
        return min(max(1.0 / (1.0 + math.exp(-max(min(z, 50.0), -50.0))), surest), 1.0 - surest)


@dataclass(frozen=True, kw_only=True)
class ProbabilityModels:
    """Models for an effect, one nearly added, a nominal parameter and an unknown cause; their origin."""

    effect: ProbabilityModel
    suspect: ProbabilityModel
    value: ProbabilityModel
    unknown: ProbabilityModel
    source: str


@lru_cache(maxsize=1)
def models() -> ProbabilityModels:
    """Return the probability models that the package is shipped with."""
    return read(ProbabilityModels, load_toml(FILE), FILE.name)


@dataclass(frozen=True, kw_only=True)
class Beside:
    """What a claim of an effect stands beside.

    Attributes
    ----------
    largest : float
        Largest ``own_size`` of another effect that was found, 0 without any: what is far smaller may be what is left
        of one whose form is not quite the library's.
    worst : float
        Mean squared gap that is left in the stretch of time where that is most, in units of the noise within a run.
    """

    largest: float = 0.0
    worst: float = 1.0


def effect_features(contest: Stage, kind: type[Effect], beside: Beside, same: Collection[str] = ()) -> dict[str, float]:
    """Return the features of an effect, or of one of several that share its probability.

    What an effect changes counts beside the evidence for it: machines have traces of every effect, and forms that are
    not quite the library's look like further effects that are small. It counts twice: as what it changes in the base,
    of which nominal parameters may hide a part (and all of one that scales every value, whose own size counts there),
    and in its own hypothesis; and once more between the size of a trace and that of a cause, up to a larger one for an
    effect that is ``everywhere``. What else the contest shows (misfits,
    how many numbers were fitted, steadiness over time, what it removes of the force balances) added nothing.

    Parameters
    ----------
    contest : Stage
        The model without the effect, and what rivals make of that.
    kind : Effect class
    beside : Beside
    same : collection of str
        Names of the rivals that it shares its probability with.
    """
    own = contest.of(kind)
    different = (rival for rival in contest.rivals if rival.kind is not kind and rival.kind.name not in same)
    others = [contest.log_evidence(rival.misfit, rival.penalty) for rival in different]
    best = max([contest.log_evidence(contest.misfit, contest.penalty), *others])
    in_base = own.own_size if kind.scales_every_value else own.size
    size, own_size = (max(item, JUDGE.smallest_size) for item in (in_base, own.own_size))
    least = max(min(size, own_size), JUDGE.trace_size)
    return {
        "margin": math.asinh(contest.log_evidence(own.misfit, own.penalty) - best),
        "size": math.log10(size),
        "own_size": math.log10(own_size),
        "above_trace": math.log10(min(least, JUDGE.cause_size)),
        "everywhere": math.log10(min(least / JUDGE.large_size, 1.0)) if kind.everywhere else 0.0,
        "beside": math.log10(min(own_size / max(beside.largest, JUDGE.smallest_size), 1.0)),
        "worst": math.log(max(beside.worst, JUDGE.smallest_misfit)),
    }


def value_features(distance: float, closed: float, misfit: float) -> dict[str, float]:
    """Return the features of a nominal parameter that deviates by more than its uncertainty.

    Parameters
    ----------
    distance : float
        Standard deviations by which it moved.
    closed, misfit : float
        Mean squared held-out gap that its correction closes, and what is left, in units of what repeats differ by.
    """
    return {
        "distance": math.log(max(distance, JUDGE.smallest_distance)),
        "size": math.log10(max(closed, JUDGE.smallest_size)),
        "misfit": math.log(max(misfit, JUDGE.smallest_misfit)),
    }


def unknown_features(
    *, misfit: float, worst: float, strain: float, at_limits: int, closed: float, measured: bool, surest: float
) -> dict[str, float]:
    """Return the features of an unknown cause.

    Parameters
    ----------
    misfit : float
        Weighted misfit that is left beside all effects that were found, of one model for all runs or of one whose
        friction may be another in each, whichever is less.
    worst : float
        See `Beside`.
    strain : float
        Of nominal parameters beside them, see `Hypothesis.strain`: they may stand in for what nothing else can.
    at_limits : int
        How many of them are at a limit, see `Hypothesis.at_limits`.
    closed : float
        Share of the gap of the nominal model beyond the noise that is closed by everything, or beside what friction may
        change from run to run, where that is more.
    measured : bool
        Whether repeats tell the noise, which else holds a part of the gap.
    surest : float
        Largest probability of a cause that is known, as though none could be unknown.
    """
    return {
        "misfit": math.log(max(misfit, JUDGE.smallest_misfit)),
        "worst": math.log(max(worst, JUDGE.smallest_misfit)),
        "strain": math.log1p(strain),
        "at_limits": float(at_limits),
        "closed": closed,
        "measured": float(measured),
        "surest": surest,
    }
