"""Cause sets: what an axis with one cause may have, with a guarantee that no probability has to be right for."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from fdbench.diagnosis.answer.cause import CauseSet
from fdbench.diagnosis.settings import JUDGE
from fdbench.specification import load_toml, read

FILE = Path(__file__).with_name("axes_with_one_cause.toml")


@dataclass(frozen=True, kw_only=True)
class AxesWithOneCause:
    """Simulated axes with one cause that the library has, diagnosed, none of which anything was learned from.

    Attributes
    ----------
    source : str
        Trials that they are of.
    truth : tuple of float
        Probability that was given to the cause that each has.
    unknown : tuple of float
        Probability of an unknown cause on each.
    """

    source: str
    truth: tuple[float, ...]
    unknown: tuple[float, ...]


@lru_cache(maxsize=1)
def axes_with_one_cause() -> AxesWithOneCause:
    """Return the axes that the package is shipped with."""
    return read(AxesWithOneCause, load_toml(FILE), FILE.name)


def cause_set(
    chances: Mapping[str, float],
    unknown: float,
    axes: AxesWithOneCause | None = None,
    alike: Collection[Collection[str]] = (),
) -> CauseSet:
    r"""Return the effects that the one cause of an axis is among.

    An effect is in the set unless its conformal p-value is too small:

    .. math:: p_k = \frac{1 + \#\{i : t_i \le q_k\}}{n + 1} > \alpha

    with its probability q_k here and the probability t_i that the true cause was given on n axes with one. Whatever the
    probabilities are worth, the set of an axis with one cause that is exchangeable with them lacks that cause with a
    probability of at most alpha.

    Source: Vovk, Gammerman, Shafer (2005), Algorithmic Learning in a Random World, chapter 2.

    Parameters
    ----------
    chances : mapping of str to float
        Probability of each effect; those left out have none.
    unknown : float
        Probability of an unknown cause.
    axes : AxesWithOneCause, optional
        Without, those that the package is shipped with.
    alike : collection of collections of str
        Effects that are not told from one another: all of them are in a set that has one.

    Returns
    -------
    CauseSet
        Most probable first. Where even an effect without any probability may be the cause, ``everything`` is true.

    Examples
    --------
    >>> axes = AxesWithOneCause(source="", truth=(0.2, 0.25, *[0.9] * 18), unknown=(0.1,))
    >>> cause_set({"backlash": 0.85, "dead_time": 0.15, "cogging": 0.3}, 0.0, axes).causes
    ('backlash', 'cogging')
    >>> cause_set({"backlash": 0.85, "dead_time": 0.15}, 0.0, axes, [("backlash", "dead_time")]).causes
    ('backlash', 'dead_time')
    """
    known = axes or axes_with_one_cause()

    def may_be_it(chance: float) -> bool:
        return 1 + sum(own <= chance for own in known.truth) > (1.0 - JUDGE.level) * (1 + len(known.truth))

    found = {name for name, chance in chances.items() if may_be_it(chance)}
    found |= {name for own in alike if found & {*own} for name in own}
    return CauseSet(
        causes=tuple(sorted(found, key=lambda name: (-chances.get(name, 0.0), name))),
        everything=may_be_it(0.0),
        holds=JUDGE.level,
        axes=len(known.truth),
        exchangeable=any(own >= unknown for own in known.unknown),
    )
