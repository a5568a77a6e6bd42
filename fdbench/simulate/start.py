"""Where an axis is and how fast it moves when an episode begins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError

Reference = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Start:
    """State of a feed drive or a servo stage at the first sample; one number for each axis.

    The whole motion is displaced by the position, as by a work offset: the reference begins where the axis stands, and
    a position loop sees no step. The velocity is that of the axis alone, an error that the loop has to take away; what
    the controller has read before is the way at that velocity, its integral is 0.

    Parameters
    ----------
    position_m : tuple of float
        Position at the first sample, from where the motion would begin; 0 where none is given.
    velocity_m_per_s : tuple of float
        Velocity at the first sample; 0 where none is given.
    """

    position_m: tuple[float, ...] = ()
    velocity_m_per_s: tuple[float, ...] = ()

    def displaced(self, reference: Reference) -> Reference:
        """Return a reference (n_samples, 3 n_axes) that begins where the axes stand."""
        if not any(self.position_m):
            return reference
        moved = reference.copy()
        moved[:, ::3] += self.position_m
        return moved

    def positions(self, n_axes: int) -> NDArray[np.float64]:
        """Return how far the motion of each axis is displaced, (n_axes,)."""
        return np.array(self.position_m or [0.0] * n_axes)

    def velocities(self, n_axes: int) -> NDArray[np.float64]:
        """Return the velocity of each axis, (n_axes,)."""
        return np.array(self.velocity_m_per_s or [0.0] * n_axes)

    def check(self, reference: Reference, travel_m: float, velocity_limit_m_per_s: float) -> None:
        """Raise a SpecError if numbers are missing, or if an axis leaves its limits on this motion."""
        n_axes = reference.shape[1] // 3
        for name, values in (("position_m", self.position_m), ("velocity_m_per_s", self.velocity_m_per_s)):
            if len(values) not in (0, n_axes):
                raise SpecError(f"start.{name}: {len(values)} numbers, but the motion moves {n_axes} axes.")
        for axis, velocity in enumerate(self.velocity_m_per_s):
            if not abs(velocity) <= velocity_limit_m_per_s:
                raise SpecError(
                    f"start.velocity_m_per_s.{axis}: {velocity:g} m/s is beyond the velocity limit of the plant; "
                    f"allowed: -{velocity_limit_m_per_s:g} to {velocity_limit_m_per_s:g}."
                )
        for axis, position in enumerate(self.position_m):
            way = reference[:, 3 * axis]
            low, high = -travel_m - float(way.min()), travel_m - float(way.max())
            if not low <= position <= high:
                raise SpecError(
                    f"start.position_m.{axis}: from {position:g} m the motion leaves the travel of {travel_m:g} m on "
                    f"either side; allowed: {low:g} to {high:g}."
                )
