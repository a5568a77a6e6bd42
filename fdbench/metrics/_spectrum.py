"""Power spectral density of the prediction error, and the noise floor that a scenario knows."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fdbench.errors import PluginError
from fdbench.metrics._metric import Outcome
from fdbench.metrics._series import claimed, in_window, no_white_floor, not_claimed
from fdbench.plants.feed_drive import FeedDrive
from fdbench.regression import FloatArray

LONGEST_SEGMENT = 1024
FEWEST_ROWS = 128
ORDERS = (2, 3, 4, 5)
# Bins between two lines so that a main lobe of Hann's window (two bins and half a bin of offset) is clear of the other.
CLEARANCE = 4
SMALLEST_RATIO = 1e-30


class Bins(NamedTuple):
    """Bins of a Welch density: the disturbance with its neighbours, its harmonics with theirs, all others."""

    disturbance: list[int]
    harmonics: list[int]
    others: list[int]


def folded(frequency_Hz: float, rate_Hz: float) -> float:
    """Return where a frequency appears after sampling.

    >>> folded(350.0, 1000 / 3), folded(110.0, 333.0), folded(220.0, 333.0)
    (16.6667, 110.0, 113.0)
    """
    return abs(frequency_Hz - rate_Hz * round(frequency_Hz / rate_Hz))


def segment_length(n_rows: int) -> int:
    """Return 1024, or the largest power of two of which three segments, overlapping by half, fit into the rows.

    >>> segment_length(3996), segment_length(2047), segment_length(128)
    (1024, 512, 64)
    """
    return min(LONGEST_SEGMENT, 1 << ((n_rows // 2).bit_length() - 1))


def bins_of(n_rows: int, rate_Hz: float, frequency_Hz: float | None) -> Bins:
    """Return the bins for a disturbance at a frequency: three for each line, which hold its power to 0.1 dB.

    Harmonics 2 to 5 are folded at Nyquist; those that fall on the fundamental or on zero are neither harmonics nor
    others. Without a frequency all bins are others,
    but for the first two, which lose power with the mean, and the one at Nyquist, which has half.

    >>> bins_of(128, 64.0, 10.0)[:2]  # bins of 1 Hz; 40 Hz folds to 24 Hz, 50 Hz to 14 Hz
    ([9, 10, 11], [19, 20, 21, 29, 30, 31, 23, 24, 25, 13, 14, 15])
    """
    length = segment_length(n_rows)
    everything = range(length // 2 + 1)
    if frequency_Hz is None:
        return Bins([], [], list(everything[2:-1]))
    centres = [round(folded(order * frequency_Hz, rate_Hz) * length / rate_Hz) for order in (1, *ORDERS)]
    lines = [[index for index in (centre - 1, centre, centre + 1) if index in everything] for centre in centres]
    free = [min(centre, abs(centre - centres[0])) >= CLEARANCE for centre in centres]
    harmonics = dict.fromkeys(index for line, clear in zip(lines, free, strict=True) if clear for index in line)
    on_a_line = {index for line in lines for index in line}
    return Bins(lines[0], list(harmonics), [index for index in everything[2:-1] if index not in on_a_line])


def welch(values: FloatArray, rate_Hz: float) -> FloatArray:
    """Return the one-sided density by Welch's method: Hann's window, overlap by half, each segment without its mean."""
    from scipy import signal

    length = segment_length(len(values))
    _, density = signal.welch(values, rate_Hz, window="hann", nperseg=length, noverlap=length // 2)
    return np.asarray(density, dtype=np.float64)


def median_of_mean(n_rows: int) -> float:
    r"""Return median over mean of the Welch densities of white noise.

    .. math:: (1 - 2 / 9 \nu)^3, \quad \nu = \frac{2 K}{1 + 2 (1 - 1/K) / 36}

    for K segments: Wilson and Hilferty (1931) for chi squared, with the degrees of freedom of Welch (1967) for Hann's
    window.

    >>> median_of_mean(128), median_of_mean(10**6)
    (0.889, 1.000)
    """
    length = segment_length(n_rows)
    K = (n_rows - length) // (length // 2) + 1
    degrees = 2.0 * K / (1.0 + 2.0 * (1.0 - 1.0 / K) / 36.0)
    return (1.0 - 2.0 / (9.0 * degrees)) ** 3


def n_rows_in_window(outcome: Outcome) -> int:
    """Return the number of rows from which the density is taken."""
    window = in_window(outcome)
    return int(window.stop - window.start)


def bins(outcome: Outcome) -> Bins:
    """Return the bins of an outcome's density."""
    period_s = outcome.scenario.estimation.disturbance_period_s
    rate_Hz = 1.0 / outcome.regression.sampling_time_s
    return bins_of(n_rows_in_window(outcome), rate_Hz, None if period_s is None else 1.0 / period_s)


def residual_density(outcome: Outcome) -> FloatArray:
    """Return the density of target minus output within the scenario's window."""
    return _density_left(outcome, claimed(outcome, "output"))


def _density_left(outcome: Outcome, predicted: FloatArray) -> FloatArray:
    residual = (outcome.regression.target - predicted)[in_window(outcome)]
    return welch(residual, 1.0 / outcome.regression.sampling_time_s)


def no_density(outcome: Outcome) -> str | None:
    """Return why there is no density to be compared with a noise floor, or None if there is one."""
    if n_rows_in_window(outcome) < FEWEST_ROWS:
        return f"fewer than {FEWEST_ROWS} rows in the window"
    if no_white_floor(outcome) is not None and not _has_truth(outcome):
        return "the noise of the model is not known"
    return not_claimed(outcome, "output")


def _has_truth(outcome: Outcome) -> bool:
    """Return whether what the truth leaves is noise: of a rigid drive's equation, in which the force acts undelayed."""
    plant, regression = outcome.scenario.plant, outcome.regression
    is_rigid = isinstance(plant, FeedDrive) and plant.screw is None
    return is_rigid and len(regression.names) > 0 and outcome.truth.output(regression) is not None


def decibels_above_floor(outcome: Outcome, level: Callable[[FloatArray], float]) -> float:
    r"""Return a level of the prediction error's density in dB above that of the noise; none at all is -300 dB.

    The noise is white equation noise, :math:`2 \sigma^2 T_s`. Where readings are noisy as well, or the equation is one
    of forces, noise has a colour: there it is what true parameters and force leave of this very record.
    """
    if no_white_floor(outcome) is None:
        floor = 2.0 * outcome.scenario.reality.noise.equation_velocity_m_per_s**2 * outcome.regression.sampling_time_s
    else:
        predicted = outcome.truth.output(outcome.regression)
        if predicted is None:
            raise PluginError("parameters: asked for although not all true ones are known.")
        floor = level(_density_left(outcome, predicted))
    return 10.0 * math.log10(max(level(residual_density(outcome)) / max(floor, 5e-324), SMALLEST_RATIO))
