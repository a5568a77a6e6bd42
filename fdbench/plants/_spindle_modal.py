"""Modes that one force excites: their state-space form, and lanes of them as they are simulated."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.effects import Effect, Port
from fdbench.errors import SpecError, did_you_mean
from fdbench.simulate.exponential import exponential
from fdbench.simulate.random import stream
from fdbench.simulate.system import FloatArray, Setup, System
from fdbench.specification import bounded, check_bounds, positive

TWO_PI = 2.0 * np.pi
CHUNK = 256  # samples advanced, and random numbers drawn, at once
ACTIONS = ("force_N", "feedrate_m_per_s")


@final
@dataclass(frozen=True, kw_only=True)
class Mode:
    r"""One mode of a compliance, :math:`\alpha / (s^2 + 2 \zeta \omega s + \omega^2)`.

    As states it has the displacement and the velocity over omega, both in m:

    .. math::
        \dot x = \begin{pmatrix} 0 & \omega \\ -\omega & -2 \zeta \omega \end{pmatrix} x
                 + \begin{pmatrix} 0 \\ \alpha / \omega \end{pmatrix} F

    Parameters
    ----------
    frequency_Hz : float
        :math:`\omega / 2 \pi`.
    damping_ratio : float
        :math:`\zeta`.
    modal_gain_per_kg : float
        :math:`\alpha`.
    """

    frequency_Hz: float = positive()
    damping_ratio: float = bounded(0.0, 1.0)
    modal_gain_per_kg: float = bounded(-1e9, 1e9)

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def angular_frequency_rad_per_s(self) -> float:
        """The frequency in rad/s."""
        return TWO_PI * self.frequency_Hz

    @property
    def compliance_m_per_N(self) -> float:
        """Static compliance."""
        return self.modal_gain_per_kg / self.angular_frequency_rad_per_s**2

    @property
    def pair(self) -> FloatArray:
        """The state matrix and, as third column, the input of the force; (2, 3)."""
        w = self.angular_frequency_rad_per_s
        return np.array([[0.0, w, 0.0], [-w, -2.0 * self.damping_ratio * w, self.modal_gain_per_kg / w]])


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


def joined(pairs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the state matrix (2 n, 2 n) and the force input (2 n,) of pairs of states, (n, 2, 3)."""
    n = len(pairs)
    A = np.zeros((2 * n, 2 * n))
    for index, pair in enumerate(pairs):
        A[2 * index : 2 * index + 2, 2 * index : 2 * index + 2] = pair[:, :2]
    return A, pairs[:, :, 2].ravel()


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
        for k in range(force.shape[0] // substeps):
            for step in range(substeps):
                for i in range(force.shape[1]):
                    row = first[i] + k
                    t = row * period + (step + 0.5) * h
                    result = kernel(t, h, reference[row, 0], reference[row, 1] + feed[i], 0.0, *values)
                    force[k * substeps + step, i] += result[0]

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
                    diverged[i] = 1.0
        out[k, n_outputs] = 0.0
        for i in range(out.shape[2]):
            if not abs(feedrate[k, i]) <= feedrate_limit:
                diverged[i] = 1.0
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
            out[k, n_outputs + 1, i] = diverged[i]


class ReadingNoise:
    """White noise on several readings of every lane: one stream for each seed and reading.

    However the samples are split into draws, a lane gets the same numbers.
    """

    def __init__(self, deviations: Mapping[str, float], n_lanes: int) -> None:
        self._deviations = deviations
        self._n_lanes = n_lanes
        self._generators: list[list[np.random.Generator | None]] = [[] for _ in range(n_lanes)]
        self._numbers = np.zeros((CHUNK, len(deviations), n_lanes))
        self._position = CHUNK

    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp]) -> None:
        """Begin the streams of some lanes."""
        for lane, seed in zip(lanes.tolist(), seeds, strict=True):
            self._generators[lane] = [
                stream(seed, f"{name}_noise") if deviation > 0.0 else None
                for name, deviation in self._deviations.items()
            ]
            self._fill(lane, self._position)

    def _fill(self, lane: int, first: int) -> None:
        pairs = zip(self._generators[lane], self._deviations.values(), strict=True)
        for reading, (generator, deviation) in enumerate(pairs):
            if generator is not None:
                self._numbers[first:, reading, lane] = deviation * generator.standard_normal(CHUNK - first)

    def draw(self, n_samples: int) -> FloatArray:
        """Return the noise of the next samples, at most `CHUNK`, (n_samples, n_readings, n_lanes)."""
        if self._position == CHUNK:
            self._refill()
        head = self._numbers[self._position : self._position + n_samples].copy()
        self._position += len(head)
        if len(head) == n_samples:
            return head
        self._refill()
        self._position = n_samples - len(head)
        return np.concatenate((head, self._numbers[: self._position]))

    def _refill(self) -> None:
        for lane in range(self._n_lanes):
            self._fill(lane, 0)
        self._position = 0


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
        If an effect is no force on the table, is random or has hidden states.
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
        self.n_lanes, self.n_samples = n_lanes, timing.n_samples
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
        self._noise = ReadingNoise({name: deviations[name] for name in outputs}, n_lanes)
        self._state = np.zeros((2 * len(pairs), n_lanes))
        self._count = np.zeros(n_lanes, dtype=np.intp)
        self._diverged = np.zeros(n_lanes)

    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp] | None = None) -> None:
        """Put lanes back to rest, each with its own seed."""
        chosen = np.arange(self.n_lanes) if lanes is None else lanes
        if len(seeds) != len(chosen):
            raise SpecError(f"seeds: {len(chosen)} are expected, one for each lane, found {len(seeds)}.")
        self._noise.start(seeds, chosen)
        self._state[:, chosen] = 0.0
        self._count[chosen] = 0
        self._diverged[chosen] = 0.0

    def advance(self, n_samples: int, action: FloatArray | None = None) -> FloatArray:
        """Advance all lanes; see `System.advance`."""
        if int(self._count.max()) + n_samples > self.n_samples:
            raise SpecError(f"advance: the episode ends after {self.n_samples} samples; start the lanes again.")
        held = np.zeros(self.n_lanes) if action is None else np.asarray(action, dtype=np.float64)
        parts = [min(CHUNK, n_samples - done) for done in range(0, n_samples, CHUNK)]
        return np.concatenate([self._advance(part, held) for part in parts])

    def _advance(self, n_samples: int, action: FloatArray) -> FloatArray:
        still = np.zeros(self.n_lanes)
        extra, feed = (action, still) if self.action_names == ("force_N",) else (still, action)
        substeps, period = self._timing.substeps, self._timing.sampling_time_s
        force = np.empty((n_samples * substeps, self.n_lanes))
        force[:] = extra
        for add_force, values in self._effects:
            add_force(values, self._count, substeps, period, self._reference, feed, force)
        feedrate = self._reference[self._count + np.arange(n_samples)[:, None], 1] + feed
        n = len(self._outputs)
        raw = np.empty((n_samples, n + 2, self.n_lanes))
        limits = self._bounds, feedrate, self.limits["feedrate_m_per_s"]
        advance(self._state, self._flow, self._outputs, *limits, force, self._diverged, raw)
        raw[:, :n] += self._noise.draw(n_samples)
        self._count += n_samples
        rows = np.empty((n_samples, n + 4, self.n_lanes))
        rows[:, 0], rows[:, 1], rows[:, 2:] = self._displacement, feedrate, raw
        return rows

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes have left the limits of the outputs or of the feedrate."""
        flags: NDArray[np.bool_] = self._diverged > 0.5
        return flags


def _forces(effects: Sequence[Effect]) -> list[tuple[Callable[..., None], tuple[float, ...]]]:
    """Return the adder and the parameters of each effect."""
    for effect in effects:
        if effect.port is not Port.TABLE_FORCE or effect.random or effect.states:
            raise SpecError(
                f"reality.effects: {effect.name} acts on a feed drive's {effect.port.value}"
                f"{' with hidden states' if effect.states else ''}; a spindle takes forces on the table that depend on "
                "time and feedrate alone."
            )
    return [(adder(type(effect).kernel), effect.values()) for effect in effects]
