"""False alarms: how sure the diagnosis is of a cause on axes that have none, whatever its probabilities are worth."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from fdbench.diagnosis.answer.cause import FalseAlarms
from fdbench.specification import load_toml, read

FILE = Path(__file__).with_name("axes_without_cause.toml")


@dataclass(frozen=True, kw_only=True)
class AxesWithoutCause:
    """Simulated axes without a cause, diagnosed, none of which the probability models were learned from.

    Attributes
    ----------
    source : str
        Trials that they are of.
    surest : tuple of float
        Probability of the surest cause on each.
    unknown : tuple of float
        Probability of an unknown cause on each.
    """

    source: str
    surest: tuple[float, ...]
    unknown: tuple[float, ...]


@lru_cache(maxsize=1)
def axes_without_cause() -> AxesWithoutCause:
    """Return the axes that the package is shipped with."""
    return read(AxesWithoutCause, load_toml(FILE), FILE.name)


def false_alarms(surest: float, unknown: float, axes: AxesWithoutCause | None = None) -> FalseAlarms:
    r"""Return how often an axis without a cause is given one as sure as this.

    .. math:: p = \frac{1 + \#\{i : s_i \ge s\}}{n + 1}

    with the probability s of the surest cause, here and on n axes without one. Whatever the distribution of s is, an
    axis without a cause that is exchangeable with them has p up to any level with that probability at most. One on
    which an unknown cause is more probable than on any of them is not exchangeable with them.

    Source: Vovk, Gammerman, Shafer (2005), Algorithmic Learning in a Random World, chapter 2.

    Parameters
    ----------
    surest, unknown : float
        Probability of the surest cause, and of an unknown one.
    axes : AxesWithoutCause, optional
        Without, those that the package is shipped with.

    Examples
    --------
    >>> axes = AxesWithoutCause(source="", surest=(0.1, 0.2, 0.6), unknown=(0.1, 0.1, 0.2))
    >>> found = false_alarms(0.5, 0.1, axes)
    >>> found.at_most, found.axes, found.exchangeable
    (0.5, 3, True)
    """
    known = axes or axes_without_cause()
    as_sure = _count(known.surest, surest)
    return FalseAlarms(
        at_most=(1.0 + as_sure) / (1.0 + len(known.surest)),
        as_sure=as_sure,
        axes=len(known.surest),
        exchangeable=_count(known.unknown, unknown) > 0,
    )


def _count(found: Sequence[float], least: float) -> int:
    return sum(value >= least for value in found)
