"""What reference diagnosers share: when a gap is more than noise."""

import math

TOO_SMALL, STEEP = 1.3, 20.0  # mean squared gap in units of the floor that is as likely noise as not


def gap_probability(mean_square: float) -> float:
    """Return the probability that a mean squared gap in units of the floor is more than noise."""
    return 1.0 / (1.0 + math.exp(-max(min(STEEP * (mean_square - TOO_SMALL), 60.0), -60.0)))
