"""Servo stages as they are simulated: a linear response to the commanded position, effects as forces on the table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect
from fdbench.simulate.axis import compiled
from fdbench.simulate.exponential import exponential
from fdbench.simulate.random import RandomNumbers, RandomSource
from fdbench.simulate.stage_stepper import compose
from fdbench.simulate.system import FloatArray, System


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


class StageSystem(System):
    """Lanes of one stage; every axis feels the same effects, each with internal states of its own.

    Parameters
    ----------
    axes : mapping of str to Response
        By the prefix of its columns.
    limits : pair of float
        Travel (m) and velocity (m/s) of the table.
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
        axes: Mapping[str, Response],
        limits: tuple[float, float],
        reference: FloatArray,
        period_s: float,
        substeps: int,
        deviations: FloatArray,
        effects: Sequence[Effect] = (),
        n_lanes: int = 1,
    ) -> None:
        prefixes, responses = list(axes), list(axes.values())
        sources = [
            RandomSource(stream=f"{prefix or 'table_'}position_noise", column=n) for n, prefix in enumerate(prefixes)
        ]
        self._numbers = RandomNumbers(sources, n_lanes, 1, len(axes))
        super().__init__(n_lanes, len(reference), self._numbers)
        self.action_names = tuple(f"{prefix}position_m" for prefix in prefixes)
        names = ("reference_position_m", "reference_velocity_m_per_s", "position_m")
        self.columns = tuple(prefix + name for prefix in prefixes for name in names)
        self.truth_columns = (*(f"{prefix}disturbance_N" for prefix in prefixes), "diverged")
        self.commanded = {
            prefix + name: reference[:, 3 * axis + place]
            for axis, prefix in enumerate(prefixes)
            for place, name in enumerate(names[:2])
        }
        travel, velocity = limits
        self.limits = dict(zip(self.columns, (travel, velocity, travel) * len(axes), strict=True))
        start = reference[0].reshape(-1, 3)[:, [0, 1, 0]]
        start[:, 2] *= [response.C @ response.rest for response in responses]
        self.at_rest = start.ravel()
        self._kinds = tuple(type(effect) for effect in effects)
        h = period_s / substeps
        full, half = (np.stack([response.flow(step) for response in responses]) for step in (h, h / 2.0))
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
        self._action = np.zeros((len(axes), n_lanes))
        self._every_axis = 0 if len(axes) == 1 else slice(None)  # a place is written faster than a slice
        self._out = np.empty((1, len(self.columns) + len(self.truth_columns), n_lanes))
        self._bind()

    def _bind(self) -> None:
        """Compose the stepper and gather what every call of it receives."""
        self._flat_action = self._action.reshape(-1)
        state = (self._q, self._forces, self._states, self._count, self._diverged)
        self._fixed = (*self._settings, *state, self._action, self._numbers.normal[..., 0])
        self._stepper = compiled(compose(self._kinds), (*self._fixed, 0, self._out))

    def _reset(self, lanes: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Put lanes to rest at the first commanded position."""
        self._q[lanes] = self._rest
        self._forces[lanes] = self._states[lanes] = 0.0
        self._count[lanes] = 0

    def _act(self, action: FloatArray | None) -> None:
        """Keep the action of each axis, which is added to its commanded position."""
        self._action[:] = 0.0 if action is None else action

    def _advance(self, rows: FloatArray) -> None:
        self._stepper(*self._fixed, self._numbers.position, rows)

    def advance_one(self, action: float) -> FloatArray:
        """Advance the only lane by one sample; see `System.advance_one`."""
        self._check_end(1)
        self._flat_action[self._every_axis] = action
        self._next_numbers(1)
        self._stepper(*self._fixed, self._numbers.position, self._out)
        self._pass(1)
        return self._out[0, :, 0].copy()

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key not in ("_fixed", "_stepper", "_flat_action")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._bind()
