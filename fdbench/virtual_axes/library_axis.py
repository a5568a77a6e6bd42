"""Tier A: an axis that the package's own simulator moves, with effects of the library at drawn sizes.

Nothing here names an effect: what can be injected, and how large, follows from each effect's declarations.
"""

import copy
import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.records.runs import SIDES
from fdbench.effects import Effect, effects
from fdbench.motions import Motion
from fdbench.plants.feed_drive import FeedDrive, RotaryMotor
from fdbench.record import FloatArray
from fdbench.simulate.system import Noise, Setup, Timing
from fdbench.virtual_axes.bench import (
    FORCE_NOISE_N,
    KNOWN,
    NOTHING,
    POSITION_NOISE_M,
    PROCESS_FORCE_N,
    Bench,
    Detectability,
    Injected,
    between,
)

SUBSTEPS = 40
BACKGROUND = 0.06  # of the typical size of every effect that is not injected, at most
TRACE = 0.1  # mean square of such an effect in any motion, in units of the noise, at most
SIZES = (0.4, 2.5)  # of the typical size
BEYOND_UNCERTAINTY = 2.0  # times the typical size, of effects that correct a nominal parameter
SIZES_BEYOND_UNCERTAINTY = (
    1.3,
    3.0,
)  # of effects that correct a nominal parameter, so that they exceed its uncertainty


@dataclass(frozen=True, kw_only=True)
class Noises:
    """Standard deviations of each sample, and of the share by which the friction of a run differs."""

    motor_position_m: float = POSITION_NOISE_M
    table_position_m: float = POSITION_NOISE_M
    force_N: float = FORCE_NOISE_N
    process_force_N: float = PROCESS_FORCE_N
    friction_change: float = 0.0


USUAL = Noises()


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Tabulated(Motion):
    """A command given as an (n_samples, 3) array."""

    name: ClassVar[str] = "tabulated"
    values: FloatArray

    def reference(self, period_s: float, n_samples: int) -> FloatArray:
        """Return the command; clock and length are its own."""
        return self.values


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class LibraryAxis:
    """An axis with one effect of every class of the library, most of them small or none."""

    drive: FeedDrive
    unmodelled: tuple[Effect, ...]
    period_s: float
    noises: Noises = USUAL
    substeps: int = SUBSTEPS

    def readings(self, reference: FloatArray, rng: np.random.Generator | None) -> dict[str, FloatArray]:
        """Return what a logger writes; see `fdbench.virtual_axes.bench.Axis`."""
        on = 0.0 if rng is None else 1.0
        drive, noises = self.drive, self.noises
        if rng is not None and noises.friction_change > 0.0:
            drive = rubbing(drive, 1.0 + noises.friction_change * float(np.clip(rng.standard_normal(), -2.5, 2.5)))
        # A force of one period changes the speed of the whole mass.
        kick_m_per_s = noises.process_force_N * self.period_s / self.drive.mass_kg
        duration_s = len(reference) * self.period_s
        setup = Setup(
            timing=Timing(sampling_time_s=self.period_s, duration_s=duration_s, substeps=self.substeps),
            motion=Tabulated(values=reference),
            noise=Noise(
                motor_position_m=on * noises.motor_position_m,
                table_position_m=on * noises.table_position_m,
                equation_velocity_m_per_s=on * kick_m_per_s,
                through_encoders=True,
            ),
            unmodelled=self.unmodelled,
        )
        axis = drive.system(setup)
        for index, effect in enumerate(self.unmodelled, len(drive.effects)):
            axis.enable(
                index, any(getattr(effect, name) != 0.0 for name in (effect.amplitude, *effect.further_amplitudes))
            )
        axis.start([0 if rng is None else int(rng.integers(2**31))])
        rows = axis.advance(len(reference))[:, :, 0]
        columns = dict(zip(axis.columns, rows.T, strict=False))
        force = columns[self.drive.motor.logged] * self.drive.motor.force_per_unit
        if rng is not None:
            force = force + noises.force_N * rng.standard_normal(len(force))
        return {name: columns[name] for name in ("position_m", *SIDES) if name in columns} | {"motor_force_N": force}


@final
class LibraryBench(Bench):
    """A machine of the package's simulator.

    Parameters
    ----------
    nominal : Nominal
        The nominal model.
    errors : mapping of str to float
        By how much the nominal parameters are off; see `fdbench.virtual_axes.bench.ERRORS`.
    period_s : float
    noises : Noises
    substeps : int
        Of its integration.
    """

    known = KNOWN

    def __init__(
        self,
        nominal: Nominal,
        errors: Mapping[str, float],
        period_s: float,
        noises: Noises = USUAL,
        substeps: int = SUBSTEPS,
    ) -> None:
        self.drive = nominal.drive
        self.errors = errors
        self.period_s = period_s
        self.noises, self.substeps = noises, substeps
        self.kinds = [kind for kind in nominal.library if self.drive.screw is not None or not kind.needs_screw]
        self.background = {kind.name: kind.typical().scaled(0.0) for kind in self.kinds}

    def add_background(self, detectability: Detectability, rng: np.random.Generator) -> None:
        """Add a little of every effect, except where a nominal parameter or a known effect stands for it."""
        background = dict(self.background)
        for kind in self.kinds:
            if kind.calibrates or self._replaced(kind) is not None:
                continue
            phases = {item.name: float(rng.uniform(-math.pi, math.pi)) for item in kind.parameters() if item.phase}
            most = kind.typical(**phases).scaled(BACKGROUND)
            values = {item.name: float(getattr(most, item.name)) for item in kind.parameters()}
            visible = detectability.mean_square(self.axis({kind.name: values}), beside_nominal_errors=False)
            background[kind.name] = most.scaled(float(rng.uniform()) * min(1.0, math.sqrt(TRACE / max(visible, 1e-12))))
        self.background = background

    def without_background(self) -> "LibraryBench":
        """Return the machine with nothing of the effects that are not injected."""
        bench = copy.copy(self)
        bench.background = {kind.name: kind.typical().scaled(0.0) for kind in self.kinds}
        return bench

    def names(self, listed: bool) -> list[str]:
        """Return the names of the library; it has nothing that a diagnosis may not name."""
        return [kind.name for kind in self.kinds if kind.calibrates != "friction_form"] if listed else []

    def typical(self, name: str) -> Effect:
        """Return an effect at its typical size, or the one that replaces a known effect.

        What corrects a nominal parameter is larger, as it is no cause within the uncertainty of that parameter.
        """
        kind = effects.get(name)
        index = self._replaced(kind)
        effect = kind.typical() if index is None else kind.in_place_of(self.drive.effects[index]) or kind.typical()
        return effect.scaled(BEYOND_UNCERTAINTY) if kind.calibrates else effect

    def draw(self, name: str, rng: np.random.Generator) -> dict[str, float]:
        """Return a drawn size, phase and shape; what a diagnosis cannot search for stays typical."""
        kind = effects.get(name)
        index = self._replaced(kind)
        replacement = None if index is None else kind.in_place_of(self.drive.effects[index])
        typical = kind.typical() if replacement is None else replacement
        sizes = SIZES_BEYOND_UNCERTAINTY if kind.calibrates else SIZES
        return drawn_shape(kind, typical, rng, sizes if replacement is None else None)

    def clash(self, name: str, other: str) -> bool:
        """Return whether one effect replaces what the other corrects."""
        one, two = effects.get(name), effects.get(other)
        return any(
            self._replaced(a) is not None and b.calibrates == "known_effects" for a, b in ((one, two), (two, one))
        )

    def is_nominal_parameter(self, name: str) -> bool:
        """Return what the effect declares."""
        return bool(effects.get(name).calibrates)

    def axis(self, injected: Injected, change: Mapping[str, float] = NOTHING) -> LibraryAxis:
        """Return the machine with effects, and a little of all others."""
        drive, errors = self.drive, {name: error + change.get(name, 0.0) for name, error in self.errors.items()}
        others = self.background | {
            kind.name: kind.typical(**{kind.amplitude: errors["offset_N"]})
            for kind in self.kinds
            if kind.calibrates == "force_offset"
        }
        own = others | {name: effects.get(name)(**parameters) for name, parameters in injected.items()}
        gone = {self._replaced(effects.get(name)) for name in injected}
        motor: Any = drive.motor
        inertia = "inertia_kg_m2" if isinstance(motor, RotaryMotor) else "mass_kg"
        motor = _off(motor, {inertia: errors["motor_mass"], "viscous_friction_N_s_per_m": errors["motor_viscous"]})
        table = drive.table
        if table is not None:
            table = _off(
                table, {"mass_kg": errors["table_mass"], "viscous_friction_N_s_per_m": errors["table_viscous"]}
            )
        known = tuple(
            item.scaled(0.0 if index in gone else 1.0 + errors["known"]) for index, item in enumerate(drive.effects)
        )
        return LibraryAxis(
            drive=dataclasses.replace(drive, motor=motor, table=table, effects=known),
            unmodelled=tuple(own[kind.name] for kind in self.kinds),
            period_s=self.period_s,
            noises=self.noises,
            substeps=self.substeps,
        )

    def _replaced(self, kind: type[Effect]) -> int | None:
        """Return the index of the known effect that a class takes the place of."""
        known = enumerate(self.drive.effects)
        return next((index for index, item in known if kind.in_place_of(item) is not None), None)


def as_logged(
    readings: Mapping[str, FloatArray], effect: Effect, rng: np.random.Generator, period_s: float
) -> dict[str, FloatArray]:
    """Return readings as a logger with an effect writes them; the first sample is never repeated."""
    fresh = np.arange(len(readings["motor_force_N"]))
    before = 0.0
    for index in range(1, len(fresh)):
        chance = (rng.random(),) if effect.random else ()
        before = type(effect).kernel(index * period_s, period_s, 0.0, 0.0, before, *chance, *effect.values())[0]
        fresh[index] = 0 if before else index
    fresh = np.maximum.accumulate(fresh)
    return {name: values[fresh] for name, values in readings.items()}


def rubbing(drive: FeedDrive, factor: float) -> FeedDrive:
    """Return the drive with all friction that its model knows multiplied."""
    parts = {name: part for name in ("motor", "table") if (part := getattr(drive, name)) is not None}
    moved: dict[str, Any] = {
        name: _off(part, {"viscous_friction_N_s_per_m": factor - 1.0}) for name, part in parts.items()
    }
    return dataclasses.replace(drive, **moved, effects=tuple(item.scaled(factor) for item in drive.effects))


def _off(part: Any, errors: Mapping[str, float]) -> Any:
    return dataclasses.replace(part, **{name: getattr(part, name) * (1.0 + error) for name, error in errors.items()})


def drawn_shape(
    kind: type[Effect], typical: Effect, rng: np.random.Generator, sizes: tuple[float, float] | None
) -> dict[str, float]:
    """Return parameters with drawn phases and shape, and factors within ``sizes`` on amplitudes unless that is None.

    What a diagnosis cannot search for stays typical.
    """
    is_value = kind.calibrates not in ("", "force_offset")  # a lower one could leave less than none
    amplitudes = () if sizes is None else (kind.amplitude, *kind.further_amplitudes)
    found: dict[str, float] = {}
    for item in kind.parameters():
        value = float(getattr(typical, item.name))
        if sizes is not None and item.name in amplitudes:
            sign = -1.0 if item.low < 0.0 and not is_value and rng.random() < 0.5 else 1.0
            value *= sign * between(rng, *sizes)
        elif item.whole and item.grid:
            value = float(rng.choice(item.grid))
        elif item.phase:
            value = float(rng.uniform(-math.pi, math.pi))
        elif item.grid:
            value = between(rng, min(item.grid), max(item.grid))
        elif item.locate:
            value *= between(rng, 0.5, 2.0)
        found[item.name] = item.within(value)
    return kind.shape(found)
