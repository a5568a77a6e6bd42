"""Rest-to-rest moves with limited velocity, acceleration and jerk, separated by dwells."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.motions._motion import Motion, Reference
from fdbench.specification import nonnegative, positive


@final
@dataclass(frozen=True, kw_only=True)
class JerkLimitedMoves(Motion):
    r"""Seven-segment moves through a list of stops; the list is repeated until the end.

    For a distance D the move reaches the largest speed and acceleration that its limits V, A, J allow: jerk phases
    last :math:`t_j = A/J`, constant acceleration :math:`t_a = V/A - t_j`, cruise :math:`t_v = D/V - t_a - 2 t_j`, with
    A and V lowered where a time would be negative. The axis starts at the first stop.

    Source: Biagiotti, Melchiorri, Trajectory Planning for Automatic Machines and Robots (2008), section 3.4.

    Examples
    --------
    A 10 mm move at 80 mm/s, 8 m/s^2 and 1000 m/s^3 lasts 143 ms: four jerk phases of 8 ms, two of 2 ms at constant
    acceleration, 107 ms of cruise.

    >>> limits = dict(velocity_m_per_s=0.08, acceleration_m_per_s2=8.0, jerk_m_per_s3=1000.0)
    >>> round(move_time(0.01, *limits.values()), 9)
    0.143
    """

    stops_m: tuple[float, ...]
    velocity_m_per_s: float = positive()
    acceleration_m_per_s2: float = positive()
    jerk_m_per_s3: float = positive()
    dwell_s: float = nonnegative()
    initial_dwell_s: float = nonnegative(default=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.stops_m:
            raise SpecError("stops_m: the list is empty; at least one stop is needed.")

    def reference(self, period_s: float, n_samples: int) -> Reference:
        """Return the (n_samples, 3) reference."""
        time = np.arange(n_samples, dtype=np.float64) * period_s
        result = np.zeros((n_samples, 3))
        here = self.stops_m[0]
        result[:, 0] = here
        start = self.initial_dwell_s
        index = 1
        while start < time[-1] and len(self.stops_m) > 1:
            there = self.stops_m[index % len(self.stops_m)]
            index += 1
            duration = move_time(
                abs(there - here), self.velocity_m_per_s, self.acceleration_m_per_s2, self.jerk_m_per_s3
            )
            later = time >= start
            result[later] = self._move(here, there, time[later] - start)
            start += duration + self.dwell_s
            here = there
            if duration + self.dwell_s == 0.0:
                break
        return result

    def _move(self, here: float, there: float, time: NDArray[np.float64]) -> Reference:
        distance = abs(there - here)
        jerk = self.jerk_m_per_s3
        t_j, t_a, t_v = segments(distance, self.velocity_m_per_s, self.acceleration_m_per_s2, jerk)
        durations = (t_j, t_a, t_j, t_v, t_j, t_a, t_j)
        jerks = (jerk, 0.0, -jerk, 0.0, -jerk, 0.0, jerk)
        result = np.zeros((len(time), 3))
        x = v = a = begin = 0.0
        for duration, j in zip(durations, jerks, strict=True):
            inside = time >= begin
            s = np.minimum(time[inside] - begin, duration)
            result[inside, 0] = x + s * (v + s * (a / 2.0 + s * j / 6.0))
            result[inside, 1] = v + s * (a + s * j / 2.0)
            result[inside, 2] = a + s * j
            x += duration * (v + duration * (a / 2.0 + duration * j / 6.0))
            v += duration * (a + duration * j / 2.0)
            a += duration * j
            begin += duration
        result[time >= begin] = (distance, 0.0, 0.0)
        result *= math.copysign(1.0, there - here)
        result[:, 0] += here
        return result


def segments(distance: float, velocity: float, acceleration: float, jerk: float) -> tuple[float, float, float]:
    """Return the durations of a jerk phase, of constant acceleration and of cruise."""
    if velocity * jerk < acceleration**2:
        acceleration = math.sqrt(velocity * jerk)
    t_j = acceleration / jerk
    t_a = velocity / acceleration - t_j
    t_v = distance / velocity - t_a - 2.0 * t_j
    if t_v < 0.0:
        t_v = 0.0
        t_a = 0.5 * (math.sqrt(t_j**2 + 4.0 * distance / acceleration) - 3.0 * t_j)
        if t_a < 0.0:
            t_a = 0.0
            t_j = (distance / (2.0 * jerk)) ** (1.0 / 3.0)
    return t_j, t_a, t_v


def move_time(distance: float, velocity: float, acceleration: float, jerk: float) -> float:
    """Return how long a rest-to-rest move lasts, s."""
    t_j, t_a, t_v = segments(distance, velocity, acceleration, jerk)
    return 4.0 * t_j + 2.0 * t_a + t_v
