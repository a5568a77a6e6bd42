"""Replay: simulate the commands of runs on many variants of the model at once, with one stepper of all effects."""

import copy
import dataclasses
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.records.runs import DEFLECTION, RecordedRun
from fdbench.effects import Effect
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray
from fdbench.simulate import layout
from fdbench.simulate.block import Blocks, Mechanics
from fdbench.simulate.compose import compose, core_effects, room_ahead

Lanes = WeakKeyDictionary["Variant", dict[float, tuple[FloatArray, NDArray[np.bool_]]]]

WIDTH = 8  # few effects in a block beat many lanes in it
PIECE = 1024  # samples worked on at once, which stay in the processor's cache


@dataclass(frozen=True, kw_only=True, eq=False)
class Variant:
    """One lane: a plant, perhaps re-calibrated, with effects that the nominal model lacks."""

    plant: FeedDrive
    extra: tuple[Effect, ...] = field(default=())

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
    return {name: np.empty((n_lanes, run.n_samples)) for name in run.channels}


class Memory:
    """Room for readings that is used again: pages of new arrays cost as much as what is simulated into them."""

    def __init__(self) -> None:
        self._arrays: dict[str, FloatArray] = {}

    def rooms(self, runs: Sequence[RecordedRun], n_lanes: int) -> list[dict[str, FloatArray]]:
        """Return what `room` returns of several runs, in arrays that are lent until rooms are asked for again."""
        ends = np.cumsum([n_lanes * run.n_samples for run in runs]).tolist()
        found: list[dict[str, FloatArray]] = [{} for _ in runs]
        for name in runs[0].channels:
            if name not in self._arrays or len(self._arrays[name]) < ends[-1]:
                self._arrays[name] = np.empty(ends[-1])
            for own, run, end in zip(found, runs, ends, strict=True):
                part = self._arrays[name][end - n_lanes * run.n_samples : end]
                own[name] = part.reshape(n_lanes, run.n_samples)
        return found


@lru_cache(maxsize=4096)
def _mechanics(plant: FeedDrive) -> Mechanics:
    return dataclasses.replace(plant.mechanics(), position_limit_m=np.inf, velocity_limit_m_per_s=np.inf)


def at_each_loop(reference: FloatArray, period_s: float, loops: int) -> FloatArray:
    """Return a command (n, 3) as a controller takes it that acts several times in a sampling time, (n * loops, 3).

    Positions and velocities are cubics between samples, accelerations straight lines.

    >>> at_each_loop(np.array([[0.0, 0.0, 2.0], [1.0, 2.0, 2.0]]), 1.0, 2)[1].tolist()
    [0.25, 1.0, 2.0]
    """
    if loops == 1:
        return reference
    after = np.vstack((reference[1:], reference[-1:]))
    rows = np.empty((len(reference), loops, 3))
    for place in range(loops):
        part = place / loops
        rise, leave, arrive = part**2 * (3.0 - 2.0 * part), part * (1.0 - part) ** 2, part**2 * (part - 1.0)
        rows[:, place] = reference + rise * (after - reference)
        rows[:, place, :2] += period_s * (leave * reference[:, 1:] + arrive * after[:, 1:])
        rows[:, place, 2] = reference[:, 2] + part * (after[:, 2] - reference[:, 2])
    return rows.reshape(-1, 3)


@lru_cache(maxsize=1)
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count(), "replay")


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
        self._no_noise = np.zeros((1, PIECE, layout.NORMAL_COLUMNS * WIDTH)), np.ones((1, PIECE, n_uniform, WIDTH))
        self._last = {kind: place for place, kind in enumerate(self.kinds)}  # of a kind, is no known one
        self._stepper = compose(self.kinds, WIDTH)
        self._lanes: Lanes = WeakKeyDictionary()
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
            _ReplayLane(
                variant=variant, run=item.run, channels={name: own[place] for name, own in item.channels.items()}
            )
            for item in replayed
            for variant, place in zip(item.variants, item.places, strict=True)
        ]
        lanes.sort(key=lambda lane: (sorted(kind.name for kind in lane.variant.kinds()), lane.run.n_samples))
        blocks = [lanes[first : first + WIDTH] for first in range(0, len(lanes), WIDTH)]
        if len(blocks) == 1:
            self._advance(blocks[0])
        else:
            list(_threads().map(self._advance, blocks))

    def alone(self, run: RecordedRun, variant: Variant) -> dict[str, FloatArray]:
        """Return each channel of the run as one variant has it, (n_samples,)."""
        return self.on_each([run], variant)[0]

    def on_each(self, runs: Sequence[RecordedRun], variant: Variant) -> list[dict[str, FloatArray]]:
        """Return for each of several runs what `alone` returns."""
        found = [room(run, 1) for run in runs]
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
        found.loops, found._lanes = loops, WeakKeyDictionary()
        return found

    def _lane(self, variant: Variant, period_s: float) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the rows of a variant at rest, (n_rows,), and which kinds of effects it has; made once, then kept."""
        kept = self._lanes.setdefault(variant, {})
        if period_s not in kept:
            blocks = Blocks(self.kinds, 1, 1)
            blocks.set_mechanics(_mechanics(variant.plant), period_s / (self.loops * self._steps_of_a_loop))
            blocks.set_scalars({"LOGGED_PER_N": 1.0, **variant.plant.controller.rows()})
            active = np.zeros(len(self.kinds), dtype=np.bool_)
            known = zip(self._known, variant.plant.effects, strict=True)
            for place, effect in (*known, *((self._last[item.declared], item) for item in variant.extra)):
                active[place] = True
                blocks.set_effect(place, effect)
            kept[period_s] = blocks.values[0, :, 0], active
        return kept[period_s]

    def _advance(self, lanes: Sequence["_ReplayLane"]) -> None:
        """Simulate one block, piece by piece."""
        cycle, n_loops = lanes[0].run.period_s / self.loops, self.loops
        runs = list({id(lane.run): lane.run for lane in lanes}.values())
        commands = [at_each_loop(run.reference, run.period_s, n_loops) for run in runs]
        first_rows = dict(zip(map(id, runs), np.cumsum([0, *map(len, commands)]).tolist(), strict=False))
        longest = max(map(len, commands))
        reference = np.concatenate([*commands, np.zeros((longest, 3))])
        made = [self._lane(lane.variant, lane.run.period_s) for lane in lanes]
        blocks = Blocks(self.kinds, WIDTH, WIDTH)
        blocks.values[0] = np.stack([rows for rows, _ in [*made, *[made[-1]] * (WIDTH - len(made))]], axis=1)
        for place, lane in enumerate(lanes):
            blocks.place(*lane.run.start, cycle, np.array([place]))
            blocks.set_scalars({"FIRST_ROW": first_rows[id(lane.run)]}, np.array([place]))
        active = np.logical_or.reduce([own for _, own in made])
        logged = np.arange(layout.OUT_COLUMNS)
        out = np.empty((PIECE, len(logged), 1, WIDTH))
        columns = out[::n_loops, :, 0].transpose(1, 2, 0)
        calls = self._stepper.calls(active)
        ahead = room_ahead(len(calls[0]), self._steps_of_a_loop)
        motor, scale = layout.OUT_MOTOR, layout.OUT_TABLE
        read_from = {
            "motor_force_N": layout.OUT_FORCE,
            "position_m": scale if self.drive.controller.uses_table else motor,
        }
        piece = PIECE // n_loops * n_loops
        for start in range(0, longest, piece):
            n = min(piece, longest - start)
            settings = self._steps_of_a_loop, cycle, *calls, ahead, reference, logged
            self._stepper.advance(blocks.flat, 0, n, *settings, *self._no_noise, out)
            first = start // n_loops
            for name in lanes[0].channels:
                found = columns[motor] - columns[scale] if name == DEFLECTION else columns[read_from[name]]
                for lane, values in zip(lanes, np.ascontiguousarray(found), strict=False):
                    read = lane.channels[name][first : first + -(-n // n_loops)]
                    read[:] = values[: len(read)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _ReplayLane:
    """One lane: a variant, the run that it follows, and each channel of it, (n_samples,), to be filled."""

    variant: Variant
    run: RecordedRun
    channels: Mapping[str, FloatArray]
