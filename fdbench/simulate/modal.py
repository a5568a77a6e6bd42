"""Modes that one force excites, as they are simulated: pairs of states that advance exactly."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.effects import Effect
from fdbench.errors import SpecError, did_you_mean
from fdbench.simulate.exponential import exponential
from fdbench.simulate.random import RandomNumbers, RandomSource
from fdbench.simulate.system import FloatArray, Setup, System, check_table_forces

ACTIONS = ("force_N", "feedrate_m_per_s")


@dataclass(frozen=True, kw_only=True)
class Commanded:
    """What the lanes of a `ModalSystem` are asked for.

    Attributes
    ----------
    action : str
        What an action adds to: ``force_N``, an extra force, or ``feedrate_m_per_s``, the feed.
    reference_displacement_m : float
        Displacement that an adaptive control holds.
    feedrate_limit_m_per_s : float
    """

    action: str
    reference_displacement_m: float
    feedrate_limit_m_per_s: float

    def __post_init__(self) -> None:
        if self.action not in ACTIONS:
            raise SpecError(f"action: unknown action '{self.action}'.{did_you_mean(self.action, ACTIONS)}")


def flows(pairs: FloatArray, h: float) -> FloatArray:
    """Return the exact flow of each pair over h under a constant force, (n, 2, 3)."""
    generators = np.zeros((len(pairs), 3, 3))
    generators[:, :2] = pairs
    return np.stack([exponential(generator * h)[:2] for generator in generators])


@lru_cache(maxsize=64)
def adder(kernel: Any) -> Callable[..., None]:
    """Return a function that adds the force of an effect, given its kernel."""

    @njit(error_model="numpy")
    def add_force(values, first, substeps, period, reference, feed, force):  # type: ignore[no-untyped-def]
        """Add to ``force``, (n_samples * substeps, n_lanes), at the middle of each substep.

        ``first`` is the sample with which each lane goes on, ``feed`` the deviation from the commanded feedrate.
        """
        h = period / substeps
        n_lanes, others = force.shape[1], 0
        start, x, v = np.empty(n_lanes), np.empty(n_lanes), np.empty(n_lanes)
        for i in range(n_lanes):
            others += 1 if first[i] != first[0] else 0
        for k in range(force.shape[0] // substeps):
            for i in range(n_lanes):
                row = first[i] + k
                start[i], x[i], v[i] = row * period, reference[row, 0], reference[row, 1] + feed[i]
            for step in range(substeps):
                f = force[k * substeps + step]
                if others == 0:  # what follows from the time is then computed once for all lanes
                    t, position = start[0] + (step + 0.5) * h, x[0]
                    for i in range(n_lanes):
                        f[i] += kernel(t, h, position, v[i], 0.0, *values)[0]
                else:
                    for i in range(n_lanes):
                        f[i] += kernel(start[i] + (step + 0.5) * h, h, x[i], v[i], 0.0, *values)[0]

    return add_force


@kept
@njit(error_model="numpy")
def advance(state, flow, outputs, limits, feedrate, feedrate_limit, force, diverged, out):  # type: ignore[no-untyped-def]
    """Advance every lane; lanes are innermost, so that each has the bits of a single one.

    Parameters
    ----------
    state : (2 n, n_lanes) array, changed in place
    flow : (n, 2, 3) array
        Of `flows`.
    outputs : (n_outputs, 2 n) array
    limits : (n_outputs,) array
        Magnitudes of the outputs beyond which a lane has diverged.
    feedrate : (n_samples, n_lanes) array
        Its magnitude is limited too.
    force : (n_samples * substeps, n_lanes) array
    diverged : (n_lanes,) array, changed in place
    out : (n_samples, n_outputs + 2, n_lanes) array, written
        Outputs at the beginning of each sample, mean force over it, 1 where the lane has diverged by its end.
    """
    n_outputs, n_states = outputs.shape
    substeps = force.shape[0] // out.shape[0]
    for k in range(out.shape[0]):
        for row in range(n_outputs):
            out[k, row] = 0.0
            for j in range(n_states):
                for i in range(out.shape[2]):
                    out[k, row, i] += outputs[row, j] * state[j, i]
            for i in range(out.shape[2]):
                if not abs(out[k, row, i]) <= limits[row]:
                    diverged[i] = True
        out[k, n_outputs] = 0.0
        for i in range(out.shape[2]):
            if not abs(feedrate[k, i]) <= feedrate_limit:
                diverged[i] = True
        for step in range(substeps):
            f = force[k * substeps + step]
            for pair in range(flow.shape[0]):
                a, b = state[2 * pair], state[2 * pair + 1]
                for i in range(out.shape[2]):
                    first = flow[pair, 0, 0] * a[i] + flow[pair, 0, 1] * b[i] + flow[pair, 0, 2] * f[i]
                    b[i] = flow[pair, 1, 0] * a[i] + flow[pair, 1, 1] * b[i] + flow[pair, 1, 2] * f[i]
                    a[i] = first
            for i in range(out.shape[2]):
                out[k, n_outputs, i] += f[i]
        for i in range(out.shape[2]):
            out[k, n_outputs, i] /= substeps
            out[k, n_outputs + 1, i] = 1.0 if diverged[i] else 0.0


class ModalSystem(System):
    """Lanes of pairs of states that one force drives, from rest.

    The force is the sum of the effects at the commanded feedrate, and of the action where that is a force; it is held
    over each substep, over which the states advance exactly.

    Parameters
    ----------
    pairs : (n, 2, 3) array
        State matrix and force input of each pair.
    outputs : mapping of str to (2 n,) array
        Columns that are read.
    limits : mapping of str to float
        Largest magnitude of each.
    deviations : mapping of str to float
        Standard deviation of the white noise of each.
    commanded : Commanded
    setup : Setup
    n_lanes : int

    Raises
    ------
    SpecError
        If an effect is no force on the table, is random or has internal states.
    """

    truth_columns = ("disturbance_N", "diverged")

    def __init__(
        self,
        pairs: FloatArray,
        outputs: Mapping[str, FloatArray],
        limits: Mapping[str, float],
        deviations: Mapping[str, float],
        commanded: Commanded,
        setup: Setup,
        n_lanes: int = 1,
    ) -> None:
        timing = setup.timing
        self._deviations = np.array([deviations[name] for name in outputs])
        noisy = [(n, name) for n, name in enumerate(outputs) if deviations[name] > 0.0]
        sources = [RandomSource(stream=f"{name}_noise", column=n) for n, name in noisy]
        self._numbers = RandomNumbers(sources, n_lanes, n_lanes, len(outputs))
        super().__init__(n_lanes, timing.n_samples, self._numbers)
        self.columns = ("reference_displacement_m", "feedrate_m_per_s", *outputs)
        self.action_names = (commanded.action,)
        self._effects = tuple(_forces(setup.unmodelled))
        self._reference = np.ascontiguousarray(setup.motion.reference(timing.sampling_time_s, self.n_samples))
        self._displacement = commanded.reference_displacement_m
        self.commanded = {"reference_displacement_m": np.full(self.n_samples, self._displacement)}
        self.limits = {
            "reference_displacement_m": limits["displacement_m"],
            "feedrate_m_per_s": commanded.feedrate_limit_m_per_s,
            **limits,
        }
        self.at_rest = np.zeros(len(self.columns))
        self.at_rest[:2] = self._displacement, self._reference[0, 1]
        self._timing = timing
        self._flow = flows(pairs, timing.sampling_time_s / timing.substeps)
        self._outputs = np.stack(list(outputs.values()))
        self._bounds = np.array([limits[name] for name in outputs])
        self._state = np.zeros((2 * len(pairs), n_lanes))
        self._count = np.zeros(n_lanes, dtype=np.intp)

    def _reset(self, lanes: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Put lanes back to rest."""
        self._state[:, lanes] = 0.0
        self._count[lanes] = 0

    def _act(self, action: FloatArray | None) -> None:
        self._action = np.zeros(self.n_lanes) if action is None else np.asarray(action, dtype=np.float64)

    def _advance(self, rows: FloatArray) -> None:
        n_samples, still = len(rows), np.zeros(self.n_lanes)
        extra, feed = (self._action, still) if self.action_names == ("force_N",) else (still, self._action)
        substeps, period = self._timing.substeps, self._timing.sampling_time_s
        force = np.empty((n_samples * substeps, self.n_lanes))
        force[:] = extra
        for add_force, values in self._effects:
            add_force(values, self._count, substeps, period, self._reference, feed, force)
        feedrate = self._reference[self._count + np.arange(n_samples)[:, None], 1] + feed
        n, first = len(self._outputs), self._numbers.position
        raw = np.empty((n_samples, n + 2, self.n_lanes))
        limits = self._bounds, feedrate, self.limits["feedrate_m_per_s"]
        advance(self._state, self._flow, self._outputs, *limits, force, self._diverged, raw)
        raw[:, :n] += self._deviations[:, None] * self._numbers.normal[0, first : first + n_samples]
        self._count += n_samples
        rows[:, 0], rows[:, 1], rows[:, 2:] = self._displacement, feedrate, raw


def _forces(effects: Sequence[Effect]) -> list[tuple[Callable[..., None], tuple[float, ...]]]:
    """Return the adder and the parameters of each effect."""
    check_table_forces(effects, "a spindle")
    return [(adder(type(effect).kernel), effect.values()) for effect in effects]
