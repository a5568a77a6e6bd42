"""One feed axis, or many side by side: the composed stepper with its blocks, random numbers and limits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect
from fdbench.errors import SpecError
from fdbench.simulate import layout
from fdbench.simulate.compose import Slot, block_rows, compose, slots
from fdbench.simulate.random import stream
from fdbench.simulate.system import FloatArray, Setup, System

CHUNK = 256  # samples of random numbers drawn at once
SIDE_BY_SIDE = 64  # lanes in a block of many
ROW = {name: index for index, name in enumerate(layout.ROWS)}
NOISE_STREAMS = ("motor_position_noise", "table_position_noise", "velocity_noise", "equation_noise")


@dataclass(frozen=True, kw_only=True, eq=False)
class Mechanics:
    r"""Linear part of an axis, :math:`\dot s = A s + B f` with s = (x_m, v_m, x_t, v_t) and f = (f_motor, f_table).

    A rigid axis has equal rows for motor side and table. Limits in m and m/s; stiffness in N/m, damping in N s/m.
    """

    A: FloatArray
    B: FloatArray
    stiffness_N_per_m: float
    damping_N_s_per_m: float
    rigid: bool
    position_limit_m: float
    velocity_limit_m_per_s: float

    def propagators(self, h: float) -> FloatArray:
        """Return the 24 entries of (A | B), row by row, that advance the state exactly by h under constant forces."""
        from scipy.linalg import expm

        generator = np.zeros((6, 6))
        generator[:4, :4] = self.A
        generator[:4, 4:] = self.B
        flow: FloatArray = expm(generator * h)[:4]
        return flow.ravel()


class Axis(System):
    """Lanes of one axis with the same effects, controller and reference.

    Parameters
    ----------
    mechanics : Mechanics
    controller : mapping of str to float
        Rows of the controller by their layout name, such as ``VELOCITY_GAIN``.
    effects : sequence of Effect
        Modelled and unmodelled, in the order in which effects of one port act.
    setup : Setup
    columns, scales : what is logged, and the factor from the layout's SI rows to each column
    n_lanes : int
    """

    truth_columns = ("disturbance_N", "held_sample", "diverged")

    def __init__(
        self,
        mechanics: Mechanics,
        controller: Mapping[str, float],
        effects: Sequence[Effect],
        setup: Setup,
        columns: Mapping[str, tuple[int, float]],
        action_row: str,
        action_name: str,
        n_lanes: int = 1,
    ) -> None:
        self.n_lanes = n_lanes
        self.n_samples = setup.timing.n_samples
        self.columns = tuple(columns)
        self.action_name = action_name
        self.timing = setup.timing
        self.effects = tuple(effects)
        self.reference = np.ascontiguousarray(
            setup.motion.reference(setup.timing.sampling_time_s, setup.timing.n_samples)
        )
        self.commanded = {
            "reference_position_m": self.reference[:, 0],
            "reference_velocity_m_per_s": self.reference[:, 1],
        }
        self._kinds = tuple(type(effect) for effect in effects)
        self._side_by_side = SIDE_BY_SIDE if n_lanes >= SIDE_BY_SIDE // 4 else 1
        self._n_blocks = -(-n_lanes // self._side_by_side)
        self._action_row = ROW[action_row]
        truths = (layout.OUT_DISTURBANCE, layout.OUT_HELD, layout.OUT_DIVERGED)
        self._pick = np.array([row for row, _ in columns.values()] + [*truths])
        self._scale = np.array([scale for _, scale in columns.values()] + [1.0] * len(truths))[:, None]
        self._has_scale = bool((self._scale != 1.0).any())
        self._active = np.ones(max(len(self.effects), 1), dtype=np.bool_)
        self._noise = setup.noise
        self._initial = self._initial_block(mechanics, controller, setup)
        self._sources = self._random_sources()
        self._generators: list[list[np.random.Generator]] = [[] for _ in range(n_lanes)]
        self._blocks = np.repeat(self._initial[None, :, :], self._n_blocks, axis=0)
        width = self._side_by_side
        n_uniform = max(1, sum(kind.random for kind in self._kinds))
        self._normal = np.zeros((self._n_blocks, CHUNK, layout.NORMAL_COLUMNS, width))
        self._uniform = np.zeros((self._n_blocks, CHUNK, n_uniform, width))
        self._position = CHUNK
        self._out = np.zeros((self._n_blocks, 1, layout.OUT_COLUMNS, width))
        self.limits, self.at_rest = self._ranges(mechanics, controller["FORCE_LIMIT"])
        self._bind()

    def _bind(self) -> None:
        """Compose the stepper, and find where each lane has its action, its flag and its logged row."""
        width, lane = self._side_by_side, np.arange(self.n_lanes)
        self._advance = compose(self._kinds, width)
        self._flat_blocks = self._blocks.reshape(self._n_blocks, -1)
        self._flat_out = self._out.reshape(-1)

        def places(n_rows: int, row: Any) -> Any:
            return (lane // width * n_rows + row) * width + lane % width

        n_rows = self._blocks.shape[1]
        self._actions = self._blocks.reshape(-1), places(n_rows, self._action_row)
        self._flags = self._blocks.reshape(-1), places(n_rows, ROW["DIVERGED"])
        self._logged = places(layout.OUT_COLUMNS, self._pick[:, None])[None]

    def _ranges(self, mechanics: Mechanics, force_limit: float) -> tuple[dict[str, float], FloatArray]:
        """Return the largest magnitude of each column, and what is logged at the start of the reference."""
        limit, rest = np.zeros(layout.OUT_COLUMNS), np.zeros(layout.OUT_COLUMNS)
        limit[[layout.OUT_MOTOR, layout.OUT_TABLE]] = mechanics.position_limit_m
        rest[[layout.OUT_MOTOR, layout.OUT_TABLE]] = self.reference[0, 0]
        limit[layout.OUT_VELOCITY] = mechanics.velocity_limit_m_per_s
        limit[layout.OUT_FORCE] = force_limit
        n = len(self.columns)
        picked, scale = self._pick[:n], self._scale[:n, 0]
        commanded = {
            "reference_position_m": mechanics.position_limit_m,
            "reference_velocity_m_per_s": mechanics.velocity_limit_m_per_s,
        }
        logged = dict(zip(self.columns, (limit[picked] * scale).tolist(), strict=True))
        return commanded | logged, rest[picked] * scale

    def _random_sources(self) -> list[tuple[str, bool, int]]:
        """Return name, whether normal, and column of each random stream that the setup uses."""
        noise = self._noise
        deviations = (
            noise.motor_position_m,
            noise.table_position_m,
            noise.velocity_m_per_s,
            noise.equation_velocity_m_per_s,
        )
        random_effects = [effect.name for effect in self.effects if effect.random]
        noises = [(NOISE_STREAMS[n], True, n) for n in range(layout.NORMAL_COLUMNS) if deviations[n] > 0.0]
        return noises + [(name, False, n) for n, name in enumerate(random_effects)]

    def _initial_block(self, mechanics: Mechanics, controller: Mapping[str, float], setup: Setup) -> FloatArray:
        block = np.zeros((block_rows(self._kinds), self._side_by_side))
        h = setup.timing.sampling_time_s / setup.timing.substeps
        block[ROW["HALF_0"] : ROW["HALF_0"] + 24] = mechanics.propagators(h / 2)[:, None]
        block[ROW["FULL_0"] : ROW["FULL_0"] + 24] = mechanics.propagators(h)[:, None]
        scalars = {
            "STIFFNESS": mechanics.stiffness_N_per_m,
            "DAMPING": mechanics.damping_N_s_per_m,
            "RIGID": float(mechanics.rigid),
            "POSITION_LIMIT": mechanics.position_limit_m,
            "VELOCITY_LIMIT": mechanics.velocity_limit_m_per_s,
            "NOISE_MOTOR": setup.noise.motor_position_m,
            "NOISE_TABLE": setup.noise.table_position_m,
            "NOISE_VELOCITY": setup.noise.velocity_m_per_s,
            "NOISE_EQUATION": setup.noise.equation_velocity_m_per_s,
            **controller,
        }
        for name in ("X_M", "X_T", "BACK_1", "BACK_2", "LAST_MOTOR", "LAST_TABLE"):
            scalars[name] = float(self.reference[0, 0])
        for name, value in scalars.items():
            block[ROW[name]] = value
        for slot, effect in zip(self.slots(), self.effects, strict=True):
            block[slot.flag] = 1.0
            for index, value in enumerate(effect.values()):
                block[slot.parameter(index)] = value
        return block

    def slots(self) -> list[Slot]:
        """Return where each effect lies in a block."""
        return slots(self._kinds)

    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp] | None = None) -> None:
        """Put lanes back to their initial state and restart their random streams."""
        chosen = np.arange(self.n_lanes) if lanes is None else lanes
        if len(seeds) != len(chosen):
            raise SpecError(f"seeds: {len(chosen)} are expected, one for each lane, found {len(seeds)}.")
        if lanes is None:
            self._position = CHUNK
        for lane, seed in zip(chosen.tolist(), seeds, strict=True):
            block, place = divmod(lane, self._side_by_side)
            self._blocks[block, :, place] = self._initial[:, place]
            self._generators[lane] = [stream(seed, name) for name, _, _ in self._sources]
            if lanes is not None:
                self._draw(lane, self._position)

    def _draw(self, lane: int, first: int) -> None:
        """Draw the rest of a chunk for one lane."""
        block, place = divmod(lane, self._side_by_side)
        for generator, (_, normal, column) in zip(self._generators[lane], self._sources, strict=True):
            target = self._normal if normal else self._uniform
            n = CHUNK - first
            target[block, first:, column, place] = generator.standard_normal(n) if normal else generator.random(n)

    def _draw_all(self) -> None:
        """Draw a chunk for all lanes, one block at a time: a transposed copy is faster than columns far apart."""
        width = self._side_by_side
        drawn = np.zeros((width, CHUNK))
        for source, (_, normal, column) in enumerate(self._sources):
            target = self._normal if normal else self._uniform
            for block in range(self._n_blocks):
                for row, generators in zip(drawn, self._generators[block * width :], strict=False):
                    if normal:
                        generators[source].standard_normal(out=row)
                    else:
                        generators[source].random(out=row)
                target[block, :, column, :] = drawn.T

    def advance(self, n_samples: int, action: FloatArray | None = None) -> FloatArray:
        """Advance all lanes; see `System.advance`."""
        self._set_action(action)
        if n_samples == 1:
            self._run(1, self._out)
            row: FloatArray = self._flat_out[self._logged]
            if self._has_scale:
                row *= self._scale
            return row
        raw = np.empty((self._n_blocks, n_samples, layout.OUT_COLUMNS, self._side_by_side))
        done = 0
        while done < n_samples:
            n = min(n_samples - done, CHUNK if self._position == CHUNK else CHUNK - self._position)
            part = np.empty((self._n_blocks, n, layout.OUT_COLUMNS, self._side_by_side))
            self._run(n, part)
            raw[:, done : done + n] = part
            done += n
        rows = raw[:, :, self._pick] * self._scale
        if self._n_blocks == 1:
            return rows[0, :, :, : self.n_lanes]  # type: ignore[no-any-return]
        lanes: FloatArray = np.moveaxis(rows, 0, 2).reshape(n_samples, len(self._pick), -1)[:, :, : self.n_lanes]
        return lanes

    def _run(self, n_samples: int, out: FloatArray) -> None:
        if self._position == CHUNK:
            self._draw_all()
            self._position = 0
        self._advance(
            self._flat_blocks,
            self._position,
            n_samples,
            self.timing.substeps,
            self.timing.sampling_time_s,
            self._active,
            self.reference,
            self._normal,
            self._uniform,
            out,
        )
        self._position += n_samples

    def _set_action(self, action: FloatArray | None) -> None:
        blocks, places = self._actions
        blocks[places] = 0.0 if action is None else action

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes have left the limits, by the flag that the stepper keeps."""
        blocks, places = self._flags
        flags: NDArray[np.bool_] = blocks[places] > 0.5
        return flags

    def __getstate__(self) -> dict[str, Any]:
        bound = ("_advance", "_flat_blocks", "_flat_out", "_actions", "_flags", "_logged")
        return {key: value for key, value in vars(self).items() if key not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._bind()
