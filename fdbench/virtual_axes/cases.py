"""The tiers of a trial: what is drawn for a case, how it is recorded, and the truth that is sealed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from fdbench.diagnosis.model.nominal import Nominal
from fdbench.errors import SimulationDiverged
from fdbench.record import FloatArray, Record
from fdbench.specification import load_toml, read
from fdbench.virtual_axes import protocol
from fdbench.virtual_axes.bench import ERRORS, Bench, Detectability, Injected
from fdbench.virtual_axes.independent_axis import IndependentBench
from fdbench.virtual_axes.library_axis import LibraryBench, Noises
from fdbench.virtual_axes.oracle import held_out_gaps

AXIS = Path(__file__).with_name("axis.toml")
HOW_MANY = (0.15, 0.45, 0.25, 0.15)  # probabilities of 0, 1, 2, 3 listed effects
OF_TIER_C = {(0, 1): 0.4, (1, 1): 0.25, (1, 0): 0.35}  # probabilities of (listed, unlisted)
SMALLEST_SIGNATURE = 1.0  # mean square of an injected effect in some motion, in units of the noise
MOST_NOISE_AMPLIFICATION = 4.0  # noise of an axis against that of the healthy one, beyond which it counts as unstable
MOST_DRAWS = 80
LIMITED_DATA, TAKEN_OUT = 0.2, 0.3  # of tier L: probabilities of a production cycle alone, and of an effect taken out
FRICTION_CHANGE = (0.0, 0.05)  # of tier L: from run to run, standard deviation


class Tier(StrEnum):
    """A: the library's forms. B: a second implementation. C: effects the library lacks. D: B with thin data.

    L is to learn from: A with friction that changes from run to run, some cases with thin data, and some with an effect
    that the model excludes from the library. F: foreign kinds of axis (`fdbench.virtual_axes.foreign`). G: the same
    kinds with values from other ranges, to develop on.
    """

    A = "A"
    B = "B"
    C = "C"
    D = "D"
    F = "F"
    G = "G"
    L = "L"


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One case of a trial.

    Attributes
    ----------
    model : mapping
        Tables of the nominal model.
    records, holdouts : mapping of str to Record
    truth : mapping
        ``listed`` and ``unlisted``: what is injected, with its parameters; ``errors``: of the nominal parameters;
        ``held_out``: see `fdbench.virtual_axes.oracle.Gaps`.
    file_format : str
        Extension of the files that the records are written to.
    """

    model: Mapping[str, Any]
    records: Mapping[str, Record]
    holdouts: Mapping[str, Record]
    truth: Mapping[str, Any]
    file_format: str = "parquet"


def draw_case(tier: Tier, effects: Sequence[str], rng: np.random.Generator) -> Case:
    """Draw, record and describe one case.

    Parameters
    ----------
    tier : Tier
    effects : sequence of str
        Names that a diagnosis may give; only these are injected as listed.
    rng : numpy Generator

    Raises
    ------
    SimulationDiverged
        If no effect that was drawn shows in the motions.
    """
    model = model_tables(rng)
    if tier is not Tier.L:  # what is learned is to hold for sheets that say less
        model["uncertainty"] |= (LibraryBench if tier is Tier.A else IndependentBench).known
    nominal = read(Nominal, model, "axis.toml: model")
    thin = tier is Tier.D or (tier is Tier.L and rng.random() < LIMITED_DATA)
    motions = protocol.production_cycle(rng) if thin else protocol.full_protocol(rng)
    errors = {name: size * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for name, size in ERRORS.items()}
    bench: Bench
    if tier is Tier.A:
        bench = LibraryBench(nominal, errors, protocol.PERIOD_S)
    elif tier is Tier.L:
        bench = LibraryBench(
            nominal, errors, protocol.PERIOD_S, Noises(friction_change=float(rng.uniform(*FRICTION_CHANGE)))
        )
    else:
        bench = IndependentBench(nominal, errors, protocol.PERIOD_S, rng)
    sides: tuple[str, ...] = ("table_position_m", "motor_position_m")
    sides = sides if nominal.drive.controller.uses_table else sides[::-1]
    sides = sides[:1] if thin else sides
    injected, sizes = inject(bench, how_many(tier, rng), effects, list(motions.records.values()), sides, rng)
    axis = bench.axis(injected)

    def recorded(name: str, reference: FloatArray) -> Record:
        return record_of(name, reference, axis.readings(reference, rng), sides)

    excluded = taken_out(bench, injected, rng) if tier is Tier.L else []
    if excluded:
        model["exclude"] = nominal.with_equivalents(excluded)
    listed = [name for name in bench.names(listed=True) if name not in excluded]
    records = {
        f"{name}_{repeat + 1}": recorded(name, reference)
        for name, reference in motions.records.items()
        for repeat in range(protocol.REPEATS)
    }
    holdouts = {name: recorded(name, reference) for name, reference in motions.holdouts.items()}
    known = bench.without_background().axis({name: drawn for name, drawn in injected.items() if name in listed})

    def oracle(reference: FloatArray) -> Record:
        return record_of("oracle", reference, known.readings(reference, None), sides)

    truth = {
        "tier": tier.value,
        **described(injected, sizes, listed),
        "errors": errors,
        "held_out": held_out_gaps(nominal, list(records.values()), list(holdouts.values()), oracle),
    }
    return Case(model=model, records=records, holdouts=holdouts, truth=truth)


def taken_out(bench: Bench, injected: Injected, rng: np.random.Generator) -> list[str]:
    """Return the name of an injected effect to take out of the library, in some of the cases."""
    listed = bench.names(listed=True)
    names = [name for name in injected if name in listed and not bench.is_nominal_parameter(name)]
    return [str(rng.choice(names))] if names and rng.random() < TAKEN_OUT else []


def described(injected: Injected, sizes: Mapping[str, float], listed: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    """Return what is injected as the truth has it: what a diagnosis may name, and what it may not."""
    result: dict[str, list[dict[str, Any]]] = {"listed": [], "unlisted": []}
    for name, drawn in injected.items():
        item = {"name": name, "parameters": dict(drawn), "mean_square": sizes[name]}
        result["listed" if name in listed else "unlisted"].append(item)
    return result


def model_tables(rng: np.random.Generator) -> dict[str, Any]:
    """Return the tables of a nominal model, its values drawn about those of ``axis.toml``."""

    def about(value: float, share: float = 0.25) -> float:
        return float(f"{value * math.exp(rng.uniform(-share, share)):.4g}")

    tables = load_toml(AXIS)
    plant = tables["plant"]
    motor, table, control = plant["motor"], plant["table"], plant["controller"]
    for part, names in (
        (motor, ("inertia_kg_m2", "viscous_friction_N_s_per_m")),
        (table, ("mass_kg", "viscous_friction_N_s_per_m")),
        (plant["screw"], ("stiffness_N_per_m",)),
        *((known, [name for name in known if name.endswith("force_N")]) for known in plant["effects"]),
    ):
        part |= {name: about(part[name]) for name in names}
    mass_kg = table["mass_kg"] + motor["inertia_kg_m2"] * (2.0 * math.pi / motor["lead_m"]) ** 2
    gain = about(110.0 * mass_kg, 0.15)
    control |= {
        "position_gain_per_s": about(control["position_gain_per_s"]),
        "velocity_gain_N_s_per_m": gain,
        "integral_gain_N_per_m": about(10.0 * gain),
        "feedback": str(rng.choice(["motor", "table"])),
    }
    return tables


def how_many(tier: Tier, rng: np.random.Generator) -> tuple[int, int]:
    """Return the numbers of listed and unlisted effects."""
    if tier is Tier.C:
        kinds = list(OF_TIER_C)
        return kinds[int(rng.choice(len(kinds), p=list(OF_TIER_C.values())))]
    return int(rng.choice(len(HOW_MANY), p=HOW_MANY)), 0


def inject(
    bench: Bench,
    numbers: tuple[int, int],
    effects: Sequence[str],
    motions: Sequence[FloatArray],
    sides: tuple[str, ...],
    rng: np.random.Generator,
) -> tuple[Injected, dict[str, float]]:
    """Return what is injected, all of it visible in the motions, and the mean square of each signature.

    ``numbers`` are those of listed and unlisted effects.
    """
    n_listed, n_unlisted = numbers
    listed = [name for name in bench.names(listed=True) if name in effects]
    wanted = [listed] * n_listed + [bench.names(listed=False)] * n_unlisted
    detectability = Detectability(bench, motions, sides, rng)
    bench.add_background(detectability, rng)
    detectability.beside(bench.axis({}))
    injected: dict[str, dict[str, float]] = {}
    sizes: dict[str, float] = {}
    for _ in range(MOST_DRAWS):
        if len(injected) == len(wanted):
            break
        offered = [name for name in wanted[len(injected)] if name not in injected]
        if not offered:
            break
        name = str(rng.choice(offered))
        drawn = bench.draw(name, rng)
        if any(bench.clash(name, other) for other in injected):
            continue
        axis = bench.axis({name: drawn})
        size = detectability.mean_square(axis, not bench.is_nominal_parameter(name))
        if size < SMALLEST_SIGNATURE:
            continue
        together = injected | {name: drawn}
        if (
            detectability.noise_amplification(bench.axis(together) if injected else axis, rng)
            <= MOST_NOISE_AMPLIFICATION
        ).all():
            injected, sizes = together, sizes | {name: size}
    if len(injected) == len(wanted):
        return injected, sizes
    raise SimulationDiverged(f"{MOST_DRAWS} draws gave too few effects that show on this axis.")


def record_of(name: str, reference: FloatArray, readings: Mapping[str, FloatArray], sides: tuple[str, ...]) -> Record:
    """Return the record of a motion; the first of ``sides`` closes the loop, both are in it if both are given."""
    columns = {
        "time_s": np.arange(len(reference), dtype=np.float64) * protocol.PERIOD_S,
        "reference_position_m": reference[:, 0],
        "reference_velocity_m_per_s": reference[:, 1],
        "reference_acceleration_m_per_s2": reference[:, 2],
        "position_m": readings[sides[0]],
        "motor_force_N": readings["motor_force_N"],
    }
    both = sorted(sides) if len(sides) > 1 else []
    return Record(columns | {side: readings[side] for side in both}, source=name)
