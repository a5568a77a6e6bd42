"""Tiers F and G: foreign axes with imperfections, and the case that is recorded on one."""

import copy
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from fdbench.record import FloatArray, Record
from fdbench.virtual_axes.bench import NOTHING, Bench, Detectability, Injected, between
from fdbench.virtual_axes.cases import Case, Tier, described, inject
from fdbench.virtual_axes.foreign import loops, mechanics
from fdbench.virtual_axes.foreign.kinds import (
    CONSTANT_ERROR,
    ERRORS,
    FORMS,
    GAIN_ERROR,
    WEIGHT_ERROR,
    AxisKind,
    body_of,
    imperfections,
    kinds,
    loop_of,
    model_of,
    nominal_values,
    scales,
    space_of,
)
from fdbench.virtual_axes.foreign.motions import RECIPES

NUMBERS = ((0, 0), (1, 0), (2, 0), (0, 1))  # of listed and unlisted effects
LISTED_PAIR = 0.08
NOTHING_PLANTED = 0.36
HELD_OUT = 0.6  # probability of a held-out motion
PROCESS_NOISE, PROCESS_COLOUR = 0.01, 0.9  # share of the friction, and correlation of neighbours
TRACE = (0.02, 0.3)  # mean square of each effect of the background, in units of the noise
HARMONIC = {Tier.F: 0.25, Tier.G: 0.1}
SQUARE_HZ, CHIP_TIME_S = 1.7, 0.05
STEEPEST = 0.1225  # of its signal period, by which an encoder may err and its reading still rises with the position
PROCESS = ("square_N", "thrust_N")


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignAxis:
    """An axis of a kind; in each run its friction differs by a share of its own."""

    kind: AxisKind
    value: Mapping[str, float]
    body: mechanics.Body
    loop: loops.ForeignLoop
    wrong: mechanics.Wrong

    def readings(self, reference: FloatArray, rng: np.random.Generator | None) -> dict[str, FloatArray]:
        """Return what is read in each control cycle; see `fdbench.virtual_axes.bench.Axis`.

        A machine without a loop is held by one here, so that forces along one motion can be compared.
        """
        loop = self.loop._replace(form=FORMS["cascade"]) if self.kind.is_open else self.loop
        return self._march(np.column_stack((reference, np.zeros(len(reference)))), loop, rng)

    def recorded(self, reference: FloatArray, rng: np.random.Generator) -> dict[str, FloatArray]:
        """Return what is read under the machine's own command: without a loop, forces that about give the motion."""
        speed, rate = reference[:, 1], reference[:, 2]
        body = self.body
        force = (body.motor_mass_kg + body.table_mass_kg) * rate + body.table_viscous_N_s_per_m * speed
        force += body.table_friction_N * np.sign(np.where(np.abs(speed) < 1e-6, 0.0, speed))
        force /= self.loop.force_constant_ratio
        return self._march(np.column_stack((reference, force)), self.loop, rng)

    def process_force(self, reference: FloatArray) -> FloatArray:
        """Return the force of the process (n,): in some motions a square wave, or the thrust of a drill."""
        n, period = len(reference), self.kind.period_s
        if zlib.crc32(reference.tobytes()) % 3 == 0:
            return np.zeros(n)
        t, position = np.arange(n) * period, reference[:, 0]
        square = np.where((t * SQUARE_HZ) % 1.0 < 0.5, 0.0, self.wrong.square_N)
        deep = (position > position.min() + 0.4 * np.ptp(position)) & (reference[:, 1] > 0.0)
        share = period / (period + CHIP_TIME_S)
        thrust, level = np.empty(n), 0.0
        for index, cuts in enumerate(deep.tolist()):
            level += share * (float(cuts) - level)
            thrust[index] = level
        return np.asarray(square + self.wrong.thrust_N * thrust)

    def _march(
        self, command: FloatArray, loop: loops.ForeignLoop, rng: np.random.Generator | None
    ) -> dict[str, FloatArray]:
        n, value = len(command), self.value
        outer, noise, scale = self.process_force(command[:, :3]), np.zeros((n, 3)), 1.0
        if rng is not None:
            scale += value["friction_change"] * float(np.clip(rng.standard_normal(), -2.5, 2.5))
            sizes = (value["position_noise_m"],) * 2 + (value["force_noise_share"] * value["friction_N"],)
            noise = rng.standard_normal((n, 3)) * sizes
            outer = outer + PROCESS_NOISE * value["friction_N"] * correlated(rng, n)
        stops_N = np.array((0.6, 0.4)) * self.wrong.loop_N
        stops_m = np.array((0.5, 1.5)) * self.wrong.loop_m
        out = loops.march(
            self.body,
            self.wrong,
            loop,
            np.ascontiguousarray(command),
            outer,
            noise,
            stops_N,
            stops_m,
            scale,
            self.kind.period_s,
            self.kind.steps,
        )
        return dict(zip(("motor_position_m", "table_position_m", "motor_force_N"), out.T.copy(), strict=True))


def correlated(rng: np.random.Generator, n: int) -> FloatArray:
    """Return n samples of unit variance whose neighbours have the correlation ``PROCESS_COLOUR``."""
    fresh = rng.standard_normal(n) * np.sqrt(1.0 - PROCESS_COLOUR**2)
    last, found = float(rng.standard_normal()), np.empty(n)
    for index, value in enumerate(fresh.tolist()):
        last = PROCESS_COLOUR * last + value
        found[index] = last
    return found


@final
class ForeignBench(Bench):
    """A machine of a kind.

    Parameters
    ----------
    kind : AxisKind
    tier : Tier
        F or G, which draw from other ranges.
    rng : numpy Generator
    """

    nominal_errors: ClassVar[Mapping[str, float]] = ERRORS

    def __init__(self, kind: AxisKind, tier: Tier, rng: np.random.Generator) -> None:
        self.kind, self.tier = kind, tier
        self.value = nominal_values(kind, tier is Tier.F, rng)
        sizes = {
            **ERRORS,
            "weight": WEIGHT_ERROR,
            "constant": CONSTANT_ERROR,
            **dict.fromkeys(("position_gain_per_s", "velocity_gain_N_s_per_m", "integral_gain_N_per_m"), GAIN_ERROR),
        }
        self.errors = {name: size * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for name, size in sizes.items()}
        fields = {"pitch_m": "pitch_m", "division_period_m": "division_period_m", "lead_m": "screw_period_m"}
        own = {field: self.value[name] for name, field in fields.items() if name in self.value}
        self.always = {**own, "third_harmonic": HARMONIC[tier]}
        self.background: dict[str, dict[str, float]] = {}
        found = imperfections()
        self.items = {item.name: item for item in (*found.listed, *found.unlisted)}

    def names(self, listed: bool) -> list[str]:
        """Return what this kind can have."""
        if not listed:
            return list(self.kind.unlisted)
        found = [item for item in imperfections().listed if self.kind.is_elastic or not item.needs_two_masses]
        return [item.name for item in found if item.name not in self.kind.without]

    def draw(self, name: str, rng: np.random.Generator) -> dict[str, float]:
        """Return drawn fields of `mechanics.Wrong`; no encoder reads backwards on the way forwards."""
        item, units = self.items[name], scales(self.value)
        found = {key: between(rng, *bounds) for key, bounds in item.draw.items()}
        found |= {key: found[key] * units[unit] for key, unit in item.scale.items()}
        if "division_m" in found:
            period_m = self.always.get("division_period_m", mechanics.Wrong().division_period_m)
            found["division_m"] = min(found["division_m"], STEEPEST * period_m)
        return found | {key: -found[key] for key in item.signed if rng.random() < 0.5}

    def clash(self, name: str, other: str) -> bool:
        """Return whether one excludes the other."""
        return other in self.items[name].excludes or name in self.items[other].excludes

    def is_nominal_parameter(self, name: str) -> bool:
        """Return what ``imperfections.toml`` says."""
        return self.items[name].wrong_nominal_value

    def add_background(self, detectability: Detectability, rng: np.random.Generator) -> None:
        """Add a little cogging, ripple of the friction and error of screw or encoder, each below the noise."""
        own = [item for item in imperfections().listed if self.kind.is_elastic in item.background]
        # What every axis has is drawn first.
        for name in [item.name for item in sorted(own, key=lambda item: -len(item.background))]:
            drawn = self.draw(name, rng)
            size = detectability.mean_square(self.axis({name: drawn}), beside_nominal_errors=True)
            amplitude = next(iter(self.items[name].draw))
            share = np.sqrt(between(rng, *TRACE) / max(size, 1e-12))
            self.background[name] = drawn | {amplitude: drawn[amplitude] * min(1.0, float(share))}
            detectability.beside(self.axis({}))

    def without_background(self) -> "ForeignBench":
        """Return the machine without its cogging, ripple of the friction and error of screw or encoder."""
        bench = copy.copy(self)
        bench.background = {}
        return bench

    def axis(self, injected: Injected, change: Mapping[str, float] = NOTHING) -> ForeignAxis:
        """Return the machine with imperfections."""
        errors = {name: error + change.get(name, 0.0) for name, error in self.errors.items()}
        values = dict(self.always)
        for parameters in (*self.background.values(), *injected.values()):
            values |= parameters
        return ForeignAxis(
            kind=self.kind,
            value=self.value,
            body=body_of(self.kind, self.value, errors),
            loop=loop_of(self.kind, self.value, errors),
            wrong=mechanics.Wrong(**values),
        )


def draw_foreign_case(tier: Tier, number: int, effects: Sequence[str], rng: np.random.Generator) -> Case:
    """Draw, record and describe one case; the kinds take turns.

    Parameters
    ----------
    tier : Tier
        F or G.
    number : int
        Of the case in its trial.
    effects : sequence of str
        Names that a diagnosis may give.
    rng : numpy Generator

    Raises
    ------
    SimulationDiverged
        If no effect that was drawn shows in the motions.
    """
    kind = kinds()[number % len(kinds())]
    bench = ForeignBench(kind, tier, rng)
    space = space_of(kind, bench.value)

    def command(name: str) -> FloatArray:
        return loops.as_used(FORMS[kind.form], RECIPES[name](space, rng), kind.period_s)

    commands = {name: command(name) for name in kind.motions}
    other = {"other": command("other")} if rng.random() < HELD_OUT else {}
    single = 1.0 - NOTHING_PLANTED - LISTED_PAIR - kind.unlisted_probability
    chances = (NOTHING_PLANTED, single, LISTED_PAIR, kind.unlisted_probability)
    numbers = NUMBERS[int(rng.choice(len(NUMBERS), p=chances))]
    sides = ("motor_position_m", "table_position_m")
    seen = sides if kind.columns == "both_positions" else sides[-1:] if kind.feedback == "table" else sides[:1]
    injected, sizes = inject(bench, numbers, effects, list(commands.values()), seen, rng)
    axis = bench.axis(injected)
    repeats = int(rng.integers(1, 4))
    records = {
        f"{name}_{repeat + 1}": record_of(axis, name, reference, seen, rng)
        for name, reference in commands.items()
        for repeat in range(repeats)
    }
    holdouts = {name: record_of(axis, name, reference, seen, rng) for name, reference in other.items()}
    truth: dict[str, Any] = {
        "tier": tier.value,
        "kind": kind.name,
        **described(injected, sizes, bench.names(listed=True)),
        "errors": bench.errors,
        "background": bench.background,
        "repeats": repeats,
    }
    return Case(
        model=model_of(kind, bench.value),
        records=records,
        holdouts=holdouts,
        truth=truth,
        file_format=kind.file_format,
    )


def record_of(
    axis: ForeignAxis, name: str, reference: FloatArray, seen: tuple[str, ...], rng: np.random.Generator
) -> Record:
    """Return what the logger of the machine writes of a motion."""
    kind, value = axis.kind, axis.value
    every = slice(None, None, kind.log_every)
    found = axis.recorded(reference, rng)
    columns = {"time_s": np.asarray(np.arange(len(reference))[every] * kind.period_s, dtype=np.float64)}
    commands = ("reference_position_m", "reference_velocity_m_per_s", "reference_acceleration_m_per_s2")
    given = {"full": 3, "position": 1, "none": 0}[kind.command]
    columns |= {column: reference[every, index] for index, column in enumerate(commands[:given])}
    columns["position_m"] = found[seen[0]][every]
    columns |= {side: found[side][every] for side in seen if len(seen) > 1}
    per_unit = 1.0 if kind.motor == "linear" else mechanics.TURN / value["lead_m"]
    if kind.logs == "motor_current_A":
        per_unit *= next(value[key] for key in value if key.endswith("_per_A"))
    columns[kind.logs] = found["motor_force_N"][every] / per_unit
    return Record(columns, source=name)
