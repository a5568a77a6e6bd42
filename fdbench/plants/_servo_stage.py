"""What servo stages share: a linear response to the commanded position, its simulation, and its linear model."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect, Port
from fdbench.errors import SpecError
from fdbench.plants._linear_system import LinearSystem, continuous
from fdbench.plants._plant import LinearModel, Plant
from fdbench.plants._servo_stage_stepper import compose
from fdbench.record import Record
from fdbench.regression import Regression
from fdbench.simulate.axis import compiled
from fdbench.simulate.exponential import exponential
from fdbench.simulate.random import stream
from fdbench.simulate.system import FloatArray, Setup, System
from fdbench.specification import positive

CHUNK = 256  # samples of random numbers drawn at once


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    r"""One servo-controlled axis, :math:`\dot q = A q + B u + F f`, position :math:`C q`.

    u is the commanded position (m), f a force against positive motion (N).

    Attributes
    ----------
    A, B, F, C : (n, n), (n,), (n,), (n,) arrays
    table : (3, n + 2) array
        Position (m) and velocity (m/s) of the table and the servo's force on it (N), from q, u and the derivative of u:
        where effects act.
    """

    A: FloatArray
    B: FloatArray
    F: FloatArray
    C: FloatArray
    table: FloatArray

    @property
    def rest(self) -> FloatArray:
        """State (n,) at rest for a command of 1 m."""
        return np.asarray(-np.linalg.solve(self.A, self.B), dtype=np.float64)

    @property
    def compliance_m_per_N(self) -> float:
        """Steady change of the position for one newton against positive motion, negative."""
        return float(-self.C @ np.linalg.solve(self.A, self.F))

    def flow(self, h: float) -> FloatArray:
        """Return (n, n + 7): the state after h, from q, from u and three derivatives, from f and two derivatives."""
        n = len(self.B)
        generator = np.zeros((n + 7, n + 7))
        generator[:n, :n] = self.A
        generator[:n, n], generator[:n, n + 4] = self.B, self.F
        for place in (n, n + 1, n + 2, n + 4, n + 5):
            generator[place, place + 1] = 1.0
        after: FloatArray = exponential(generator * h)[:n]
        return after


@lru_cache(maxsize=32)
def flows(stage: "Stage", h: float) -> FloatArray:
    """Return the flows over h of all axes, (n_axes, n, n + 7)."""
    return np.stack([response.flow(h) for response in stage.axes().values()])


class StageSystem(System):
    """Lanes of one stage; every axis feels the same effects, each with hidden states of its own.

    Parameters
    ----------
    stage : Stage
    reference : (n_samples, 3 n_axes) array
        Commanded position, velocity and acceleration of each axis.
    period_s, substeps : sampling time, integration substeps in it
    deviations : (n_axes,) array
        Standard deviation of each reading, m.
    effects : sequence of Effect
    n_lanes : int
    """

    def __init__(
        self,
        stage: "Stage",
        reference: FloatArray,
        period_s: float,
        substeps: int,
        deviations: FloatArray,
        effects: Sequence[Effect] = (),
        n_lanes: int = 1,
    ) -> None:
        axes = stage.axes()
        prefixes, responses = list(axes), list(axes.values())
        self.action_names = tuple(f"{prefix}position_m" for prefix in prefixes)
        self.n_lanes, self.n_samples = n_lanes, len(reference)
        names = ("reference_position_m", "reference_velocity_m_per_s", "position_m")
        self.columns = tuple(prefix + name for prefix in prefixes for name in names)
        self.truth_columns = (*(f"{prefix}disturbance_N" for prefix in prefixes), "diverged")
        self.commanded = {
            prefix + name: reference[:, 3 * axis + place]
            for axis, prefix in enumerate(prefixes)
            for place, name in enumerate(names[:2])
        }
        travel, velocity = stage.travel_m, stage.velocity_limit_m_per_s
        self.limits = dict(zip(self.columns, (travel, velocity, travel) * len(axes), strict=True))
        start = reference[0].reshape(-1, 3)[:, [0, 1, 0]]
        start[:, 2] *= [response.C @ response.rest for response in responses]
        self.at_rest = start.ravel()
        self._kinds = tuple(type(effect) for effect in effects)
        self._streams = [f"{prefix or 'table_'}position_noise" for prefix in prefixes]
        full, half = flows(stage, period_s / substeps), flows(stage, period_s / substeps / 2.0)
        table = np.stack([response.table for response in responses])
        n = full.shape[1]
        self._settings = (
            full,
            half,
            np.stack([response.C for response in responses]),
            table,
            -np.einsum("ij,ij->i", table[:, 1, :n], half[:, :, n + 4]),
            np.array([travel, velocity]),
            deviations,
            np.ascontiguousarray(reference),
            period_s,
            substeps,
            np.array([value for effect in effects for value in effect.values()]),
        )
        self._rest = np.stack([response.rest for response in responses]) * start[:, :1]
        n_states = sum(len(kind.states) for kind in self._kinds)
        self._q = np.zeros((n_lanes, len(axes), n))
        self._forces = np.zeros((n_lanes, len(axes), 4))
        self._states = np.zeros((n_lanes, len(axes), n_states))
        self._count = np.zeros(n_lanes, dtype=np.intp)
        self._diverged = np.zeros(n_lanes, dtype=np.bool_)
        self._normal = np.zeros((n_lanes, CHUNK, len(axes)))
        self._position = CHUNK
        self._generators: list[list[np.random.Generator]] = [[] for _ in range(n_lanes)]
        self._action = np.zeros((len(axes), n_lanes))
        self._every_axis = 0 if len(axes) == 1 else slice(None)  # a place is written faster than a slice
        self._out = np.empty((1, len(self.columns) + len(self.truth_columns), n_lanes))
        self._bind()

    def _bind(self) -> None:
        """Compose the stepper and gather what every call of it receives."""
        self._flat_action = self._action.reshape(-1)
        state = (self._q, self._forces, self._states, self._count, self._diverged)
        self._fixed = (*self._settings, *state, self._action, self._normal)
        self._stepper = compiled(compose(self._kinds), (*self._fixed, 0, self._out))

    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp] | None = None) -> None:
        """Put lanes to rest at the first commanded position and restart their random streams."""
        chosen = np.arange(self.n_lanes) if lanes is None else lanes
        if len(seeds) != len(chosen):
            raise SpecError(f"seeds: {len(chosen)} are expected, one for each lane, found {len(seeds)}.")
        if lanes is None:
            self._position = CHUNK
        self._q[chosen] = self._rest
        self._forces[chosen] = self._states[chosen] = 0.0
        self._count[chosen] = 0
        self._diverged[chosen] = False
        for lane, seed in zip(chosen.tolist(), seeds, strict=True):
            self._generators[lane] = [stream(seed, name) for name in self._streams]
            self._draw(lane, self._position)

    def _draw(self, lane: int, first: int) -> None:
        for axis, generator in enumerate(self._generators[lane]):
            self._normal[lane, first:, axis] = generator.standard_normal(CHUNK - first)

    def advance(self, n_samples: int, action: FloatArray | None = None) -> FloatArray:
        """Advance all lanes; see `System.advance`. The action of each axis is added to its commanded position."""
        self._check_end(int(self._count.max()) + n_samples)
        self._action[:] = 0.0 if action is None else action
        out = np.empty((n_samples, *self._out.shape[1:]))
        done = 0
        while done < n_samples:
            n = min(n_samples - done, CHUNK - self._position % CHUNK)
            self._run(out[done : done + n])
            done += n
        return out

    def advance_one(self, action: float) -> FloatArray:
        """Advance the only lane by one sample; see `System.advance_one`."""
        self._check_end(int(self._count[0]) + 1)
        self._flat_action[self._every_axis] = action
        self._run(self._out)
        return self._out[0, :, 0].copy()

    def _check_end(self, sample: int) -> None:
        if sample > self.n_samples:
            raise SpecError(f"advance: the episode ends after {self.n_samples} samples; start the lanes again.")

    def _run(self, out: FloatArray) -> None:
        """Advance by ``len(out)`` samples, for which a chunk of random numbers lasts."""
        if self._position == CHUNK:
            for lane in range(self.n_lanes):
                self._draw(lane, 0)
            self._position = 0
        self._stepper(*self._fixed, self._position, out)
        self._position += len(out)

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes have left the travel or the velocity limit."""
        return self._diverged.copy()

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key not in ("_fixed", "_stepper", "_flat_action")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._bind()


@dataclass(frozen=True, kw_only=True)
class Stage(Plant):
    r"""Servo-controlled axes, each known as a linear response to its commanded position.

    The model ``servo_response`` is :math:`y = \gamma\, x_{pb} + \varepsilon`: y the measured position, :math:`x_{pb}`
    the position that the plant on paper predicts from the command alone, and a gain for each axis that is 1 on paper.
    The rows of a second axis follow those of the first, with a column of their own.

    Parameters
    ----------
    travel_m, velocity_limit_m_per_s : float
        Limits of the table; an episode beyond them has diverged.
    """

    travel_m: float = positive()
    velocity_limit_m_per_s: float = positive()

    @abstractmethod
    def axes(self) -> Mapping[str, Response]:
        """Return the response of each axis by the prefix of its columns."""

    def linear_system(self, sampling_time_s: float) -> LinearSystem:
        """Return the response of each axis to its commanded position; see `LinearisedPlant`."""
        axes = self.axes()
        n = 0
        size = sum(len(axis.B) for axis in axes.values())
        A, B, C = np.zeros((size, size)), np.zeros((size, len(axes))), np.zeros((len(axes), size))
        for number, axis in enumerate(axes.values()):
            own = slice(n, n + len(axis.B))
            A[own, own], B[own, number], C[number, own] = axis.A, axis.B, axis.C
            n = own.stop
        commands, readings = ([f"{prefix}{name}" for prefix in axes] for name in ("reference_position_m", "position_m"))
        return continuous(A, B, C, commands, readings, sampling_time_s)

    def linear_models(self) -> tuple["ServoResponse"]:
        """Return the one model, ``servo_response``."""
        return (ServoResponse(stage=self),)

    def nominal_response(self, record: Record) -> FloatArray:
        """Return the positions predicted from the commanded ones (n_rows,), axis after axis."""
        commands = [
            record[prefix + name] if name else np.zeros(record.n_samples)
            for prefix in self.axes()
            for name in ("reference_position_m", "reference_velocity_m_per_s", "")
        ]
        period_s, silent = record.sampling_time_s, np.zeros(len(self.axes()))
        system = StageSystem(self, np.column_stack(commands), period_s, substeps=1, deviations=silent)
        system.start([0])
        predicted: FloatArray = system.advance(system.n_samples)[:, 2 : 3 * len(self.axes()) : 3, 0].T.ravel()
        return predicted

    def system(self, setup: Setup, n_lanes: int = 1) -> StageSystem:
        """Return the stage with the setup's effects as forces on its table."""
        axes = self.axes()
        for effect in setup.unmodelled:
            if effect.port is not Port.TABLE_FORCE or effect.random:
                raise SpecError(
                    f"reality.effects: {effect.name} acts on a feed drive's {effect.port.value}"
                    f"{' at random' if effect.random else ''}; a servo stage takes forces on the table only."
                )
        reference = setup.motion.reference(setup.timing.sampling_time_s, setup.timing.n_samples)
        if reference.shape[1] != 3 * len(axes):
            raise SpecError(f"motion: it moves {reference.shape[1] // 3} axes, the plant has {len(axes)}.")
        readings = [f"{prefix or 'table_'}position_m" for prefix in axes]
        setup.noise.check_only(readings, self.name)
        deviations = np.array([getattr(setup.noise, reading) for reading in readings])
        period_s, substeps = setup.timing.sampling_time_s, setup.timing.substeps
        return StageSystem(self, reference, period_s, substeps, deviations, setup.unmodelled, n_lanes)


@final
@dataclass(frozen=True, kw_only=True)
class ServoResponse(LinearModel):
    """The model ``servo_response`` of a stage; see `Stage`."""

    stage: Stage
    name: str = "servo_response"

    def regression(self, record: Record) -> Regression:
        """Return the measured positions on the predicted ones, axis after axis."""
        axes = self.stage.axes()
        return Regression(
            regressors=np.kron(np.eye(len(axes)), np.ones((record.n_samples, 1)))
            * self.stage.nominal_response(record)[:, None],
            target=np.concatenate([record[f"{prefix}position_m"] for prefix in axes]),
            names=tuple(self.nominal_parameters(record.sampling_time_s)),
            target_name="position_m",
            time_s=np.tile(record["time_s"], len(axes)),
            rows=np.tile(np.arange(record.n_samples), len(axes)),
            disturbance_gain=float(np.mean([response.compliance_m_per_N for response in axes.values()])),
        )

    def nominal_parameters(self, sampling_time_s: float) -> Mapping[str, float]:
        """Return the gain of each axis, 1 on paper."""
        return {f"{prefix}response_gain": 1.0 for prefix in self.stage.axes()}

    def free_run(self, command: Record, parameters: Mapping[str, float]) -> FloatArray:
        """Return the positions that the response on paper makes of a command, times the gain of each axis."""
        gains = [parameters[name] for name in self.nominal_parameters(command.sampling_time_s)]
        return np.repeat(gains, command.n_samples) * self.stage.nominal_response(command)
