"""What a motion is: a commanded position, velocity and acceleration on the controller's clock."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fdbench.registry import Registry
from fdbench.specification import check_bounds, reads_plugins_of

Reference = NDArray[np.float64]


class Motion(ABC):
    """A frozen specification of a trajectory; file name = ``kind`` in a scenario."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        check_bounds(self)

    @abstractmethod
    def reference(self, period_s: float, n_samples: int) -> Reference:
        """Return an (n_samples, 3) array: position (m), velocity (m/s) and acceleration (m/s^2)."""


def from_velocity(velocity: NDArray[np.float64], period_s: float) -> Reference:
    """Return the reference of a commanded velocity: positions are its running sum, accelerations its differences."""
    position = np.concatenate(([0.0], np.cumsum(velocity[:-1] + velocity[1:]) * (0.5 * period_s)))
    acceleration = np.append(np.diff(velocity), 0.0) / period_s
    return np.column_stack((position, velocity, acceleration))


motions: Registry[Motion] = Registry("motion", Motion)  # type: ignore[type-abstract]
reads_plugins_of(motions)
