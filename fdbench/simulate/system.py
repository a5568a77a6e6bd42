"""What a system is: something that starts from seeds and advances lanes of instances by samples."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect
from fdbench.errors import SpecError
from fdbench.motions import Motion
from fdbench.specification import bounded, check_bounds, nonnegative, positive

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Clock of a simulation: the controller acts and the logger writes once each sampling time.

    Parameters
    ----------
    sampling_time_s, duration_s : float
    substeps : int
        Integration substeps in one sampling time.
    """

    sampling_time_s: float = positive()
    duration_s: float = positive()
    substeps: int = bounded(1, 10000)

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.n_samples < 3:
            raise SpecError(
                f"duration_s: {self.duration_s:g} s hold fewer than 3 samples of {self.sampling_time_s:g} s."
            )

    @property
    def substep_s(self) -> float:
        """Integration substep."""
        return self.sampling_time_s / self.substeps

    @property
    def n_samples(self) -> int:
        """Number of samples of one episode."""
        return round(self.duration_s / self.sampling_time_s)


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviations of white noises, each drawn once a sample.

    The equation noise is added to the true velocity at the end of each sample; the others to readings only. A stage of
    two axes has the noises x and y in place of the table's.
    """

    motor_position_m: float = nonnegative(default=0.0)
    table_position_m: float = nonnegative(default=0.0)
    x_position_m: float = nonnegative(default=0.0)
    y_position_m: float = nonnegative(default=0.0)
    velocity_m_per_s: float = nonnegative(default=0.0)
    motor_current_A: float = nonnegative(default=0.0)
    displacement_m: float = nonnegative(default=0.0)
    acceleration_m_per_s2: float = nonnegative(default=0.0)
    force_N: float = nonnegative(default=0.0)
    equation_velocity_m_per_s: float = nonnegative(default=0.0)

    def __post_init__(self) -> None:
        check_bounds(self)

    def check_only(self, names: Collection[str], plant: str) -> None:
        """Raise a SpecError for a noise other than ``names``, those of the readings that ``plant`` has."""
        for field_ in fields(self):
            if field_.name not in names and getattr(self, field_.name) != 0.0:
                raise SpecError(
                    f"reality.noise.{field_.name}: {plant} has no such reading. Allowed: {', '.join(sorted(names))}."
                )


@dataclass(frozen=True, kw_only=True)
class Setup:
    """How a plant is moved, disturbed and measured."""

    timing: Timing
    motion: Motion
    noise: Noise = field(default_factory=Noise)
    unmodelled: tuple[Effect, ...] = ()


@dataclass(frozen=True, eq=False)
class Sampled(Motion):
    """A motion that is known sample by sample, as one that was recorded.

    Parameters
    ----------
    samples : (n_samples, 3) array
        Position (m), velocity (m/s) and acceleration (m/s^2).
    """

    samples: FloatArray

    def reference(self, period_s: float, n_samples: int) -> FloatArray:
        """Return the samples."""
        if len(self.samples) != n_samples:
            raise SpecError(f"motion: {len(self.samples)} samples are known, {n_samples} are asked for.")
        return self.samples


class System(ABC):
    """Instances of a plant, stepped together; the last axis of every array is the lane.

    Attributes
    ----------
    columns : tuple of str
        What a logger would write, without ``time_s``.
    truth_columns : tuple of str
        What only a simulation knows; ``diverged`` is 1 once a lane has left the limits of the plant.
    commanded : mapping of str to (n_samples,) array
        Columns that are known before the run, such as ``reference_position_m``.
    action_names : tuple of str
        The commands that an action deviates from, with their units; most systems have one.
    limits : mapping of str to float
        Largest magnitude, within the limits of the plant, of every commanded and logged column.
    at_rest : (n_columns,) array
        What a logger would write before the first sample.
    """

    columns: tuple[str, ...]
    truth_columns: tuple[str, ...]
    commanded: Mapping[str, FloatArray]
    action_names: tuple[str, ...]
    limits: Mapping[str, float]
    at_rest: FloatArray
    n_lanes: int
    n_samples: int

    @abstractmethod
    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp] | None = None) -> None:
        """Put ``lanes`` (default: all) back to their initial state, each with its own seed."""

    @abstractmethod
    def advance(self, n_samples: int, action: FloatArray | None = None) -> FloatArray:
        """Advance all lanes and return an (n_samples, n_columns + n_truth_columns, n_lanes) array.

        ``action`` is the deviation from the scenario's own command, held over the call: (n_lanes,), which goes to every
        command of the system, or (n_actions, n_lanes) for a system of several actions.
        """

    def advance_one(self, action: float) -> FloatArray:
        """Advance a system of one lane by one sample and return its new (n_columns + n_truth_columns,) row."""
        return self.advance(1, np.array([action])).ravel()

    @property
    @abstractmethod
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes have left the limits of the plant; shape (n_lanes,)."""
