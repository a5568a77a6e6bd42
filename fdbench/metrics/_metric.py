"""What a metric is: a number for one outcome, with unit, direction, and the value that a failure is worth."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from fdbench.estimator import Estimate, Regression
from fdbench.record import FloatArray, Record
from fdbench.registry import Registry
from fdbench.scenario import Scenario, Truth


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """All that is known after an estimator has run on one record.

    Attributes
    ----------
    scenario, record, regression : Scenario, Record, Regression
    truth : Truth
    estimate : Estimate
    seconds : float
        Time of ``fit``.
    response : (n_rows,) array or None
        What ``predict`` returned for the scenario's validation motion, where there is one.
    """

    scenario: Scenario
    record: Record
    regression: Regression
    truth: Truth
    estimate: Estimate
    seconds: float
    response: FloatArray | None = None


class Metric(ABC):
    """A registered score; file name = name.

    Class attributes
    ----------------
    unit : str
        Unit of the value; empty for a pure number.
    bigger_is_better : bool
    worst : float
        Value that a failed run is ranked with.
    ideal : float
        Value of a perfect estimate, which also is where no gain is left.
    track : str
        Leaderboard that the metric belongs to: parameters, disturbance, output or speed.
    primary : bool
        Whether the metric counts in the ranking of its track.
    decades : float
        For a primary metric: how many tenfold smaller errors lie between the score of the data sheet, 0, and 1; there
        the best that is conceivable on a drive should lie.
    practical_limit, practical_change : float
        Smallest relative and smallest absolute change that matter to a user; both must be exceeded.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    bigger_is_better: ClassVar[bool] = False
    worst: ClassVar[float]
    ideal: ClassVar[float] = 0.0
    track: ClassVar[str]
    primary: ClassVar[bool] = False
    decades: ClassVar[float] = 3.0
    practical_limit: ClassVar[float] = 0.05
    practical_change: ClassVar[float] = 0.0

    @abstractmethod
    def skip(self, outcome: Outcome) -> str | None:
        """Return why the metric does not apply to this outcome, or None if it does."""

    @abstractmethod
    def score(self, outcome: Outcome) -> float:
        """Return the value; only called where ``skip`` returns None."""


metrics: Registry[Metric] = Registry("metric", Metric)  # type: ignore[type-abstract]
