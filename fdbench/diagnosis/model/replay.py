"""Replay: simulate the command of a run on many variants of the model at once, with one stepper of all effects."""

import copy
import dataclasses
import os
from collections.abc import Iterator, Sequence
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
from fdbench.simulate.compose import compose, core_effects

Lanes = WeakKeyDictionary["Variant", dict[float, tuple[FloatArray, NDArray[np.bool_]]]]

WIDTH = 8  # few effects in a block beat many lanes in it
PIECE = 1024  # samples simulated at once, which stay in the processor's cache


@dataclass(frozen=True, kw_only=True, eq=False)
class Variant:
    """One lane: a plant, perhaps re-calibrated, with effects that the nominal model lacks."""

    plant: FeedDrive
    extra: tuple[Effect, ...] = field(default=())

    def kinds(self) -> frozenset[type[Effect]]:
        """Return the classes of the extra effects."""
        return frozenset(effect.declared for effect in self.extra)


@lru_cache(maxsize=4096)
def _mechanics(plant: FeedDrive) -> Mechanics:
    return dataclasses.replace(plant.mechanics(), position_limit_m=np.inf, velocity_limit_m_per_s=np.inf)


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
    """

    def __init__(self, drive: FeedDrive, library: Sequence[type[Effect]], substeps: int) -> None:
        self.library = tuple(library)
        self.substeps = substeps
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
        self._uniform = max(1, sum(kind.random for kind in self.kinds))
        self._last = {kind: place for place, kind in enumerate(self.kinds)}  # of a kind, is no known one
        self._stepper = compose(self.kinds, WIDTH)
        self._lanes: Lanes = WeakKeyDictionary()

    def simulate(self, run: RecordedRun, variants: Sequence[Variant]) -> dict[str, FloatArray]:
        """Return each channel of the run as simulated, (n_variants, n_samples); not finite where a variant diverges.

        Readings are free of noise; every variant starts from the measured position and velocity.
        """
        order = sorted(range(len(variants)), key=lambda index: sorted(kind.name for kind in variants[index].kinds()))
        result = {name: np.empty((len(variants), run.n_samples)) for name in run.channels}
        blocks = [order[first : first + WIDTH] for first in range(0, len(order), WIDTH)]

        def advance(lanes: list[int]) -> None:
            for samples, columns in self._pieces(run, [variants[index] for index in lanes]):
                for name, values in result.items():
                    values[lanes, samples] = columns[name][:, : len(lanes)].T

        if len(blocks) == 1:
            advance(blocks[0])
        else:
            list(_threads().map(advance, blocks))
        return result

    def alone(self, run: RecordedRun, variant: Variant) -> dict[str, FloatArray]:
        """Return each channel of the run as one variant has it, (n_samples,)."""
        return {name: values[0] for name, values in self.simulate(run, [variant]).items()}

    def with_substeps(self, substeps: int) -> "Replay":
        """Return the simulator with another number of substeps."""
        found = copy.copy(self)
        found.substeps, found._lanes = substeps, WeakKeyDictionary()
        return found

    def _lane(self, variant: Variant, period_s: float) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the rows of a variant at rest, (n_rows,), and which kinds of effects it has; made once, then kept."""
        kept = self._lanes.setdefault(variant, {})
        if period_s not in kept:
            blocks = Blocks(self.kinds, 1, 1)
            blocks.set_mechanics(_mechanics(variant.plant), period_s / self.substeps)
            blocks.set_scalars({"LOGGED_PER_N": 1.0, **variant.plant.controller.rows()})
            active = np.zeros(len(self.kinds), dtype=np.bool_)
            known = zip(self._known, variant.plant.effects, strict=True)
            for place, effect in (*known, *((self._last[item.declared], item) for item in variant.extra)):
                active[place] = True
                blocks.set_effect(place, effect)
            kept[period_s] = blocks.values[0, :, 0], active
        return kept[period_s]

    def _pieces(self, run: RecordedRun, variants: Sequence[Variant]) -> Iterator[tuple[slice, dict[str, FloatArray]]]:
        """Yield each stretch of samples and the channels there, (n_samples, WIDTH)."""
        blocks = Blocks(self.kinds, WIDTH, WIDTH)
        lanes = [self._lane(variant, run.period_s) for variant in variants]
        lanes += [lanes[-1]] * (WIDTH - len(lanes))
        blocks.values[0] = np.stack([rows for rows, _ in lanes], axis=1)
        blocks.place(*run.start, run.period_s)
        active = np.logical_or.reduce([own for _, own in lanes])
        reference = np.ascontiguousarray(run.reference)
        normal = np.zeros((1, PIECE, layout.NORMAL_COLUMNS, WIDTH))
        uniform = np.ones((1, PIECE, self._uniform, WIDTH))
        out = np.empty((1, PIECE, layout.OUT_COLUMNS, WIDTH))
        calls = self._stepper.calls(active)
        feedback = layout.OUT_TABLE if self.drive.controller.uses_table else layout.OUT_MOTOR
        for start in range(0, run.n_samples, PIECE):
            n = min(PIECE, run.n_samples - start)
            self._stepper.advance(
                blocks.flat, 0, n, self.substeps, run.period_s, *calls, reference, normal, uniform, out
            )
            found = out[0, :n]
            yield (
                slice(start, start + n),
                {
                    "motor_force_N": found[:, layout.OUT_FORCE],
                    "position_m": found[:, feedback],
                    DEFLECTION: found[:, layout.OUT_MOTOR] - found[:, layout.OUT_TABLE],
                },
            )
