"""Tier A: an axis that the package's own simulator moves, with effects of the library at drawn sizes.

Nothing here names an effect: what can be planted, and how large, follows from each effect's declarations.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fdbench.effects import Effect
from fdbench.gap.nominal import Nominal
from fdbench.motions import Motion
from fdbench.plants.feed_drive import FeedDrive, RotaryMotor
from fdbench.record import FloatArray
from fdbench.simulate.system import Noise, Setup, Timing

SUBSTEPS = 40
CLUTTER = 0.06  # of the typical size of every effect that is not planted
SIZES = (0.4, 2.5)  # of the typical size
SIZES_ON_PAPER = (1.3, 3.0)  # of effects that correct a value on paper, so that they exceed its uncertainty


@dataclass(frozen=True, kw_only=True, eq=False)
class Tabulated(Motion):
    """A command given as an (n_samples, 3) array."""

    name: ClassVar[str] = "tabulated"
    values: FloatArray

    def reference(self, period_s: float, n_samples: int) -> FloatArray:
        """Return the command; clock and length are its own."""
        return self.values


@dataclass(frozen=True, kw_only=True, eq=False)
class LibraryAxis:
    """An axis with planted effects.

    Attributes
    ----------
    drive : FeedDrive
        With its true values.
    unmodelled : tuple of Effect
        One of every class of the library.
    period_s, position_noise_m, force_noise_N : float
    """

    drive: FeedDrive
    unmodelled: tuple[Effect, ...]
    period_s: float
    position_noise_m: float
    force_noise_N: float

    def readings(self, reference: FloatArray, rng: np.random.Generator | None) -> dict[str, FloatArray]:
        """Return motor and table position (m) and motor force (N); without noise if there is no generator."""
        deviation = 0.0 if rng is None else self.position_noise_m
        setup = Setup(
            timing=Timing(sampling_time_s=self.period_s, duration_s=len(reference) * self.period_s, substeps=SUBSTEPS),
            motion=Tabulated(values=reference),
            noise=Noise(motor_position_m=deviation, table_position_m=deviation),
            unmodelled=self.unmodelled,
        )
        axis = self.drive.system(setup)
        axis.start([0 if rng is None else int(rng.integers(2**31))])
        rows = axis.advance(len(reference))[:, :, 0]
        columns = dict(zip(axis.columns, rows.T, strict=False))
        force = columns[self.drive.motor.logged] * self.drive.motor.force_per_unit
        if rng is not None:
            force = force + self.force_noise_N * rng.standard_normal(len(force))
        return {
            "motor_position_m": columns["motor_position_m"],
            "table_position_m": columns["table_position_m"],
            "motor_force_N": force,
        }


def plantable(nominal: Nominal) -> list[type[Effect]]:
    """Return the classes of effects that a trial may plant in an axis."""
    return [kind for kind in nominal.library if nominal.drive.screw is not None or not kind.needs_screw]


def replaced(kind: type[Effect], drive: FeedDrive) -> int | None:
    """Return the index of the known effect that a class takes the place of, or None."""
    return next((index for index, known in enumerate(drive.effects) if kind.in_place_of(known) is not None), None)


def drawn(kind: type[Effect], drive: FeedDrive, rng: np.random.Generator) -> Effect:
    """Return an effect at a drawn size, phase and shape; what a diagnosis cannot search for stays typical."""
    index = replaced(kind, drive)
    typical = kind.typical() if index is None else kind.in_place_of(drive.effects[index])
    if typical is None:
        typical = kind.typical()
    sizes = SIZES_ON_PAPER if kind.calibrates else SIZES
    amplitudes = (kind.amplitude, *kind.further_amplitudes) if index is None else ()
    changes: dict[str, float] = {}
    for item in kind.parameters():
        value = float(getattr(typical, item.name))
        if item.name in amplitudes:
            sign = float(rng.choice([-1.0, 1.0])) if item.low < 0.0 else 1.0
            value *= sign * _between(rng, *sizes)
        elif item.phase:
            value = float(rng.uniform(-math.pi, math.pi))
        elif item.locate:
            value *= _between(rng, 0.5, 2.0)
        elif item.grid:
            value = _between(rng, min(item.grid), max(item.grid))
        changes[item.name] = min(max(value, item.low), item.high)
    return typical.changed(**changes)


def clutter(kind: type[Effect], drive: FeedDrive, offset_N: float, rng: np.random.Generator) -> Effect:
    """Return an effect that is not planted: small, or none where a value on paper or a known effect stands for it."""
    if kind.calibrates == "force_offset":
        return kind.typical(**{kind.amplitude: offset_N})
    is_silent = bool(kind.calibrates) or replaced(kind, drive) is not None
    phases = {item.name: float(rng.uniform(-math.pi, math.pi)) for item in kind.parameters() if item.phase}
    return kind.typical(**phases).scaled(0.0 if is_silent else CLUTTER * float(rng.uniform()))


def true_drive(nominal: Nominal, planted: Sequence[Effect], errors: dict[str, float]) -> FeedDrive:
    """Return the drive with its values off by ``errors`` (shares), and without what planted effects take the place of.

    Parameters
    ----------
    errors : mapping
        ``motor_mass``, ``table_mass``, ``motor_viscous``, ``table_viscous``, ``known``.
    """
    drive = nominal.drive
    motor: Any = drive.motor
    inertia = "inertia_kg_m2" if isinstance(motor, RotaryMotor) else "mass_kg"
    motor = dataclasses.replace(
        motor,
        **{
            inertia: getattr(motor, inertia) * (1.0 + errors["motor_mass"]),
            "viscous_friction_N_s_per_m": motor.viscous_friction_N_s_per_m * (1.0 + errors["motor_viscous"]),
        },
    )
    table = drive.table
    if table is not None:
        table = dataclasses.replace(
            table,
            mass_kg=table.mass_kg * (1.0 + errors["table_mass"]),
            viscous_friction_N_s_per_m=table.viscous_friction_N_s_per_m * (1.0 + errors["table_viscous"]),
        )
    gone = {replaced(type(effect), drive) for effect in planted}
    known = tuple(
        item.scaled(0.0 if index in gone else 1.0 + errors["known"]) for index, item in enumerate(drive.effects)
    )
    return dataclasses.replace(drive, motor=motor, table=table, effects=known)
