"""How the probabilities of an answer are composed of several."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fdbench.diagnosis.answer.cause import Cause, Suspect
from fdbench.diagnosis.settings import JUDGE


def nothing(causes: Sequence[Cause], suspects: Sequence[Suspect], unknown: float) -> float:
    r"""Return the probability that nothing is there of all that is said, each being there or not on its own.

    .. math:: p = (1 - u) \prod_c \Bigl(1 - \sum_e p_c(e)\Bigr)

    with the probability u of an unknown cause and those p_c(e) that a cause or suspect c is the effect e; look-alikes
    exclude each other.

    >>> nothing([], [Suspect(effect="cogging", probability=0.25)], 0.2)
    0.6000000000000001
    """
    known = (cause.probability + sum(cause.alternatives.values()) for cause in causes)
    chances = [unknown, *(min(p, 1.0) for p in known), *(suspect.probability for suspect in suspects)]
    return math.prod(1.0 - chance for chance in chances)


@dataclass(frozen=True, kw_only=True)
class Credit:
    """How far what is named is believed beside what is left of the gap.

    Attributes
    ----------
    discount : float
        See `plausibility_discount`.
    doubt : float
        Probability of an unknown cause, whatever the gap is beside what repeats differ by.
    small : float
        Share of the gap that is small beside what is left.
    """

    discount: float
    doubt: float
    small: float

    def of_share(self, share: float) -> float:
        """Return the factor on the probability of what explains a share of the gap.

        What explains little beside what is left of the gap may be a part of a cause that is not known.
        """
        return self.discount * (1.0 - self.doubt * self.small / max(self.small + share, 1e-12))


def plausibility_discount(left: float) -> float:
    """Return the factor on the probabilities of what is named, from the share of the nominal gap that it surely leaves.

    The factor is 1 where at least half of the gap is explained, and falls in proportion below that: what explains
    little of a large gap may stand in for a cause that the library lacks.

    >>> plausibility_discount(0.3), plausibility_discount(0.75)
    (1.0, 0.5)
    """
    return min(1.0, (1.0 - left) / JUDGE.enough)


def noise_alone(mean_square: float, of: float = JUDGE.unrepeated) -> float:
    r"""Return the probability that noise alone reaches a mean squared gap g, in units of its floor, after repeats.

    .. math:: p = 1 / (1 + (g / g_0)^4)

    with :math:`g_0`, which ``of`` half as many exceed.

    >>> round(noise_alone(1.0), 3), noise_alone(10.0), round(noise_alone(74.0), 5)
    (1.0, 0.5, 0.00033)
    """
    return 1.0 / (1.0 + (max(mean_square, 0.0) / of) ** 4)
