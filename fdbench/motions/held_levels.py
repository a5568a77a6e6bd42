"""Velocity levels held for equal times, joined by a limited acceleration."""

from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.errors import SpecError
from fdbench.motions._motion import Motion, Reference, from_velocity
from fdbench.specification import nonnegative, positive


@final
@dataclass(frozen=True, kw_only=True)
class HeldLevels(Motion):
    """Staircase of commanded velocities, as used to identify feed drives in a velocity loop.

    The last level is kept until the end; the command is zero during the first and last ``rest_s``.

    Source: Erkorkmaz, Altintas (2001), High speed CNC system design, part II, Int. J. Machine Tools and Manufacture 41;
    McPherson (2024), figures 3.2 and 3.4.

    Examples
    --------
    >>> motion = HeldLevels(levels_m_per_s=(1.0,), hold_s=1.0, acceleration_limit_m_per_s2=0.5)
    >>> motion.reference(1.0, 4)[:, 1].tolist()
    [0.5, 1.0, 1.0, 1.0]
    """

    levels_m_per_s: tuple[float, ...]
    hold_s: float = positive()
    acceleration_limit_m_per_s2: float = positive()
    rest_s: float = nonnegative(default=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.levels_m_per_s:
            raise SpecError("levels_m_per_s: the list is empty; at least one level is needed.")

    def reference(self, period_s: float, n_samples: int) -> Reference:
        """Return the (n_samples, 3) reference; the levels change at multiples of the rounded hold time."""
        hold, rest = (round(min(time_s / period_s, n_samples)) for time_s in (self.hold_s, self.rest_s))
        index = np.minimum(np.arange(n_samples) // hold, len(self.levels_m_per_s) - 1)
        target = np.asarray(self.levels_m_per_s)[index]
        target[:rest] = 0.0
        target[n_samples - rest :] = 0.0
        step = self.acceleration_limit_m_per_s2 * period_s
        velocity = np.empty(n_samples)
        current = 0.0
        for k in range(n_samples):
            current += min(max(target[k] - current, -step), step)
            velocity[k] = current
        return from_velocity(velocity, period_s)
