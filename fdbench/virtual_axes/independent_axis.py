"""Tiers B, C and D: an axis of the second implementation, and what ``independent_axis.toml`` says can be injected."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import final

import numpy as np

from fdbench.compilation import kept
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.errors import SpecError
from fdbench.plants._controllers import Cascade
from fdbench.plants.feed_drive import RotaryMotor
from fdbench.record import FloatArray
from fdbench.specification import load_toml, read
from fdbench.virtual_axes import independent_simulator
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

# The simulator knows nothing of this package, which keeps the machine code of it all.
kept(independent_simulator.march)

FILE = Path(__file__).with_name("independent_axis.toml")
COLOUR = 0.4
FRICTION_CHANGE = (0.03, 0.05)  # from run to run, standard deviation
LATENCY = (0.01, 0.05)  # of a control period
SLIDING = (0.9, 1.1)  # transition velocity against the nominal one


@dataclass(frozen=True, kw_only=True)
class Injectable:
    """What can be injected: how fields of `independent_simulator.Imperfections` are drawn, and what it excludes."""

    name: str
    draw: Mapping[str, tuple[float, float]]
    choices: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    signed: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ()
    wrong_nominal_value: bool = False


@dataclass(frozen=True, kw_only=True)
class Injectables:
    """What stands in ``independent_simulator.toml``."""

    listed: tuple[Injectable, ...]
    unlisted: tuple[Injectable, ...]


@lru_cache(maxsize=1)
def injectables() -> Injectables:
    """Return what the second implementation can plant."""
    return read(Injectables, load_toml(FILE), FILE.name)


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class IndependentAxis:
    """An axis of the second implementation; in each run its friction differs by a share of its own."""

    machine: independent_simulator.IdealAxis
    loop: independent_simulator.CascadeLoop
    sensors: independent_simulator.Disturbances
    wrong: independent_simulator.Imperfections
    friction_change: float
    period_s: float

    def readings(self, reference: FloatArray, rng: np.random.Generator | None) -> dict[str, FloatArray]:
        """Return what a logger writes; see `fdbench.virtual_axes.bench.Axis`."""
        sensors, change, used = self.sensors, 0.0, rng
        if used is None:
            sensors = sensors._replace(position_noise_m=0.0, force_noise_N=0.0, process_force_N=0.0)
            used = np.random.default_rng(0)
        else:
            change = self.friction_change * float(np.clip(used.standard_normal(), -2.5, 2.5))
        return independent_simulator.simulate(
            self.machine, self.loop, sensors, self.wrong, reference, self.period_s, used, change
        )


@final
class IndependentBench(Bench):
    """A machine of the second implementation; see `fdbench.virtual_axes.library_axis.LibraryBench` for the parameters.

    The nominal model has one known effect, sliding friction with a transition velocity, and a cascade. What no model
    has (latency, colour of the noise, transition velocity) is drawn.
    """

    known = MappingProxyType({**KNOWN, "transition_velocity": 0.06, "loop_lag": 0.03})

    def __init__(
        self, nominal: Nominal, errors: Mapping[str, float], period_s: float, rng: np.random.Generator
    ) -> None:
        control = nominal.drive.controller
        if not isinstance(control, Cascade):
            raise SpecError("plant.controller: the second implementation has a cascade.")
        self.drive = nominal.drive
        self.errors = errors
        self.sliding = between(rng, *SLIDING)
        self.loop = independent_simulator.CascadeLoop(
            position_gain_per_s=control.position_gain_per_s,
            velocity_gain_N_s_per_m=control.velocity_gain_N_s_per_m,
            integral_gain_N_per_m=control.integral_gain_N_per_m,
            force_limit_N=control.force_limit_N,
            reads_table=float(control.uses_table),
        )
        self.sensors = independent_simulator.Disturbances(
            position_noise_m=POSITION_NOISE_M,
            force_noise_N=FORCE_NOISE_N,
            process_force_N=PROCESS_FORCE_N,
            colour=COLOUR,
            latency=between(rng, *LATENCY),
        )
        self.friction_change = between(rng, *FRICTION_CHANGE)
        self.period_s = period_s
        self.injectables = {item.name: item for item in (*injectables().listed, *injectables().unlisted)}

    def names(self, listed: bool) -> list[str]:
        """Return the names in ``independent_simulator.toml``."""
        return [item.name for item in (injectables().listed if listed else injectables().unlisted)]

    def draw(self, name: str, rng: np.random.Generator) -> dict[str, float]:
        """Return drawn fields of `independent_simulator.Imperfections`."""
        plant = self.injectables[name]
        found = {key: between(rng, *bounds) for key, bounds in plant.draw.items()}
        found |= {key: -found[key] for key in plant.signed if rng.random() < 0.5}
        return found | {key: float(rng.choice(values)) for key, values in plant.choices.items()}

    def clash(self, name: str, other: str) -> bool:
        """Return whether one excludes the other."""
        return other in self.injectables[name].excludes or name in self.injectables[other].excludes

    def add_background(self, detectability: Detectability, rng: np.random.Generator) -> None:
        """Add nothing: latency, coloured noise and friction that changes from run to run are there already."""

    def without_background(self) -> "IndependentBench":
        """Return the machine itself, to which nothing was added."""
        return self

    def is_nominal_parameter(self, name: str) -> bool:
        """Return what ``independent_simulator.toml`` says."""
        return self.injectables[name].wrong_nominal_value

    def axis(self, injected: Injected, change: Mapping[str, float] = NOTHING) -> IndependentAxis:
        """Return the machine with imperfections."""
        errors = {name: error + change.get(name, 0.0) for name, error in self.errors.items()}
        values = {key: value for parameters in injected.values() for key, value in parameters.items()}
        weight_N = values.get("weight_N", 0.0) + errors["offset_N"]
        return IndependentAxis(
            machine=self._machine(errors),
            loop=self.loop,
            sensors=self.sensors,
            wrong=independent_simulator.Imperfections(**values | {"weight_N": weight_N}),
            friction_change=self.friction_change,
            period_s=self.period_s,
        )

    def _machine(self, errors: Mapping[str, float]) -> independent_simulator.IdealAxis:
        motor, table, screw = self.drive.motor, self.drive.table, self.drive.screw
        if not isinstance(motor, RotaryMotor) or table is None or screw is None:
            raise SpecError("plant: the second implementation has a rotary motor, a table and an elastic screw.")
        (known,) = self.drive.effects
        friction_N, transition_m_per_s = known.values()
        return independent_simulator.IdealAxis(
            motor_mass_kg=motor.mass_kg * (1.0 + errors["motor_mass"]),
            table_mass_kg=table.mass_kg * (1.0 + errors["table_mass"]),
            motor_viscous_N_s_per_m=motor.viscous_friction_N_s_per_m * (1.0 + errors["motor_viscous"]),
            table_viscous_N_s_per_m=table.viscous_friction_N_s_per_m * (1.0 + errors["table_viscous"]),
            stiffness_N_per_m=screw.stiffness_N_per_m,
            damping_N_s_per_m=screw.damping_N_s_per_m,
            sliding_friction_N=friction_N * (1.0 + errors["known"]),
            sliding_velocity_m_per_s=transition_m_per_s * self.sliding,
            lead_m=motor.lead_m,
        )
