"""What the answers of the package's own diagnosis and of its untempered twin have in common."""

import math
from collections.abc import Sequence

from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.diagnosis.search.stage import Stage


def accepted(found: Diagnosis) -> list[Stage]:
    """Return the stages of the search whose best rival was added."""
    added = {type(effect) for effect in found.final.effects}
    return [stage for stage in found.stages if stage.rivals and stage.rivals[0].kind in added]


def weights(logs: Sequence[float]) -> list[float]:
    """Return normalised exponentials.

    >>> weights([0.0, 0.0]), weights([-1e5, 0.0])
    ([0.5, 0.5], [0.0, 1.0])
    """
    top = max(logs)
    found = [math.exp(value - top) for value in logs]
    return [value / sum(found) for value in found]
