"""Spindle testbed as it is simulated and logged: lanes that go through a plan of measurements."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from fdbench.simulate.random import stream
from fdbench.simulate.spectra import lines, signals
from fdbench.simulate.system import FloatArray, Setup, System

TWO_PI = 2.0 * np.pi


class VibratingMachine(Protocol):
    """What vibrates under the force; its signals at a constant speed are free of noise."""

    @property
    def angle_jitter_rad(self) -> float:
        """Standard deviation over the conditions of where the trigger starts."""
        ...

    @property
    def force_deviation(self) -> float:
        """Standard deviation over the conditions of the force, relative to its level."""
        ...

    def condition(
        self, speed: float, share: float, level: float, angle: float, cage_angle: float, step_s: float, n: int
    ) -> FloatArray:
        """Return force (N) and acceleration (m/s^2) of one operating condition, (2, n)."""
        ...


class Plan(NamedTuple):
    """All force levels at each speed, slowest speed and lowest level first; each condition lasts for some segments.

    Attributes
    ----------
    speeds_rad_per_s, levels_N : (n_speeds,), (n_levels,) arrays
    segments_per_condition, samples_per_segment, n_lines : int
        Lines are the bins of a segment's spectrum that are logged, without the mean.
    """

    speeds_rad_per_s: FloatArray
    levels_N: FloatArray
    segments_per_condition: int
    samples_per_segment: int
    n_lines: int

    @property
    def samples_per_condition(self) -> int:
        """Number of logged samples at one speed and force level."""
        return self.segments_per_condition * self.samples_per_segment

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of speeds, levels and segments in a condition."""
        return len(self.speeds_rad_per_s), len(self.levels_N), self.segments_per_condition


Mask = Callable[[Plan, np.random.Generator], NDArray[np.bool_]]


class _Lane:
    """Random numbers of one run through the plan."""

    def __init__(self, machine: VibratingMachine, plan: Plan, mask: Mask, seed: int) -> None:
        n = plan.shape[0] * plan.shape[1]
        self.withheld = mask(plan, stream(seed, "withheld_segments")).reshape(n, -1)
        self.force_factor = 1.0 + machine.force_deviation * stream(seed, "force_level").standard_normal(n)
        self.angle = machine.angle_jitter_rad * stream(seed, "trigger_angle").standard_normal(n)
        self.cage_angle = stream(seed, "cage_angle").uniform(0.0, TWO_PI, n)
        self.noise = stream(seed, "force_noise"), stream(seed, "acceleration_noise")


class SpindleTestbedSystem(System):
    """Lanes of one testbed that go through the plan, condition by condition.

    An action is read at the first sample of a condition, when the gap of the magnets is set, and holds for all of it.
    Signals are acquired every substep; what is logged is each segment's part within the plan's lines, so that the
    logged samples have exactly the spectrum of the acquired ones.

    Parameters
    ----------
    machine : VibratingMachine
    plan : Plan
    mask : callable
        Which segments are withheld, from the plan and a random generator.
    limits : pair of float
        Ranges of the force sensor, N, and of the accelerometer, m/s^2.
    setup : Setup
    n_lanes : int
    """

    action_names = ("force_level_N",)
    columns = ("acceleration_m_per_s2", "force_N", "training_sample")
    truth_columns = ("disturbance_N", "diverged")

    def __init__(
        self,
        machine: VibratingMachine,
        plan: Plan,
        mask: Mask,
        limits: tuple[float, float],
        setup: Setup,
        n_lanes: int = 1,
    ) -> None:
        timing = setup.timing
        super().__init__(n_lanes, timing.n_samples)
        self.commanded = {
            "spindle_speed_rad_per_s": np.repeat(
                plan.speeds_rad_per_s, len(plan.levels_N) * plan.samples_per_condition
            ),
            "reference_acceleration_m_per_s2": np.zeros(self.n_samples),
        }
        self.limits = {
            "spindle_speed_rad_per_s": float(np.max(plan.speeds_rad_per_s)),
            "reference_acceleration_m_per_s2": limits[1],
            "acceleration_m_per_s2": limits[1],
            "force_N": limits[0],
            "training_sample": 1.0,
        }
        self.at_rest = np.zeros(len(self.columns))
        self._machine, self._plan, self._mask = machine, plan, mask
        self._step_s = timing.sampling_time_s / timing.substeps
        self._acquired = plan.samples_per_segment * timing.substeps
        self._noise = np.array([setup.noise.force_N, setup.noise.acceleration_m_per_s2])
        self._lanes: dict[int, _Lane] = {}
        self._every = np.arange(n_lanes)
        self._places = np.zeros(n_lanes, dtype=np.intp)  # samples that a lane has behind it
        n_rows = len(self.columns) + len(self.truth_columns)
        self._conditions = np.empty((n_lanes, plan.samples_per_condition, n_rows))  # rows of the present ones

    def _reset(self, lanes: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Put lanes back to the first condition and draw their random numbers."""
        for lane, seed in zip(lanes.tolist(), seeds, strict=True):
            self._lanes[lane] = _Lane(self._machine, self._plan, self._mask, seed)
        self._places[lanes] = 0

    def _act(self, action: FloatArray | None) -> None:
        self._deviations_N = np.zeros(self.n_lanes) if action is None else np.asarray(action, dtype=np.float64)

    def _advance(self, rows: FloatArray) -> None:
        done, length = 0, self._plan.samples_per_condition
        while done < len(rows):
            conditions, first = np.divmod(self._places, length)
            for number in np.flatnonzero(first == 0).tolist():
                deviation = float(self._deviations_N[number])
                lane, condition = self._lanes[number], int(conditions[number])
                self._conditions[number] = self._condition(lane, condition, deviation, number)
            taken = min(length - int(first.max()), len(rows) - done)
            found = self._conditions[self._every, first + np.arange(taken)[:, None]]
            rows[done : done + taken] = found.transpose(0, 2, 1)
            self._diverged[:] = found[-1, :, -1]
            self._places += taken
            done += taken

    def _condition(self, lane: _Lane, number: int, deviation: float, place: int) -> FloatArray:
        """Return all rows of one condition, (samples_per_condition, n_columns + n_truth_columns)."""
        plan, machine = self._plan, self._machine
        speed_number, level_number = divmod(number, len(plan.levels_N))
        speed = float(plan.speeds_rad_per_s[speed_number])
        level = float(plan.levels_N[level_number]) + deviation
        acquired = machine.condition(
            speed,
            speed / float(np.max(plan.speeds_rad_per_s)),
            level * float(lane.force_factor[number]),
            float(lane.angle[number]),
            float(lane.cage_angle[number]),
            self._step_s,
            plan.segments_per_condition * self._acquired,
        )
        clean = lines(acquired.reshape(2, plan.segments_per_condition, self._acquired), plan.n_lines)
        # White noise of deviation s in each of N samples has s sqrt(2/N) in each part of each line.
        share = self._noise * math.sqrt(2.0 / plan.samples_per_segment)
        noise = np.stack([generator.standard_normal(clean.shape[1:]) for generator in lane.noise])
        truth = signals(clean[0], plan.samples_per_segment)
        force, acceleration = signals(clean + share[:, None, None] * noise, plan.samples_per_segment)
        acceleration = acceleration.ravel()
        measured = np.repeat(~lane.withheld[number], plan.samples_per_segment)
        outside = (np.abs(acceleration) > self.limits["acceleration_m_per_s2"]) | (
            not 0.0 <= level <= self.limits["force_N"]
        )
        rows = np.empty((plan.samples_per_condition, len(self.columns) + len(self.truth_columns)))
        rows[:, 0] = acceleration
        rows[:, 1] = np.where(measured, force.ravel(), 0.0)
        rows[:, 2] = measured
        rows[:, 3] = truth.ravel()
        rows[:, 4] = np.logical_or.accumulate(outside) | self._diverged[place]
        return rows
