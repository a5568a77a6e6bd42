"""The nominal model that a gap is measured against: the nominal plant, and how well its values are known."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from fdbench.catalogue import scenario_folder, scenario_ids
from fdbench.diagnosis.model.rotary_axis import LINEAR_COLUMNS, plant_on_the_arc, record_on_the_arc
from fdbench.diagnosis.records.noise_model import Way
from fdbench.diagnosis.records.runs import COMMAND_RATES
from fdbench.diagnosis.records.spectral_lines import highest_Hz
from fdbench.diagnosis.settings import MODEL, RECORDS
from fdbench.effects import Effect, Scale, at_scale, effects
from fdbench.errors import RecordError, SpecError, UnknownName, did_you_mean
from fdbench.plants import Plant
from fdbench.plants.feed_drive import FeedDrive, Following, RotaryMotor
from fdbench.record import Record
from fdbench.rotary import LINEAR, ROTARY, name_on_the_arc, words_of_rotary
from fdbench.scenario import Scenario, extended
from fdbench.specification import bounded, check_bounds, nonnegative, positive, read, snake_case

SUBSTEPS = 10  # where a scenario does not say


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """How the model is integrated between two samples of a record, and how often its controller acts in that time.

    Parameters
    ----------
    substeps : int
        Substeps of the integration between two samples, at most; fewer are taken where no reading moves by a fifth of
        its noise.
    loops : int or None
        Cycles of the controller between two samples. Without it one, or as many as records tell.
    command_rates : str or None
        How velocity and acceleration of a command are differenced that a log does not hold: ``"central"``, or
        ``"backward"`` as many controllers do, which is half a cycle and a cycle later. Without it records tell which.
    """

    substeps: int = bounded(1, 10000)
    loops: int | None = bounded(1, 16, default=None)
    command_rates: str | None = None

    @property
    def cycles(self) -> int:
        """Cycles of the controller between two samples: one, where none are told."""
        return self.loops or 1

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.command_rates is not None and self.command_rates not in COMMAND_RATES:
            raise SpecError(
                f"command_rates: '{self.command_rates}' is none.{did_you_mean(self.command_rates, COMMAND_RATES)}"
            )


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Standard deviations of the nominal parameters; re-calibration moves within them.

    Parameters
    ----------
    mass : float
        Of masses or moments of inertia, relative.
    viscous : float
        Of viscous frictions, relative to what the model has of it.
    stiffness : float
        Of the stiffness of a screw or shaft, relative; it moves by one and a half of it at most.
    damping : float
        Of the natural logarithm of the damping of a screw or shaft, which no data sheet says.
    known_effects : float
        Of the size of each effect that the model knows, relative.
    effects : mapping of str to float
        The same of single ones, by their names: weight of a joint is known better than its friction.
    known_phase : float
        Of the phase of each known effect that repeats over the way, such as gravity of a joint, in radians.
    transition_velocity : float
        Of the natural logarithm of the speed over which friction turns its sign, which no data sheet says.
    bristle_stiffness : float
        Of the natural logarithm of the stiffness with which a known LuGre friction bends before it slides.
    bristle_form : float
        Of forces of springs that slip in place of bristles of a known LuGre friction, relative to it.
    friction_side : float
        Of the part of the known friction that acts on the motor instead of the table.
    friction_form : float
        Of friction at low speeds, relative to the known friction.
    controller_gains : float
        Of each gain and feedforward of a cascade, relative; of a mass that is fed forward, relative to all that is
        moved where it is less. 0 where they are known exactly.
    reference_delay : float or None
        Of the delay of the velocity's reference in a cascade, in sampling times. Without it 0 where that reference was
        logged, as a filter of the velocity acts alike, and else a quarter: a controller may difference its command
        either way.
    velocity_filter : float
        Of the time constant of a cascade's filter of the velocity, in sampling times.
    encoder_delay : float
        Of the time by which the table's position is read after the motor's, in sampling times, where both are logged.
    loop_lag : float
        Of the time by which the force follows its command, in sampling times; beside a lag that is known, of a dead
        time. Below 0 it is the time by which the force is read after the position.
    force_offset_N : float or None
        Of a constant force. Without it in proportion to the forces of the axis: 2 N at 150 N root mean square.
    """

    mass: float = positive(default=0.03)
    viscous: float = positive(default=0.1)
    stiffness: float = nonnegative(default=0.05)
    damping: float = nonnegative(default=0.3)
    known_effects: float = positive(default=0.06)
    effects: Mapping[str, float] = field(default_factory=dict, hash=False)
    known_phase: float = nonnegative(default=0.05)
    transition_velocity: float = nonnegative(default=1.0)
    bristle_stiffness: float = nonnegative(default=1.0)
    bristle_form: float = nonnegative(default=0.2)
    friction_side: float = nonnegative(default=0.3)
    friction_form: float = nonnegative(default=0.05)
    controller_gains: float = nonnegative(default=0.02)
    reference_delay: float | None = nonnegative(default=None)
    velocity_filter: float = nonnegative(default=0.1)
    encoder_delay: float = nonnegative(default=0.002)
    loop_lag: float = nonnegative(default=0.05)
    force_offset_N: float | None = nonnegative(default=None)

    def __post_init__(self) -> None:
        check_bounds(self)
        for name, deviation in self.effects.items():
            if not deviation > 0.0:
                raise SpecError(f"effects.{name}: {deviation:g} is not allowed; it must be above 0.")

    def of_effect(self, known: Effect) -> float:
        """Return the relative standard deviation of the size of a known effect."""
        return self.effects.get(known.name, self.known_effects)


@dataclass(frozen=True, kw_only=True)
class Covered:
    """What records cover: fastest speed, longest time, greatest mean force, sampling time; 0 where not known yet.

    ``seen`` names effects that readings show by themselves, which are not searched for. ``before`` says that the model
    was calibrated on the same machine, so that a value far from it has changed, ``two_positions`` that motor and table
    were both measured, and ``velocity_told`` that the velocity's reference was logged.
    """

    fastest_m_per_s: float = nonnegative(default=0.0)
    longest_s: float = nonnegative(default=0.0)
    force_N: float = nonnegative(default=0.0)
    period_s: float = nonnegative(default=0.0)
    seen: tuple[str, ...] = ()
    before: bool = False
    two_positions: bool = False
    velocity_told: bool = True

    def most(self, unit: str) -> float:
        """Return the longest time (s) or the highest frequency (Hz) that records show; in other units no limit."""
        if unit == "Hz" and self.period_s > 0.0:
            return highest_Hz(self.period_s)
        return self.longest_s if unit == "s" and self.longest_s > 0.0 else math.inf


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """A model file: [plant] with its controller, [simulation], and optionally [uncertainty].

    The plant of a rotary ``axis`` is that of its arc; see `fdbench.rotary`. With ``extends = "healthy"`` above its
    tables a file has only what differs from ``healthy.toml`` beside it.

    Parameters
    ----------
    plant : Plant
        Nominal machine and its controller.
    simulation : Simulation
        How it is integrated.
    uncertainty : Uncertainty
        How well its values are known.
    exclude : tuple of str
        Names of effects that this axis cannot have; the diagnosis does not consider them.
    axis : str
        ``"linear"``, or ``"rotary"``: then all keys, records and answers have the units of a rotary axis.
    """

    plant: Plant
    simulation: Simulation
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    covered: Covered = field(default_factory=Covered, init=False)
    exclude: tuple[str, ...] = ()
    axis: str = LINEAR

    def __post_init__(self) -> None:
        _check_axis(self.axis, "axis")
        for name in self.exclude:
            effects.get(name)

    def beside(self, covered: Covered) -> "Nominal":
        """Return the model with what records cover, which bounds what can be told from them."""
        found = replace(self)
        object.__setattr__(found, "covered", covered)
        known = tuple(at_scale(type(item), found.scale)(**vars(item)) for item in self.drive.effects)
        object.__setattr__(found, "plant", replace(self.drive, effects=known))
        return found

    def knowing(self, known: Sequence[Effect]) -> "Nominal":
        """Return the model with other known effects, each in the place of one and known as well as that."""
        doubt, before = self.uncertainty, self.drive.effects
        own = (
            {now.name: doubt.of_effect(item) for item, now in zip(before, known, strict=True)} if doubt.effects else {}
        )
        plant = replace(self.drive, effects=tuple(known))
        return replace(self, plant=plant, uncertainty=replace(doubt, effects=own))

    @cached_property
    def scale(self) -> Scale:
        """How large ways and forces of the axis are beside those of a usual one; 1 within some factor of it.

        Bounds, typical sizes and grids of effects are scaled by it, so that a small axis has small friction, and no
        verdict depends on what a turn is measured in. Metres have a meaning of their own, as speeds at which
        lubrication sets in: on a linear axis the factor is large.
        """
        span = MODEL.usual_force_span if self.axis == ROTARY else MODEL.usual_speed_span
        length = _beyond(self.covered.fastest_m_per_s / MODEL.usual_speed_m_per_s, span)
        return Scale(length=length, force=_beyond(self.covered.force_N / MODEL.usual_force_N, MODEL.usual_force_span))

    @property
    def force_offset_N(self) -> float:
        """Standard deviation of the force offset, N; where none is given, in proportion to the forces of the axis."""
        given, forces = self.uncertainty.force_offset_N, self.covered.force_N / MODEL.usual_force_N
        return MODEL.usual_force_offset_N * (forces or 1.0) if given is None else given

    @cached_property
    def library(self) -> tuple[type[Effect], ...]:
        """Every registered effect to search for: one of this axis, not random, and no force of unknown course.

        Of effects that give the same signal there is one, and what only a baseline tells is there beside one.
        """
        names = [name for name in effects.names() if name not in (*self.exclude, *self.covered.seen)]
        known = [effects.get(name) for name in names if effects.get(name).same_signal_as not in names]
        turns, before = self.axis == ROTARY, self.covered.before
        able = [kind for kind in known if kind.needs_turn <= turns and kind.scales_every_value <= before]
        searched = [kind for kind in able if not kind.random and (not kind.disturbance or _is_located(kind))]
        return tuple(at_scale(kind, self.scale) for kind in searched)

    def with_equivalents(self, names: Sequence[str]) -> list[str]:
        """Return names of effects, each followed by those of effects that give the same signal."""
        allowed = [other for other in effects.names() if other not in self.exclude]
        equivalents = {
            name: [other for other in allowed if effects.get(other).same_signal_as == name] for name in names
        }
        return [item for name in names for item in (name, *equivalents[name])]

    def on_the_arc(self, records: Sequence[Record]) -> list[Record]:
        """Return records with the columns of the plant: those of a rotary axis on its arc."""
        for record in records:
            angles = [name for name in record if name not in LINEAR_COLUMNS and name_on_the_arc(name) in LINEAR_COLUMNS]
            if angles and self.axis == LINEAR:
                raise RecordError(
                    f"{record.source}: column {angles[0]} is of a rotary axis, the model's is linear. Write "
                    'axis = "rotary" above the tables of the model, or map the column to one in m.'
                )
        if self.axis == LINEAR:
            return list(records)
        geared = isinstance(self.drive.motor, RotaryMotor)
        return [record_on_the_arc(record, geared) for record in records]

    @property
    def reference_delay(self) -> float:
        """Standard deviation by which the velocity's reference is late, in sampling times; see `Uncertainty`."""
        given = self.uncertainty.reference_delay
        return (0.0 if self.covered.velocity_told else MODEL.untold_delay) if given is None else given

    @property
    def cycles(self) -> int:
        """Cycles of the controller that are simulated between two samples: a virtual one is as fast as the log."""
        return 1 if isinstance(self.drive.controller, Following) else self.simulation.cycles

    @property
    def way(self) -> Way:
        """How what repeats with the position is told."""
        turn_m = 2.0 * math.pi if self.axis == ROTARY else None
        return Way(bin_m=self.scale.length * RECORDS.profile_bin_m, turn_m=turn_m)

    @property
    def turn_m(self) -> float | None:
        """Way of the axis in one turn of its motor; None where nothing turns."""
        if isinstance(self.drive.motor, RotaryMotor):
            return self.drive.motor.lead_m
        return 2.0 * math.pi if self.axis == ROTARY else None

    @property
    def drive(self) -> FeedDrive:
        """The plant as a feed drive, the only one that is diagnosed."""
        if not isinstance(self.plant, FeedDrive):
            raise SpecError(f"plant.kind: only a feed_drive can be diagnosed, found {type(self.plant).name}.")
        return self.plant


def _check_axis(axis: Any, where: str) -> None:
    if axis not in (LINEAR, ROTARY):
        raise SpecError(f"{where}: {axis!r}; allowed: {LINEAR}, {ROTARY}.")


def _beyond(ratio: float, span: float) -> float:
    """Return by which factor a ratio lies outside 1 / span to span."""
    return ratio / min(max(ratio, 1.0 / span), span) if ratio > 0.0 else 1.0


def _is_located(kind: type[Effect]) -> bool:
    """Return whether the diagnosis finds the effect's period in the records."""
    return any(item.locate for item in kind.parameters())


def nominal_of(scenario: Scenario) -> Nominal:
    """Return the nominal model of a scenario; what the machine really is is not looked at."""
    substeps = SUBSTEPS if scenario.timing is None else scenario.timing.substeps
    return Nominal(plant=scenario.plant, simulation=Simulation(substeps=substeps, loops=1))


def load_nominal(path: str | Path) -> Nominal:
    """Read a model file, or take the nominal model out of a scenario, given by its file or its id.

    From a scenario only [plant], the substeps of [timing], and what a model file may have beside them, are read; what
    the machine really is stays unread.
    """
    file = _file(path)
    table, _ = extended(file)
    where = f"{file.name}: model"
    if "estimation" in table:
        timing = table.get("timing", {})
        if not isinstance(timing, Mapping):
            raise SpecError(f"{where}.timing: a table is expected, found {timing!r}.")
        beside: dict[str, Any] = {key: table[key] for key in ("uncertainty", "exclude") if key in table}
        substeps = timing.get("substeps", SUBSTEPS)
        table = {"plant": table.get("plant", {}), "simulation": {"substeps": substeps, "loops": 1}, **beside}
    plant = table.get("plant")
    if isinstance(plant, Mapping) and plant.get("kind") == snake_case(FeedDrive.__name__) and "controller" not in plant:
        table["plant"] = plant = {**plant, "controller": {"kind": snake_case(Following.__name__)}}
    axis = table.get("axis", LINEAR)
    _check_axis(axis, f"{where}.axis")
    if axis != ROTARY or not isinstance(plant, Mapping):
        return _read(table, where)
    uncertainty = table.get("uncertainty", {})
    if isinstance(uncertainty, Mapping):
        table["uncertainty"] = {name_on_the_arc(key): value for key, value in uncertainty.items()}
    try:
        return _read({**table, "plant": plant_on_the_arc(plant, f"{where}.plant")}, where)
    except SpecError as error:
        raise SpecError(words_of_rotary(str(error))) from error


def _read(table: Mapping[str, Any], where: str) -> Nominal:
    """Return the model in a table; what it knows may be larger or smaller than what a search on a usual axis tries."""
    plant = table.get("plant")
    known = plant.get("effects") if isinstance(plant, Mapping) else None
    if not isinstance(plant, Mapping) or not isinstance(known, list) or not all(map(_is_known, known)):
        return _with_known_doubts(read(Nominal, table, where), where)
    nominal = read(Nominal, {**table, "plant": {**plant, "effects": []}}, where)
    found = tuple(_known(item, f"{where}.plant.effects[{place}]") for place, item in enumerate(known))
    return _with_known_doubts(replace(nominal, plant=replace(nominal.drive, effects=found)), where)


def _with_known_doubts(nominal: Nominal, where: str) -> Nominal:
    """Return the model, all of whose single doubts are of effects that it knows."""
    for name in nominal.uncertainty.effects:
        known = [item.name for item in nominal.drive.effects]
        if name not in known:
            nearest = did_you_mean(name, known) or f" Known are {', '.join(known) or 'none'}."
            raise SpecError(f"{where}.uncertainty.effects.{name}: no effect of [[plant.effects]].{nearest}")
    return nominal


def _is_known(effect: Any) -> bool:
    return isinstance(effect, Mapping) and effect.get("kind") in effects.names()


def _known(effect: Mapping[str, Any], where: str) -> Effect:
    parameters = {name: value for name, value in effect.items() if name != "kind"}
    return read(at_scale(effects.get(effect["kind"]), Scale()), parameters, where)


def _file(name_or_path: str | Path) -> Path:
    """Return the file of a scenario id, where that is what was given and no file has its name."""
    file, name = Path(name_or_path), str(name_or_path).removeprefix("fdbench/")
    if file.suffix.lower() == ".toml" or file.exists():
        return file
    if name not in scenario_ids():
        raise UnknownName(
            f"{name_or_path}: neither a model file (.toml) nor a scenario.{did_you_mean(name, scenario_ids())}"
        )
    return scenario_folder() / f"{name}.toml"
