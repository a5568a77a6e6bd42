"""What re-calibration alone does."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from fdbench.diagnosis.answer.quantity import Quantity, Shares


@dataclass(frozen=True, kw_only=True)
class Parametric:
    """What re-calibration alone does.

    Attributes
    ----------
    closed_by_recalibration : float
    moved_in_standard_deviations : mapping of str to float
        How far each nominal parameter moves without effects, and beside them (``moved_beside_effects``).
    changes : mapping of str to Quantity
        By how much each moves without effects, as a share where it has no unit; empty in answers of before.
    values : mapping of str to Quantity
        The same of those that a cause changes, by its name, on both sides of a screw together, where that is further
        than any doubt.
    nameless : mapping of str to Quantity
        By how much those differ beside the effects that moved far and that no effect stands for, such as gains.
    set_anew : mapping of str to Quantity
        By what share gains of the controller differ from those of the baseline; the nominal model has the new ones.
    """

    closed_by_recalibration: float
    moved_in_standard_deviations: Shares
    moved_beside_effects: Shares = field(default_factory=dict)
    changes: Mapping[str, Quantity] = field(default_factory=dict)
    values: Mapping[str, Quantity] = field(default_factory=dict)
    nameless: Mapping[str, Quantity] = field(default_factory=dict)
    set_anew: Mapping[str, Quantity] = field(default_factory=dict)
