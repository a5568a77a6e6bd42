"""Replay: simulate the commands of runs on many variants of the model at once, with one stepper of all effects."""

import copy
import dataclasses
import itertools
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from fdbench.cluster import processors
from fdbench.diagnosis.model.commands import LoopCommands
from fdbench.diagnosis.records.runs import DEFLECTION, FORCE, POSITION, RecordedRun
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray
from fdbench.simulate import layout
from fdbench.simulate.block import Blocks, Mechanics
from fdbench.simulate.compose import compose, core_effects, room_ahead

Lanes = WeakKeyDictionary["Variant", dict[float, tuple[FloatArray, NDArray[np.bool_]]]]

WIDTH = 8  # few effects in a block beat many lanes in it
PIECE = 2048  # samples worked on at once, which stay in the processor's cache
APART = PIECE + 8  # from lane to lane: rows a power of two apart would push each other out of the cache
SETS_OF_RUNS = 4  # whose commands are at hand: what is fitted, all, and the shortest of either


@dataclass(frozen=True, kw_only=True, eq=False)
class Variant:
    """One lane: a plant, perhaps re-calibrated, with effects that the nominal model lacks.

    At the same place the motor's reading is ``zeros_apart_m`` ahead of the table's. The force is read
    ``force_read_late_s`` after the position: a part of a sampling time.
    """

    plant: FeedDrive
    extra: tuple[Effect, ...] = field(default=())
    zeros_apart_m: float = 0.0
    force_read_late_s: float = 0.0

    def kinds(self) -> frozenset[type[Effect]]:
        """Return the classes of the extra effects."""
        return frozenset(effect.declared for effect in self.extra)


@dataclass(frozen=True, kw_only=True, eq=False)
class Replayed:
    """A run that variants are to follow, and where their readings go.

    Attributes
    ----------
    run : RecordedRun
    variants : sequence of Variant
    channels : mapping of str to array
        Filled: each channel of the run, (n, n_samples) with n of at least ``places``.
    places : sequence of int
        Row of each variant in it.
    """

    run: RecordedRun
    variants: Sequence[Variant]
    channels: Mapping[str, FloatArray]
    places: Sequence[int]


def room(run: RecordedRun, n_lanes: int) -> dict[str, FloatArray]:
    """Return an array (n_lanes, n_samples) for each channel of a run, to be filled."""
    return rooms([run], [n_lanes])[0]


def rooms(
    runs: Sequence[RecordedRun], numbers: Sequence[int], arrays: Mapping[str, FloatArray] | None = None
) -> list[dict[str, FloatArray]]:
    """Return what `room` returns of several runs, in one array for each channel: that which is given, or a new one."""
    sizes = [n_lanes * run.n_samples for run, n_lanes in zip(runs, numbers, strict=True)]
    ends = np.cumsum(sizes).tolist()
    found: list[dict[str, FloatArray]] = [{} for _ in runs]
    for name in runs[0].channels if runs else ():
        array = np.empty(ends[-1]) if arrays is None else arrays[name]
        for own, run, end, size in zip(found, runs, ends, sizes, strict=True):
            own[name] = array[end - size : end].reshape(-1, run.n_samples)
    return found


class Memory:
    """Room for readings that is used again: pages of new arrays cost as much as what is simulated into them."""

    def __init__(self) -> None:
        self._arrays: dict[str, FloatArray] = {}

    def rooms(self, runs: Sequence[RecordedRun], numbers: Sequence[int]) -> list[dict[str, FloatArray]]:
        """Return what `rooms` returns, in arrays that are lent until rooms are asked for again."""
        size = sum(run.n_samples * n_lanes for run, n_lanes in zip(runs, numbers, strict=True))
        for name in runs[0].channels:
            if name not in self._arrays or len(self._arrays[name]) < size:
                # As much as is held at most: pages are asked for as they are written to, and but once.
                self._arrays[name] = np.empty(max(size, MODEL.held_at_once))
        return rooms(runs, numbers, self._arrays)


@lru_cache(maxsize=1)
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(processors(), "replay")


class Replay:
    """Simulator of variants of one nominal drive.

    Parameters
    ----------
    drive : FeedDrive
        The nominal plant; variants differ from it in values only.
    library : sequence of Effect classes
        Effects that variants may have in addition, at most one of a class.
    substeps : int
        Between two samples of a record.
    loops : int
        Cycles of the controller in that time.

    Attributes
    ----------
    memory : Memory
        Shared with those of other substeps.
    """

    def __init__(self, drive: FeedDrive, library: Sequence[type[Effect]], substeps: int, loops: int = 1) -> None:
        self.library = tuple(library)
        self.substeps, self.loops = substeps, loops
        self.drive = drive
        known = [effect.declared for effect in drive.effects]
        unusual, usual = list(known), [kind for kind in core_effects() if kind.usually_known]
        for kind in usual:
            if kind in unusual:
                unusual.remove(kind)
        added = [kind.declared for kind in library if kind.declared not in core_effects()]
        # What nominal models often know has a place beside candidates of its kind, so that all have one stepper.
        self.kinds = (*unusual, *usual, *core_effects(), *added)
        self._known: list[int] = []
        for kind in known:
            places = (place for place, other in enumerate(self.kinds) if other is kind and place not in self._known)
            self._known.append(next(places))
        n_uniform = max(1, sum(kind.random for kind in self.kinds))
        self._no_noise = np.zeros((1, 0, layout.NORMAL_COLUMNS * WIDTH)), np.ones((1, PIECE, n_uniform, WIDTH))
        self._last = {kind: place for place, kind in enumerate(self.kinds)}  # of a kind, is no known one
        self._stepper = compose(self.kinds, WIDTH)
        self._lanes: Lanes = WeakKeyDictionary()
        self._mechanics: dict[Any, Mechanics] = {}
        self._known_commands: list[LoopCommands] = []
        self.memory = Memory()

    def simulate(self, run: RecordedRun, variants: Sequence[Variant]) -> dict[str, FloatArray]:
        """Return each channel of the run as simulated, (n_variants, n_samples); not finite where a variant diverges.

        Readings are free of noise; every variant starts from the measured position and velocity.
        """
        channels = room(run, len(variants))
        self.fill([Replayed(run=run, variants=variants, channels=channels, places=range(len(variants)))])
        return channels

    def fill(self, replayed: Sequence[Replayed]) -> None:
        """Simulate several runs of one clock, lanes of different ones side by side, and fill in what is read."""
        lanes = [
            _ReplayLane(variant=variant, replayed=item, row=place)
            for item in replayed
            for variant, place in zip(item.variants, item.places, strict=True)
        ]
        lanes.sort(key=lambda lane: (sorted(kind.name for kind in lane.variant.kinds()), -lane.run.n_samples))
        parts, advance = _parts(lanes), partial(self._advance, self._commands([item.run for item in replayed]))
        if len(parts) == 1:
            advance(parts[0])
        else:
            list(_threads().map(advance, parts))

    def alone(self, run: RecordedRun, variant: Variant) -> dict[str, FloatArray]:
        """Return each channel of the run as one variant has it, (n_samples,)."""
        return self.on_each([run], variant)[0]

    def on_each(self, runs: Sequence[RecordedRun], variant: Variant) -> list[dict[str, FloatArray]]:
        """Return for each of several runs what `alone` returns."""
        found = rooms(runs, [1] * len(runs))
        self.fill(
            [
                Replayed(run=run, variants=[variant], channels=own, places=[0])
                for run, own in zip(runs, found, strict=True)
            ]
        )
        return [{name: values[0] for name, values in own.items()} for own in found]

    def with_substeps(self, substeps: int) -> "Replay":
        """Return the simulator with another number of substeps."""
        found = copy.copy(self)
        found.substeps, found._lanes = substeps, WeakKeyDictionary()
        return found

    @property
    def _steps_of_a_loop(self) -> int:
        return -(-self.substeps // self.loops)

    def with_loops(self, loops: int) -> "Replay":
        """Return the simulator with another number of cycles of the controller in a sampling time."""
        found = copy.copy(self)
        found.loops, found._lanes, found._known_commands = loops, WeakKeyDictionary(), []
        return found

    def _lane(self, variant: Variant, period_s: float) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the rows of a variant at rest, (n_rows,), and which kinds of effects it has; made once, then kept."""
        kept = self._lanes.setdefault(variant, {})
        if period_s not in kept:
            blocks = Blocks(self.kinds, 1, 1)
            blocks.set_mechanics(self._mechanics_of(variant.plant), period_s / (self.loops * self._steps_of_a_loop))
            blocks.set_scalars({"LOGGED_PER_N": 1.0, **variant.plant.rows()})
            active = np.zeros(len(self.kinds), dtype=np.bool_)
            known = zip(self._known, variant.plant.effects, strict=True)
            for place, effect in (*known, *((self._last[item.declared], item) for item in variant.extra)):
                active[place] = True
                blocks.set_effect(place, effect)
            kept[period_s] = blocks.values[0, :, 0], active
        return kept[period_s]

    def _mechanics_of(self, plant: FeedDrive) -> Mechanics:
        """Return the linear part of a variant without limits; most variants differ in their effects alone."""
        parts = plant.motor, plant.table, plant.screw
        if parts not in self._mechanics:
            own = plant.mechanics()
            self._mechanics[parts] = dataclasses.replace(own, position_limit_m=np.inf, velocity_limit_m_per_s=np.inf)
        return self._mechanics[parts]

    def _commands(self, runs: Sequence[RecordedRun]) -> LoopCommands:
        """Return the commands of runs; those of a few sets of runs are at hand."""
        known = next((own for own in self._known_commands if own.are_of(runs)), None)
        if known is None:
            known = LoopCommands(runs, self.loops)
            self._known_commands = [*self._known_commands, known][-SETS_OF_RUNS:]
        return known

    def _advance(self, commands: LoopCommands, lanes: Sequence["_ReplayLane"]) -> None:
        """Simulate lanes in one block, piece by piece; where a run ends, the next lane takes its place."""
        cycle = lanes[0].run.period_s / self.loops
        blocks = Blocks(self.kinds, WIDTH, WIDTH)
        logged = np.array([layout.OUT_FORCE, layout.OUT_MOTOR, layout.OUT_TABLE])
        # Samples of a lane lie behind each other: what the stepper scatters is in the cache, what is copied is whole.
        read = np.empty((len(logged), 1, WIDTH, APART))[..., :PIECE]
        out, (force, motor, scale) = read.transpose(3, 0, 1, 2), read[:, 0, :, :: self.loops]
        deflection, position = np.empty_like(motor), scale if self.drive.controller.uses_table else motor
        every = {FORCE: force, POSITION: position, DEFLECTION: deflection}
        read_from = {name: every[name] for name in lanes[0].run.channels}
        waiting, working = deque(lanes), dict[int, _ReplayLane]()
        left, kinds = [0] * WIDTH, np.zeros((WIDTH, len(self.kinds)), dtype=np.bool_)
        while waiting or any(left):
            for place in (place for place, n in enumerate(left) if n == 0):
                kinds[place] = False
                working.pop(place, None)
                if waiting:
                    lane = working[place] = waiting.popleft()
                    left[place] = len(lane.run.command)
                    blocks.values[0, :, place], kinds[place] = self._lane(lane.variant, lane.run.period_s)
                    blocks.place(*lane.run.start, cycle, np.array([place]))
                    begun = {"FIRST_ROW": commands.first_rows[id(lane.run)], **lane.held()}
                    blocks.set_scalars(begun, np.array([place]))
            calls = self._stepper.calls(np.logical_or.reduce(kinds))
            ahead = room_ahead(len(calls[0]), self._steps_of_a_loop)
            settings = self._steps_of_a_loop, cycle, *calls, ahead, commands.rows, logged
            until_next = min(left[place] for place in working)
            begins = {place: lane.run.n_samples - left[place] for place, lane in working.items()}
            together = [
                (own, begins[own.start], working[own.start].rows(own)) for own in _side_by_side(working, begins)
            ]
            for start in range(0, until_next, PIECE // self.loops):
                n = min(PIECE // self.loops, until_next - start)
                self._stepper.advance(blocks.flat, 0, n * self.loops, *settings, *self._no_noise, out)
                if DEFLECTION in read_from:
                    np.subtract(motor[:, :n], scale[:, :n], out=deflection[:, :n])
                for places, begin, rows in together:
                    first = begin + start
                    before = min(max(-first, 0), n)
                    for name, values in read_from.items():
                        rows[name][:, first + before : first + n] = values[places, before:n]
            for place, lane in working.items():
                left[place] -= until_next
                if left[place] == 0:
                    lane.read_apart()


def _parts(lanes: Sequence["_ReplayLane"]) -> list[Sequence["_ReplayLane"]]:
    """Return lanes in as many parts as there are processors, but at least a block's and whole blocks in each."""
    lengths = np.array([len(lane.run.command) for lane in lanes])
    n = min(processors(), len(lanes) // WIDTH) or 1
    ends = np.searchsorted(np.cumsum(lengths), lengths.sum() * np.arange(1, n) / n)
    ends = [0, *(WIDTH * np.unique(np.round(ends / WIDTH))).astype(int).tolist(), len(lanes)]
    return [lanes[first:last] for first, last in itertools.pairwise(ends) if first < last]


def _side_by_side(working: Mapping[int, "_ReplayLane"], begins: Mapping[int, int]) -> list[slice]:
    """Return the places in a block, a slice for lanes that go on in rows behind each other, from the same sample."""
    found: list[slice] = []
    for place, lane in sorted(working.items()):
        before = working.get(place - 1)
        if before is not None and lane.follows(before) and begins[place] == begins[place - 1]:
            found[-1] = slice(found[-1].start, place + 1)
        else:
            found.append(slice(place, place + 1))
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _ReplayLane:
    """One lane: a variant, what it follows, and its row in each channel of that."""

    variant: Variant
    replayed: Replayed
    row: int

    @property
    def run(self) -> RecordedRun:
        """The run that is followed."""
        return self.replayed.run

    def follows(self, other: "_ReplayLane") -> bool:
        """Return whether the lane's row is the next one after another's."""
        return self.replayed is other.replayed and self.row == other.row + 1

    def rows(self, places: slice) -> dict[str, FloatArray]:
        """Return, in each channel, the rows of as many lanes that begin with this one."""
        last = self.row + places.stop - places.start
        return {name: own[self.row : last] for name, own in self.replayed.channels.items()}

    def read_apart(self) -> None:
        """Move readings, in place, to the zeros that encoders count from, and to when table and force are read."""
        channels = self.replayed.channels
        if DEFLECTION in channels:
            deflection, share = channels[DEFLECTION][self.row], self.variant.plant.table_read_late_s / self.run.period_s
            if self.variant.zeros_apart_m != 0.0:
                deflection += self.variant.zeros_apart_m
            if share != 0.0:
                # Of a table that is read late the stepper has what it has moved by at its speed.
                deflection[1:-1] -= 0.5 * share**2 * np.diff(channels[POSITION][self.row], 2)
        share = self.variant.force_read_late_s / self.run.period_s
        if share != 0.0:
            force = channels[FORCE][self.row]
            force[1:] -= share * np.diff(force)

    def held(self) -> dict[str, float]:
        """Return the integral of the controller and the stretch of the screw that hold what the run begins with.

        Of a run that begins in motion a position loop forgets what was in the integral; without one, where the axis is
        depends on it for good.
        """
        plant, gains = self.variant.plant, self.variant.plant.controller.rows()
        held_N, command = self.run.held_force_N, self.run.command[0]
        force_N = held_N if held_N != 0.0 or gains.get("POSITION_GAIN", 0.0) > 0.0 else self.run.carried_force_N
        if force_N == 0.0 or gains.get("INTEGRAL_GAIN", 0.0) == 0.0:
            return {}
        position_m, velocity_m_per_s = self.run.start
        error = gains["POSITION_GAIN"] * (float(command[0]) - position_m) - velocity_m_per_s
        error += gains["VELOCITY_FEEDFORWARD"] * float(command[1])
        ahead_N = gains["ACCELERATION_FEEDFORWARD"] * float(command[2])
        integral = (force_N - ahead_N - gains["VELOCITY_GAIN"] * error) / gains["INTEGRAL_GAIN"]
        if held_N == 0.0:
            return {"INTEGRAL": integral}
        stretch_m = 0.0 if plant.screw is None else force_N / plant.screw.stiffness_N_per_m
        if plant.controller.uses_table:
            return {"INTEGRAL": integral, **dict.fromkeys(("X_M", "LAST_MOTOR"), position_m + stretch_m)}
        return {"INTEGRAL": integral, **dict.fromkeys(("X_T", "LAST_TABLE"), position_m - stretch_m)}
