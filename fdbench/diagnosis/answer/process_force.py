"""A force that acts in a record and does not repeat with the motion."""

from dataclasses import dataclass

from fdbench.diagnosis.answer.quantity import Pair


@dataclass(frozen=True, kw_only=True)
class Course:
    """Course of a force: times and values, thinned."""

    time_s: tuple[float, ...]
    force_N: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ProcessForce:
    """A force that acts in a record of another condition, or that does not repeat with the motion.

    Attributes
    ----------
    record : str
    condition : str or None
        As the record names it.
    beside : str
        ``repeats``: it is what differs from records of the same command; ``model``: from the final model, the record
        being left out of all the rest; ``nominal``: from the nominal model, in a record that is diagnosed.
    rms_N, mean_N, largest_N : float
        On the axis, in the direction of its position, while it acts.
    standard_deviation_N : float
        Of each value.
    range_s : pair of float
        From when to when it acts: it is beyond three standard deviations, in stretches whose root mean square is too.
    frequency_Hz, amplitude_N : float or None
        Of the sine that is its strongest line while it acts, where that has a quarter of the squares.
    course : Course
    """

    record: str
    condition: str | None = None
    beside: str
    rms_N: float
    mean_N: float
    largest_N: float
    standard_deviation_N: float
    range_s: Pair
    frequency_Hz: float | None = None
    amplitude_N: float | None = None
    course: Course
