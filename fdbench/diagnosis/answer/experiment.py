"""The next experiment, and what it is expected to tell apart."""

from dataclasses import dataclass

from fdbench.diagnosis.answer.quantity import Pair


@dataclass(frozen=True, kw_only=True)
class ExpectedProbability:
    """Expected probability of the true cause, now and after a motion."""

    now: float
    after: float


@dataclass(frozen=True, kw_only=True)
class Separation:
    """Effects that a motion tells apart, and the log odds that it is expected to bring, in nats."""

    effects: tuple[str, ...]
    expected_log_odds: float


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """The next experiment.

    Attributes
    ----------
    to_separate : tuple of str
    trajectory : str
        The motion in words, or the file that it was written to.
    kind, motion : str
        The motion without and with sizes.
    """

    to_separate: tuple[str, ...]
    trajectory: str
    expected_log_odds: float | None = None
    separates: tuple[Separation, ...] = ()
    expected_probability: ExpectedProbability | None = None
    expected_gain_per_s: float | None = None
    kind: str = ""
    motion: str = ""
    position_m: Pair | None = None
    amplitude_m: float | None = None
    velocity_m_per_s: float | None = None
    acceleration_m_per_s2: float | None = None
    duration_s: float | None = None
    file: str | None = None
