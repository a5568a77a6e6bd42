"""One feed axis, or many side by side: the composed stepper with its blocks, random numbers and limits."""

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect
from fdbench.errors import SpecError
from fdbench.simulate import layout
from fdbench.simulate.block import MECHANICS_ROWS, ROW, Blocks, Mechanics, by_blocks
from fdbench.simulate.compose import compose, room_ahead
from fdbench.simulate.direct import Direct, compiled
from fdbench.simulate.ports import Shared, Slot
from fdbench.simulate.random import CHUNK, RandomNumbers, RandomSource
from fdbench.simulate.system import FloatArray, Noise, Setup, System

SIDE_BY_SIDE = 64  # lanes in a block of many
REFERENCES = {
    "reference_position_m": layout.OUT_REFERENCE_POSITION,
    "reference_velocity_m_per_s": layout.OUT_REFERENCE_VELOCITY,
}
NOISE_STREAMS = (
    "motor_position_noise",
    "table_position_noise",
    "velocity_noise",
    "equation_noise",
    "motor_current_noise",
)


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
    columns : mapping of str to int
        What is logged beside the reference, and its column in the layout's output.
    logged_per_N : float
        Newton metres or amperes that the drive logs for one newton of motor force; 1 where it logs newtons.
    n_lanes : int
    """

    truth_columns = ("disturbance_N", "held_sample", "diverged")

    def __init__(
        self,
        mechanics: Mechanics,
        controller: Mapping[str, float],
        effects: Sequence[Effect],
        setup: Setup,
        columns: Mapping[str, int],
        logged_per_N: float,
        action_row: str,
        action_name: str,
        n_lanes: int = 1,
    ) -> None:
        columns = {**REFERENCES, **columns}
        self.columns = tuple(columns)
        self.action_names = (action_name,)
        self.timing = setup.timing
        self.effects = tuple(effects)
        self.reference = np.ascontiguousarray(setup.reference())
        commanded = setup.start.displaced(self.reference)
        self.commanded = {"reference_position_m": commanded[:, 0], "reference_velocity_m_per_s": commanded[:, 1]}
        self._kinds = tuple(type(effect) for effect in effects)
        self._side_by_side = SIDE_BY_SIDE if n_lanes >= SIDE_BY_SIDE // 4 else 1
        n_uniform = max(1, sum(kind.random for kind in self._kinds))
        sources, width = self._sources(setup.noise), self._side_by_side
        self._numbers = RandomNumbers(sources, n_lanes, width, layout.NORMAL_COLUMNS, n_uniform)
        super().__init__(n_lanes, setup.timing.n_samples, self._numbers)
        self._n_blocks = -(-n_lanes // self._side_by_side)
        self._action_row = ROW[action_row]
        self._pick = np.array([*columns.values(), *range(layout.OUT_DISTURBANCE, layout.OUT_COLUMNS)])
        self._active = np.ones(len(self.effects), dtype=np.bool_)
        self._rigid = mechanics.rigid
        self._initial = Blocks(self._kinds, n_lanes, width)
        self._initial.set_mechanics(mechanics, setup.timing.substep_s)
        self._initial.set_scalars({**controller, **_noises(setup.noise, logged_per_N), "LOGGED_PER_N": logged_per_N})
        (displacement,), (velocity,) = setup.start.positions(1).tolist(), setup.start.velocities(1).tolist()
        self._initial.set_scalars({"DISPLACEMENT": displacement})
        self._initial.place(float(commanded[0, 0]), velocity, setup.timing.sampling_time_s)
        for number, effect in enumerate(self.effects):
            self._initial.set_effect(number, effect, self._applies(type(effect)))
        self._now = copy.deepcopy(self._initial)
        width = self._side_by_side
        self._idle = slice((n_lanes - 1) % self._side_by_side + 1, None)
        self._out = np.zeros((1, len(self._pick), self._n_blocks, width))
        self.limits, self.at_rest = self._ranges(mechanics, velocity, controller["FORCE_LIMIT"] * logged_per_N)
        self._bind()

    def _bind(self) -> None:
        """Compose the stepper, and find where each lane has its action and its flag."""
        width, lane = self._side_by_side, np.arange(self.n_lanes)
        blocks = self._now.values
        self._flat_blocks = self._now.flat
        self._shared = self._whole_numbers()
        stepper = compose(self._kinds, width, self._shared)
        clock = self.timing.substeps, self.timing.sampling_time_s
        normal = self._numbers.normal
        random = normal.reshape(*normal.shape[:2], -1), self._numbers.uniform
        calls = stepper.calls(self._active)
        ahead = room_ahead(len(calls[0]), self.timing.substeps)
        self._settings = (*clock, *calls, ahead, self.reference, self._pick, *random)
        self._stepper = stepper.advance
        self._step = compiled(self._stepper, (self._flat_blocks, 0, 1, *self._settings, self._out))
        self._alone: tuple[Any, ...] = ()
        first = lane // width * blocks[0].size + lane % width
        self._actions = blocks.reshape(-1), first + self._action_row * width
        self._flags = blocks.reshape(-1), first + ROW["DIVERGED"] * width

    def _whole_numbers(self) -> Shared:
        """Return the parameters that are whole numbers and that lanes side by side have alike."""
        if self._side_by_side == 1:
            return ()
        found = []
        for number, slot in enumerate(self.slots()):
            for index, parameter in enumerate(slot.effect.parameters()):
                values = self._initial.values[:, slot.parameter(index)] if parameter.whole else None
                if values is not None and (values == values[0, 0]).all():
                    found.append((number, index, float(values[0, 0])))
        return tuple(found)

    def _ranges(
        self, mechanics: Mechanics, velocity: float, command_limit: float
    ) -> tuple[dict[str, float], FloatArray]:
        """Return the largest magnitude of each column, and what is logged at the start of the reference."""
        limit, rest = np.zeros(layout.OUT_COLUMNS), np.zeros(layout.OUT_COLUMNS)
        positions = [layout.OUT_REFERENCE_POSITION, layout.OUT_MOTOR, layout.OUT_TABLE]
        limit[positions], rest[positions] = mechanics.position_limit_m, self.commanded["reference_position_m"][0]
        limit[[layout.OUT_REFERENCE_VELOCITY, layout.OUT_VELOCITY]] = mechanics.velocity_limit_m_per_s
        limit[layout.OUT_FORCE] = command_limit
        rest[[layout.OUT_REFERENCE_VELOCITY, layout.OUT_VELOCITY]] = self.reference[0, 1], velocity
        logged = self._pick[: len(self.columns)]
        return dict(zip(self.columns, limit[logged].tolist(), strict=True)), rest[logged]

    def _sources(self, noise: Noise) -> list[RandomSource]:
        """Return the random streams that the noises and the random effects use."""
        deviations = (
            noise.motor_position_m,
            noise.table_position_m,
            noise.velocity_m_per_s,
            noise.equation_velocity_m_per_s,
            noise.motor_current_A,
        )
        random_effects = [effect.name for effect in self.effects if effect.random]
        named = zip(NOISE_STREAMS, deviations, strict=True)
        noises = [RandomSource(stream=name, column=n) for n, (name, deviation) in enumerate(named) if deviation > 0.0]
        return noises + [RandomSource(stream=name, column=n, normal=False) for n, name in enumerate(random_effects)]

    @property
    def initial(self) -> FloatArray:
        """What lanes begin with, (n_blocks, n_rows, width)."""
        return self._initial.values

    def slots(self) -> tuple[Slot, ...]:
        """Return where each effect lies in a block."""
        return self._initial.slots

    def _applies(self, effect: type[Effect]) -> bool:
        """Return whether the mechanics have what the effect is a property of."""
        return not (self._rigid and effect.needs_screw)

    def _write(self, rows: NDArray[np.intp], values: FloatArray, lanes: NDArray[np.intp] | None) -> None:
        """Write rows of ``lanes`` (default: all), now and for every later `start`."""
        for blocks in (self._initial, self._now):
            blocks.write(rows, values, np.arange(self.n_lanes) if lanes is None else lanes)

    def enable(self, effect: int, on: bool | NDArray[np.bool_] = True, lanes: NDArray[np.intp] | None = None) -> None:
        """Switch an effect on or off in ``lanes`` (default: all), now and for every later `start`.

        Parameters
        ----------
        effect : int
            Index into ``effects``. One that is off in every lane costs nothing; one that the mechanics do not have
            (`Effect.needs_screw`) stays off.
        on : bool or (n_chosen,) array of bool
        lanes : (n_chosen,) array of int, optional
        """
        slot = self.slots()[effect]
        flags = np.asarray(on) & self._applies(slot.effect)
        self._write(np.array([slot.flag]), np.atleast_2d(flags), lanes)
        self._active[effect] = (self._initial.values[:, slot.flag].reshape(-1)[: self.n_lanes] > 0.5).any()
        self._bind()

    def set_parameters(self, effect: int, values: FloatArray, lanes: NDArray[np.intp] | None = None) -> None:
        """Set all parameters of an effect in ``lanes`` (default: all), now and for every later `start`.

        Parameters
        ----------
        effect : int
            Index into ``effects``.
        values : (n_parameters,) or (n_parameters, n_chosen) array
            In the order of `Effect.parameters`.
        lanes : (n_chosen,) array of int, optional

        Raises
        ------
        SpecError
            If a value is outside the parameter's bounds.
        """
        slot = self.slots()[effect]
        table = np.atleast_2d(np.asarray(values, dtype=np.float64).T).T
        for parameter, row in zip(slot.effect.parameters(), table, strict=True):
            outside = row[~((row >= parameter.low) & (row <= parameter.high))]
            if outside.size:
                interval = f"[{parameter.low:g}, {parameter.high:g}] {parameter.unit}".rstrip()
                raise SpecError(f"{slot.effect.name}.{parameter.name}: {outside[0]:g} is outside {interval}.")
        self._write(slot.parameter(0) + np.arange(len(table)), table, lanes)
        if self._whole_numbers() != self._shared:
            self._bind()

    def set_mechanics(self, mechanics: Sequence[Mechanics], lanes: NDArray[np.intp] | None = None) -> None:
        """Give each of ``lanes`` (default: all) masses, screw and limits of its own, now and for every later `start`.

        Raises
        ------
        SpecError
            If rigid and elastic mechanics are mixed: a rigid axis has other effects.
        """
        if any(item.rigid != self._rigid for item in mechanics):
            raise SpecError(f"mechanics: {'a rigid' if self._rigid else 'an elastic'} axis is expected in every lane.")
        h = self.timing.substep_s
        self._write(MECHANICS_ROWS, np.column_stack([item.rows(h) for item in mechanics]), lanes)

    def _reset(self, lanes: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Put lanes back to their initial state."""
        if self._whole_numbers() != self._shared:
            self._bind()
        now, initial = self._now.values, self._initial.values
        blocks, places = np.divmod(lanes, self._side_by_side)
        now[blocks, :, places] = initial[blocks, :, places]
        # Lanes that only fill the last block read the reference too.
        now[-1, :, self._idle] = initial[-1, :, self._idle]

    def _act(self, action: FloatArray | None) -> None:
        blocks, places = self._actions
        blocks[places] = 0.0 if action is None else action

    def _advance(self, rows: FloatArray) -> None:
        def step(raw: FloatArray) -> None:
            self._step(self._flat_blocks, self._numbers.position, len(rows), *self._settings, raw)

        by_blocks(step, rows, self._n_blocks, self._side_by_side)

    def advance_one(self, action: float) -> tuple[FloatArray, Sequence[float]]:
        """Advance the only lane by one sample; see `System.advance_one`."""
        numbers, run, address, out, logged = self._alone or self._gather_alone()
        position, clock = numbers.position, self._clock
        if position == CHUNK or clock >= self._end:
            self._check_end(1)
            numbers.refill()
            position = 0
        row = run(address, position, action)
        self._clock = clock + 1
        numbers.position = position + 1
        return out[logged], row

    def _gather_alone(self) -> tuple[Any, ...]:
        """Return what `advance_one` needs; many systems are never asked for a sample alone."""
        action, out = self._now.values[0, self._action_row], self._out.reshape(-1)
        arguments = self._flat_blocks, 0, 1, *self._settings, self._out
        direct = self._direct = Direct(self._stepper, arguments, 1, action, out, range(len(self._pick)))
        self._alone = self._numbers, direct.run, direct.address, out, np.arange(len(self.columns))
        return self._alone

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes have left the limits, by the flag that the stepper keeps."""
        blocks, places = self._flags
        flags: NDArray[np.bool_] = blocks[places] > 0.5
        return flags

    def __getstate__(self) -> dict[str, Any]:
        bound = {"_step", "_stepper", "_direct", "_alone", "_settings", "_flat_blocks", "_actions", "_flags"}
        return {key: value for key, value in vars(self).items() if key not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._bind()


def _noises(noise: Noise, logged_per_N: float) -> dict[str, float]:
    """Return the rows of the noises."""
    return {
        "NOISE_MOTOR": noise.motor_position_m,
        "NOISE_TABLE": noise.table_position_m,
        "NOISE_VELOCITY": noise.velocity_m_per_s,
        "NOISE_EQUATION": noise.equation_velocity_m_per_s,
        "NOISE_COMMAND": noise.motor_current_A / logged_per_N,
        "NOISE_THROUGH_ENCODERS": float(noise.through_encoders),
    }
