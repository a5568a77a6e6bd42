"""Circular spiral in two axes, with limited feedrate, acceleration and jerk along the path."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.motions._motion import Motion, Reference
from fdbench.motions.jerk_limited_moves import JerkLimitedMoves
from fdbench.specification import nonnegative, positive


@final
@dataclass(frozen=True, kw_only=True)
class CircularSpiral(Motion):
    r"""Archimedean spiral from rest to rest.

    .. math::
        r(\theta) = r_0 + b \theta, \quad x = r \cos\theta - r_0, \quad y = r \sin\theta, \quad
        s(\theta) = \int_0^\theta \sqrt{r^2 + b^2}\, d\theta

    with :math:`b = (r_1 - r_0) / 2 \pi n` for n turns. The arc length s(t) is one seven-segment move, so the limits
    hold along the path; the centripetal acceleration :math:`\dot s^2 / r` comes on top. The spiral starts at the origin
    and rests at its end.

    Source: the path of Chou, Duan, Okwudire, figure 7, whose equation is not given; Biagiotti, Melchiorri, Trajectory
    Planning for Automatic Machines and Robots (2008), section 3.4, for the move.

    Examples
    --------
    >>> limits = dict(velocity_m_per_s=0.1, acceleration_m_per_s2=1e3, jerk_m_per_s3=1e8)
    >>> motion = CircularSpiral(start_radius_m=0.0, end_radius_m=0.01, turns=0.5, **limits)
    >>> end = motion.reference(0.01, 100)[-1]
    >>> (end[[0, 3]] + 0.0).round(12).tolist()  # half a turn on, on the other side
    [-0.01, 0.0]
    """

    start_radius_m: float = nonnegative()
    end_radius_m: float = positive()
    turns: float = positive()
    velocity_m_per_s: float = positive()
    acceleration_m_per_s2: float = positive()
    jerk_m_per_s3: float = positive()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.end_radius_m <= self.start_radius_m:
            raise SpecError(f"end_radius_m: {self.end_radius_m:g} m must be above the start radius.")

    @property
    def end_angle_rad(self) -> float:
        """Angle at the end of the path."""
        return 2.0 * math.pi * self.turns

    @property
    def radius_m_per_rad(self) -> float:
        """Growth of the radius, b."""
        return (self.end_radius_m - self.start_radius_m) / self.end_angle_rad

    def arc_length(self, angle: NDArray[np.float64]) -> NDArray[np.float64]:
        r"""Return s (m) at angles (rad), :math:`[r \sqrt{r^2 + b^2} + b^2 \sinh^{-1}(r / b)] / 2b` from the start."""
        b = self.radius_m_per_rad

        def antiderivative(r: NDArray[np.float64]) -> NDArray[np.float64]:
            return (r * np.hypot(r, b) + b**2 * np.arcsinh(r / b)) / (2.0 * b)

        return antiderivative(self.start_radius_m + b * angle) - antiderivative(np.asarray(self.start_radius_m))

    def _angle(self, length: NDArray[np.float64]) -> NDArray[np.float64]:
        """Invert the arc length: s is convex in the angle, so Newton's method from the end falls to the root."""
        b = self.radius_m_per_rad
        angle = np.full_like(length, self.end_angle_rad)
        for _ in range(100):
            step = (self.arc_length(angle) - length) / np.hypot(self.start_radius_m + b * angle, b)
            angle -= step
            if np.abs(step).max() <= 1e-13 * self.end_angle_rad:
                break
        return angle

    def reference(self, period_s: float, n_samples: int) -> Reference:
        """Return an (n_samples, 6) array: position, velocity and acceleration of x, then those of y."""
        total = float(self.arc_length(np.asarray(self.end_angle_rad)))
        move = JerkLimitedMoves(
            stops_m=(0.0, total),
            velocity_m_per_s=self.velocity_m_per_s,
            acceleration_m_per_s2=self.acceleration_m_per_s2,
            jerk_m_per_s3=self.jerk_m_per_s3,
            dwell_s=period_s * n_samples,
        )
        length, speed, acceleration = move.reference(period_s, n_samples).T
        theta, b = self._angle(length), self.radius_m_per_rad
        r = self.start_radius_m + b * theta
        steepness = np.hypot(r, b)
        rate = speed / steepness
        second_rate = (acceleration - r * b / steepness * rate**2) / steepness
        sine, cosine = np.sin(theta), np.cos(theta)
        along_x, along_y = b * cosine - r * sine, b * sine + r * cosine
        return np.column_stack(
            (
                r * cosine - self.start_radius_m,
                along_x * rate,
                along_x * second_rate - (r * cosine + 2.0 * b * sine) * rate**2,
                r * sine,
                along_y * rate,
                along_y * second_rate + (2.0 * b * cosine - r * sine) * rate**2,
            )
        )
