"""Servo stages as they are simulated: a linear response to the commanded position, effects as forces on the table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect
from fdbench.simulate.axis import SIDE_BY_SIDE
from fdbench.simulate.block import by_blocks
from fdbench.simulate.direct import compiled
from fdbench.simulate.exponential import exponential, product
from fdbench.simulate.memory import aligned_zeros
from fdbench.simulate.random import RandomNumbers, RandomSource
from fdbench.simulate.stage_stepper import ROWS, Pattern, compose
from fdbench.simulate.start import Start
from fdbench.simulate.system import FloatArray, System

AT_REST = Start()


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
    def motion(self) -> FloatArray:
        """State (n,) for each m/s of a motion that has long been steady, the position being 0."""
        behind = np.linalg.solve(self.A, self.rest)
        return np.asarray(behind - self.rest * (self.C @ behind) / (self.C @ self.rest), dtype=np.float64)

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
        Commanded position, velocity and acceleration of each axis, before the start displaces them.
    period_s, substeps : sampling time, integration substeps in it
    deviations : (n_axes,) array
        Standard deviation of each reading, m.
    effects : sequence of Effect
    n_lanes : int
    start : Start
        Where the axes begin and how fast; at rest at the start of the reference by default.

    Attributes
    ----------
    initial : (n_blocks, n_axes, n_rows, width) array
        What lanes begin with.
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
        start: Start = AT_REST,
    ) -> None:
        prefixes, responses = list(axes), list(axes.values())
        sources = [
            RandomSource(stream=f"{prefix or 'table_'}position_noise", column=n) for n, prefix in enumerate(prefixes)
        ]
        self._side_by_side = SIDE_BY_SIDE if n_lanes >= SIDE_BY_SIDE // 4 else 1
        self._numbers = RandomNumbers(sources, n_lanes, self._side_by_side, len(axes))
        super().__init__(n_lanes, len(reference), self._numbers)
        self.action_names = tuple(f"{prefix}position_m" for prefix in prefixes)
        names = ("reference_position_m", "reference_velocity_m_per_s", "position_m")
        self.columns = tuple(prefix + name for prefix in prefixes for name in names)
        self.truth_columns = (*(f"{prefix}disturbance_N" for prefix in prefixes), "diverged")
        commanded = start.displaced(reference)
        self.commanded = {
            prefix + name: commanded[:, 3 * axis + place]
            for axis, prefix in enumerate(prefixes)
            for place, name in enumerate(names[:2])
        }
        travel, velocity = limits
        self.limits = dict(zip(self.columns, (travel, velocity, travel) * len(axes), strict=True))
        first = commanded[0].reshape(-1, 3)[:, [0, 1, 0]]
        first[:, 2] *= [response.C @ response.rest for response in responses]
        self.at_rest = first.ravel()
        self._kinds = tuple(type(effect) for effect in effects)
        self._pattern, coefficients = _sums(responses, period_s / substeps)
        self._settings = (
            period_s,
            substeps,
            coefficients,
            np.array([travel, velocity]),
            deviations,
            np.ascontiguousarray(reference),
            np.array([value for effect in effects for value in effect.values()]),
            np.empty((len(self._kinds), 2, substeps)),
        )
        state, velocities = np.stack([item.rest for item in responses]) * first[:, :1], start.velocities(len(axes))
        if velocities.any():
            state += np.stack([response.motion for response in responses]) * velocities[:, None]
        self._n_states = state.shape[1]
        n_rows = len(ROWS) + self._n_states + sum(len(kind.states) for kind in self._kinds)
        self._n_blocks = -(-n_lanes // self._side_by_side)
        self._blocks = aligned_zeros(self._n_blocks, len(axes), n_rows, self._side_by_side)
        self.initial = np.zeros_like(self._blocks)
        self.initial[:, :, len(ROWS) : len(ROWS) + self._n_states] = state[..., None]
        self.initial[:, :, ROWS.index("DISPLACEMENT")] = start.positions(len(axes))[:, None]
        self._of_lanes = np.zeros((len(axes), self._n_blocks * self._side_by_side))
        self._every_axis = 0 if len(axes) == 1 else slice(None)  # a place is written faster than a slice
        self._out = np.empty((1, len(self.columns) + len(self.truth_columns), self._n_blocks, self._side_by_side))
        self._bind()

    def _bind(self) -> None:
        """Compose the stepper and gather what every call of it receives."""
        stepper = compose(self._kinds, self._pattern, self._n_states, self._side_by_side)
        self._flat = self._blocks.reshape(*self._blocks.shape[:2], -1)
        self._actions = self._blocks[:, :, ROWS.index("ACTION")]
        self._only_action = self._actions[0, :, 0]
        self._fixed = (*self._settings, self._numbers.normal)
        self._stepper = compiled(stepper, (self._flat, 0, *self._fixed, self._out))

    def _reset(self, lanes: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Put lanes back to their initial state, and those that only fill the last block."""
        filling = np.arange(self.n_lanes, self._n_blocks * self._side_by_side)
        blocks, places = np.divmod(np.concatenate((lanes, filling)), self._side_by_side)
        self._blocks[blocks, :, :, places] = self.initial[blocks, :, :, places]

    def _act(self, action: FloatArray | None) -> None:
        """Keep the action of each axis, which is added to its commanded position."""
        if action is None:
            self._actions[:] = 0.0
            return
        self._of_lanes[..., : self.n_lanes] = action
        self._actions[:] = self._of_lanes.reshape(len(self._of_lanes), self._n_blocks, -1).swapaxes(0, 1)

    def _advance(self, rows: FloatArray) -> None:
        def step(raw: FloatArray) -> None:
            self._stepper(self._flat, self._numbers.position, *self._fixed, raw)

        by_blocks(step, rows, self._n_blocks, self._side_by_side)

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes have left the limits, by the flags that the stepper keeps."""
        flags = self._blocks[:, :, ROWS.index("DIVERGED")].max(axis=1).reshape(-1)[: self.n_lanes]
        return np.asarray(flags > 0.5)

    def advance_one(self, action: float) -> tuple[FloatArray, Sequence[float]]:
        """Advance the only lane by one sample; see `System.advance_one`."""
        self._check_end(1)
        self._only_action[self._every_axis] = action
        self._next_numbers(1)
        self._stepper(self._flat, self._numbers.position, *self._fixed, self._out)
        self._pass(1)
        row = self._out[0, :, 0, 0]
        return row[: len(self.columns)].copy(), row.tolist()

    def __getstate__(self) -> dict[str, Any]:
        bound = {"_actions", "_fixed", "_flat", "_only_action", "_stepper"}
        return {key: value for key, value in vars(self).items() if key not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._bind()


def _sums(responses: Sequence[Response], h: float) -> tuple[Pattern, FloatArray]:
    """Return the pattern of the stepper's sums for substeps of h, and their coefficients (n_axes, n_coefficients)."""
    full, half = (np.stack([response.flow(step) for response in responses]) for step in (h, h / 2.0))
    table = np.stack([response.table for response in responses])
    n = full.shape[1]
    state = [f"w[Q_{place} + i]" for place in range(n)]
    inputs = ["u_0", "u_1", "u_2", "u_3", "f_0", "f_1", "f_2"]
    # Only the table is asked for in the middle, not the state.
    middle = np.concatenate(
        (np.stack([product(*pair) for pair in zip(table[:, :, :n], half, strict=True)]), table[:, :, n:]), axis=2
    )
    sums = {
        "POSITION": (state, np.stack([response.C for response in responses])),
        "VELOCITY": ([*state, "u_0", "u_1"], table[:, 1]),
        **{f"MIDDLE_{name}": ([*state, *inputs, "x_0", "v_0"], middle[:, row]) for row, name in enumerate("XVU")},
        "STIFFNESS": (["w[SLOPE + i]"], -middle[:, 1, n + 4, None]),
        **{f"NEXT_{row}": ([*state, *inputs], full[:, row]) for row in range(n)},
    }
    pattern, coefficients = [], []
    for name, (columns, matrix) in sums.items():
        used = np.flatnonzero(matrix.any(axis=0))
        pattern.append((name, tuple(columns[place] for place in used)))
        coefficients.append(matrix[:, used])
    return tuple(pattern), np.ascontiguousarray(np.hstack(coefficients))
