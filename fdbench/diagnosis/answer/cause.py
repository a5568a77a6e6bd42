"""Causes: those that are named or suspected, their types, and how far their probabilities can be trusted."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from fdbench.diagnosis.answer.quantity import Quantity, Shares

EFFECT, VALUE, READING = "effect", "value", "reading"  # kinds of causes


@dataclass(frozen=True, kw_only=True)
class RivalReduction:
    """The best other effect, and which share of the held-out excess (or of force balances) it would remove."""

    effect: str
    reduction: float
    reduction_of_named: float | None = None


@dataclass(frozen=True, kw_only=True)
class ForceBalances:
    """Share of the squared force balances on motor and table that a cause removes, whatever the controller is."""

    reduction: float
    instead: RivalReduction | None = None


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One cause of the gap.

    Attributes
    ----------
    effect : str
    kind : str
        ``effect``: added to the model; ``value``: a nominal parameter that is wrong; ``reading``: seen in the readings
        themselves.
    probability : float
    share, unique_share : float
        Of the mean squared gap after re-calibration, shared by the mean over all orders, and what no other cause
        explains (no more than its share); of a value, of the nominal gap.
    parameters : mapping of str to Quantity
    indistinguishable_from : tuple of str
    share_of_channel : mapping of str to float
    alternatives : mapping of str to float
        Probabilities of what may be there in its place.
    one_of : tuple of str
        The fewest effects that hold the cause with a probability of 0.9.
    instead : RivalReduction or None
    force_balances : ForceBalances or None
    typical : tuple of str
        Parameters that were not found from the data.
    at_bound : tuple of str
        Parameters that lie on the bound of what the library allows.
    within_known : bool
        Whether it says no more than how a known friction turns its sign, or what that is in doubt by: no cause.
    beside_changes : bool
        Whether its shares, and its step of the shrinkage, are of the gap beside what friction changes by from run to
        run, which hides it in the whole.
    """

    effect: str
    probability: float
    share: float
    unique_share: float
    parameters: Mapping[str, Quantity]
    indistinguishable_from: tuple[str, ...] = ()
    kind: str = EFFECT
    parametric: bool = False
    share_of_channel: Shares = field(default_factory=dict)
    alternatives: Shares = field(default_factory=dict)
    one_of: tuple[str, ...] = ()
    instead: RivalReduction | None = None
    force_balances: ForceBalances | None = None
    typical: tuple[str, ...] = ()
    at_bound: tuple[str, ...] = ()
    within_known: bool = False
    beside_changes: bool = False

    def __post_init__(self) -> None:
        # Answers of before ``kind`` say it by ``parametric``, which stays readable and written.
        if self.parametric and self.kind == EFFECT:
            object.__setattr__(self, "kind", VALUE)
        object.__setattr__(self, "parametric", self.kind == VALUE)


@dataclass(frozen=True, kw_only=True)
class Suspect:
    """An effect that the search came close to adding."""

    effect: str
    probability: float


@dataclass(frozen=True, kw_only=True)
class CauseType:
    """A type of cause, on which side of the screw, and how probable it is that one of that type is there.

    Attributes
    ----------
    type : str
        One of `fdbench.effects.CAUSE_TYPES`.
    side : str or None
        ``motor`` or ``table``; None on a rigid axis and for what is between the two.
    """

    type: str
    side: str | None
    probability: float


@dataclass(frozen=True, kw_only=True)
class FalseAlarms:
    """How often an axis without a cause is given one as sure as the surest of this answer.

    Attributes
    ----------
    at_most : float
        Probability of that on an axis that is exchangeable with those below (conformal p-value).
    as_sure, axes : int
        On how many of how many simulated axes without a cause it was so.
    exchangeable : bool
        False where more is left unexplained than on any of these.
    """

    at_most: float
    as_sure: int
    axes: int
    exchangeable: bool


@dataclass(frozen=True, kw_only=True)
class CauseSet:
    """Effects that the cause is among, if there is one.

    Attributes
    ----------
    causes : tuple of str
        Most probable first.
    everything : bool
        True where no effect of the library can be left out.
    holds : float
        Probability with which the one cause of an axis is in the set, if that axis is exchangeable with those below.
    axes : int
        Simulated axes with one cause.
    exchangeable : bool
        False where more is left unexplained than on any of these.
    """

    causes: tuple[str, ...]
    everything: bool
    holds: float
    axes: int
    exchangeable: bool


def chances(causes: Iterable[Cause], suspects: Iterable[Suspect]) -> dict[str, float]:
    """Return the probability of each effect: its own where it is named or suspected, else as an alternative."""
    found: dict[str, float] = {}
    for cause in causes:
        for name, chance in cause.alternatives.items():
            found[name] = max(found.get(name, 0.0), chance)
    found |= {suspect.effect: suspect.probability for suspect in suspects}
    return found | {cause.effect: cause.probability for cause in causes}
