"""How much was recorded."""

from dataclasses import dataclass

from fdbench.diagnosis.answer.quantity import Quantity


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """How much was recorded.

    Attributes
    ----------
    records, samples : int
    sampling_time_s : float
    baseline : int
        Records of the machine before that it is compared with.
    force : Quantity or None
        Root mean square of the motor's force.
    """

    records: int
    samples: int
    sampling_time_s: float
    baseline: int = 0
    force: Quantity | None = None
