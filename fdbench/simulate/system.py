"""What a system is: something that starts from seeds and advances lanes of instances by samples."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect, Port
from fdbench.errors import SpecError
from fdbench.motions import Motion
from fdbench.simulate.random import CHUNK, RandomNumbers
from fdbench.simulate.start import Start
from fdbench.specification import bounded, check_bounds, nonnegative, positive

FloatArray = NDArray[np.float64]

MOST_SAMPLES, MOST_SUBSTEPS = 10**7, 10**9  # of an episode


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
        if self.n_samples > MOST_SAMPLES or self.n_samples * self.substeps > MOST_SUBSTEPS:
            raise SpecError(
                f"duration_s: {self.duration_s:g} s are {self.n_samples:.3g} samples of {self.substeps} substeps; at "
                f"most {MOST_SAMPLES:.0e} samples and {MOST_SUBSTEPS:.0e} substeps are simulated."
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
    two axes has the noises x and y in place of the table's. Those of the positions of a feed drive pass the effects of
    its encoders where they are ``through_encoders``, as the noise of a scanning head does, so that what is read lies on
    the grid of the encoder; else they are added to what it reads.
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
    through_encoders: bool = False

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
    """How a plant is moved, disturbed and measured, and where it begins."""

    timing: Timing
    motion: Motion
    noise: Noise = field(default_factory=Noise)
    unmodelled: tuple[Effect, ...] = ()
    start: Start = field(default_factory=Start)

    def reference(self) -> FloatArray:
        """Return the motion before the start displaces it, (n_samples, 3 n_axes); for plants that have one."""
        return self.motion.reference(self.timing.sampling_time_s, self.timing.n_samples)


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

    Seeds, random numbers, the end of an episode and the flag of a lane that has diverged are here; a subclass says how
    lanes are reset and advanced.

    Parameters
    ----------
    n_lanes, n_samples : int
        Instances, and samples of an episode.
    random : RandomNumbers, optional
        What the lanes draw; a call of `_advance` never needs more of it than one chunk holds.

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

    def __init__(self, n_lanes: int, n_samples: int, random: RandomNumbers | None = None) -> None:
        self.n_lanes, self.n_samples, self._random = n_lanes, n_samples, random
        self._diverged = np.zeros(n_lanes, dtype=np.bool_)
        # Samples that were advanced so far; of each lane those at which its episode ends, and the first of these.
        self._clock, self._ends, self._end = 0, np.zeros(n_lanes, dtype=np.intp), 0

    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp] | None = None) -> None:
        """Put ``lanes`` (default: all) back to their initial state, each with its own seed.

        Raises
        ------
        SpecError
            If there is not one seed for each lane.
        """
        chosen = np.arange(self.n_lanes) if lanes is None else np.asarray(lanes)
        if len(seeds) != len(chosen):
            raise SpecError(f"seeds: {len(chosen)} are expected, one for each lane, found {len(seeds)}.")
        if self._random is not None:
            self._random.start(seeds, chosen)
        self._diverged[chosen] = False
        self._reset(chosen, seeds)
        self._ends[chosen] = self._clock + self.n_samples
        self._end = int(self._ends.min())

    def advance(self, n_samples: int, action: FloatArray | None = None) -> FloatArray:
        """Advance all lanes and return an (n_samples, n_columns + n_truth_columns, n_lanes) array.

        ``action`` is the deviation from the scenario's own command, held over the call: (n_lanes,), which goes to every
        command of the system, or (n_actions, n_lanes) for a system of several actions.

        Raises
        ------
        SpecError
            If the episode of a lane ends before.
        """
        self._check_end(n_samples)
        self._act(action)
        rows, done = np.empty((n_samples, len(self.columns) + len(self.truth_columns), self.n_lanes)), 0
        while done < n_samples:
            n = self._next_numbers(n_samples - done)
            self._advance(rows[done : done + n])
            self._pass(n)
            done += n
        return rows

    def advance_one(self, action: float) -> tuple[FloatArray, Sequence[float]]:
        """Advance a system of one lane by one sample.

        Returns
        -------
        logged : (n_columns,) array
            A new one.
        row : sequence of float
            The same, and behind it what only a simulation knows.
        """
        row = self.advance(1, np.array([action])).ravel()
        return row[: len(self.columns)], row.tolist()

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes have left the limits of the plant; shape (n_lanes,)."""
        return self._diverged.copy()

    @abstractmethod
    def _reset(self, lanes: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Put lanes back to their initial state."""

    @abstractmethod
    def _act(self, action: FloatArray | None) -> None:
        """Keep the action of what follows; None is none."""

    @abstractmethod
    def _advance(self, rows: FloatArray) -> None:
        """Advance all lanes and write their rows, with the random numbers from ``self._random.position`` on."""

    def _check_end(self, n_samples: int) -> None:
        if self._clock + n_samples > self._end:
            known = (
                "the lanes have not been started"
                if not self._end
                else f"the episode ends after {self.n_samples} samples"
            )
            raise SpecError(f"advance: {known}; start {'the lanes again' if self._end else 'them'}.")

    def _next_numbers(self, n_samples: int) -> int:
        """Return for how many of the next samples there are random numbers, a new chunk being drawn where needed."""
        if self._random is None:
            return n_samples
        if self._random.position == CHUNK:
            self._random.refill()
        return min(n_samples, CHUNK - self._random.position)

    def _pass(self, n_samples: int) -> None:
        """Let time pass."""
        self._clock += n_samples
        if self._random is not None:
            self._random.position += n_samples


def check_table_forces(effects: Sequence[Effect], plant: str, *, states: bool = False) -> None:
    """Raise a SpecError for an effect that is no force on the table, is random or, unless ``states``, has some."""
    for effect in effects:
        stateful = bool(effect.states) and not states
        if effect.port is not Port.TABLE_FORCE or effect.random or stateful:
            kind = f"{' at random' if effect.random else ''}{' with internal states' if stateful else ''}"
            raise SpecError(
                f"reality.effects: {effect.name} acts on a feed drive's {effect.port.value}{kind}; {plant} takes "
                f"forces on the table{'' if states else ' without internal states'} only."
            )
