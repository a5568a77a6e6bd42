"""No motion of the axes."""

from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.motions._motion import Motion, Reference


@final
@dataclass(frozen=True, kw_only=True)
class Standstill(Motion):
    """The axes stay where they are: the command of plants that bring their own, such as a spindle at speed.

    Examples
    --------
    >>> Standstill().reference(0.1, 2).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    """

    def reference(self, period_s: float, n_samples: int) -> Reference:
        """Return (n_samples, 3) zeros."""
        return np.zeros((n_samples, 3))
