"""Axes whose physics is MuJoCo's own: is what was planted on them found, and is nothing found where nothing is?

A linear stage, a screw axis of two masses, a vertical axis and a rotary table, integrated by MuJoCo: its soft dry
friction, its damping, gravity, springs, tendons and limits. The cascade that moves them is written here. Values, data
sheets, motions and the sizes of what is planted are drawn as in tier F; half of the axes are diagnosed with their
controller. A third has nothing planted, a sixth what no effect of the library is, the others one effect.

Every axis is a line of a file, so that a run that was stopped goes on where it ended. `--check` diagnoses nothing: it
tells how well the exact model predicts axes on which nothing is planted. It needs `pip install fdbench[peers]`.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _axes import answered, finished, kept, named, number_of, ranked, words
from _mujoco_machine import MACHINES, Loop, MachineKind, march, mujoco

from fdbench.cluster import in_processes
from fdbench.diagnosis.evaluation.evaluate import evaluate
from fdbench.errors import SimulationDiverged
from fdbench.nonce import check_nonce, new_nonce
from fdbench.record import FloatArray, Record
from fdbench.report.evaluation_text import evaluation_text
from fdbench.rotary import rotary_name
from fdbench.trials import seal
from fdbench.trials.answer import FAILED, read_case
from fdbench.trials.make import write_case
from fdbench.trials.score import NAMED
from fdbench.virtual_axes.bench import between
from fdbench.virtual_axes.cases import Case, described
from fdbench.virtual_axes.foreign.kinds import (
    ERRORS,
    GAIN_ERROR,
    Imperfection,
    body_of,
    gains_of,
    imperfections,
    model_of,
    nominal_values,
    scales,
    space_of,
)
from fdbench.virtual_axes.foreign.mechanics import TURN
from fdbench.virtual_axes.foreign.motions import RECIPES

SMALLEST_CHANGE = 3.0  # root mean square of what is planted in a motion, in units of the noise
MOST_DRAWS = 40
FRICTION_CHANGE = 0.03  # from run to run
ROLES = ("listed", "nothing", "listed", "unlisted", "listed", "nothing")
LISTED = (
    "inertia_mismatch",
    "coulomb_friction",
    "viscous_friction",
    "constant_force",
    "direction_dependent_friction",
    "cable_stiffness",
    "cogging",
    "periodic_force",
    "position_dependent_friction",
    "stribeck_friction",
    "friction_drift",
    "load_dependent_friction",
    "quadratic_drag",
    "structural_mode",
    "force_saturation",
)
OF_A_LOOP = ("dead_time", "current_loop_lag", "encoder_quantisation")
OF_A_SCREW = ("backlash", "axial_compliance")
OF_A_ROTARY_TABLE = ("link_gravity",)
LINK_GRAVITY = Imperfection(
    name="link_gravity",
    draw={"unbalance_N": (0.5, 1.5), "unbalance_rad": (-3.14, 3.14)},
    scale={"unbalance_N": "friction_N"},
)
ITEMS = {item.name: item for item in (*imperfections().listed, *imperfections().unlisted, LINK_GRAVITY)}


# ---- one axis ----


class MujocoAxis:
    """A machine with its data sheet, how it really is, and its loop; ``is_exact``: as its data sheet says."""

    def __init__(self, machine: MachineKind, is_exact: bool, rng: np.random.Generator) -> None:
        value = nominal_values(machine.axis, bool(rng.integers(2)), rng)
        creeping = (1.0 - value["friction_impedance"]) * 0.5 * value["friction_time_s"]
        value["friction_width_m_per_s"] = creeping * value["friction_N"] / value["mass_kg"]
        value["friction_change"] = 0.0 if is_exact else FRICTION_CHANGE
        gain_names = ("position_gain_per_s", "velocity_gain_N_s_per_m", "integral_gain_N_per_m")
        sizes = {**ERRORS, **dict.fromkeys(gain_names, GAIN_ERROR)}
        errors = {name: size * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for name, size in sizes.items()}
        self.errors = dict.fromkeys(errors, 0.0) if is_exact else errors
        self.machine, self.value, self.is_exact = machine, value, is_exact
        self.body = body_of(machine.axis, value, self.errors)
        ahead = {"acceleration_feedforward_kg": value["mass_kg"] * float(rng.integers(2))}
        self.gains = gains_of(machine.axis, value) | ahead
        actual = {name: gain * (1.0 + self.errors.get(name, 0.0)) for name, gain in self.gains.items()}
        self.loop = Loop(actual, 0.5 * float(rng.integers(2)))

    def readings(
        self, planted: Mapping[str, float], command: FloatArray, rng: np.random.Generator | None
    ) -> FloatArray:
        """Return what is read in each cycle; without an rng there is no noise, and friction is the usual one."""
        return march(self.machine, self.value, self.body, self.loop, planted, command, rng)

    def names(self, listed: bool, controller_given: bool) -> list[str]:
        """Return what may be planted on it."""
        kind = self.machine.axis
        if not listed:
            return list(kind.unlisted)
        in_loop = [name for name in OF_A_LOOP if self.loop.late_cycles == 0.0 or name == "encoder_quantisation"]
        return [
            *LISTED,
            *(in_loop if controller_given else ()),
            *(OF_A_SCREW if kind.is_elastic else ()),
            *(OF_A_ROTARY_TABLE if kind.name == "rotary_table" else ()),
        ]

    def planted(self, name: str, rng: np.random.Generator) -> dict[str, float]:
        """Return drawn sizes of an imperfection; a dead time is of whole cycles."""
        item, units, period_s = ITEMS[name], scales(self.value), self.machine.axis.period_s
        found = {key: between(rng, *bounds) for key, bounds in item.draw.items()}
        found |= {key: found[key] * units[unit] for key, unit in item.scale.items()}
        if "late_s" in found:
            found["late_s"] = period_s * max(1, round(found["late_s"] / period_s))
        return found | {key: -found[key] for key in item.signed if rng.random() < 0.5}

    def model(self, controller_given: bool) -> dict[str, Any]:
        """Return the tables that its owner would write."""
        kind = self.machine.axis
        tables = model_of(kind, self.value)
        if controller_given:
            tables["plant"]["controller"] |= self.gains
        else:
            del tables["plant"]["controller"]
        if self.loop.late_cycles > 0.0:
            known = {"kind": "dead_time", "dead_time_s": self.loop.late_cycles * kind.period_s}
            tables["plant"]["effects"].append(known)
        tables["simulation"]["loops"] = kind.log_every
        if self.is_exact:
            tables["plant"]["effects"][0]["transition_velocity_m_per_s"] = self.value["friction_width_m_per_s"]
        return {"axis": "rotary", **of_rotary(tables)} if kind.name == "rotary_table" else tables

    def record(self, name: str, command: FloatArray, readings: FloatArray, is_full: bool) -> Record:
        """Return what its logger writes; a command that is not full has its position alone."""
        kind = self.machine.axis
        command, readings = command[:: kind.log_every], readings[:: kind.log_every]
        columns: dict[str, FloatArray] = {
            "time_s": np.arange(len(command), dtype=np.float64) * (kind.period_s * kind.log_every),
            "reference_position_m": command[:, 0],
        }
        if is_full:
            columns["reference_velocity_m_per_s"] = command[:, 1]
            columns["reference_acceleration_m_per_s2"] = command[:, 2]
        columns["position_m"] = readings[:, 0]
        if kind.is_elastic:
            columns["motor_position_m"], columns["table_position_m"] = readings[:, 0], readings[:, 1]
        columns[kind.logs] = readings[:, 2] * (self.value["lead_m"] / TURN if kind.motor == "rotary" else 1.0)
        if kind.name == "rotary_table":
            columns = {rotary_name(column): values for column, values in columns.items()}
        return Record(columns, source=name)


def of_rotary(tables: Any) -> Any:
    """Return tables of a model with the names of a rotary axis."""
    if isinstance(tables, list):
        return [of_rotary(item) for item in tables]
    if not isinstance(tables, dict):
        return "torque_motor" if tables == "linear_motor" else tables
    return {rotary_name(name): of_rotary(item) for name, item in tables.items()}


def shows(axis: MujocoAxis, sound: FloatArray, changed: FloatArray) -> float:
    """Return by how many times its noise the force changes, root mean square; or the stretch of the screw."""
    change = changed - sound
    size = change[:, 2].std() / (axis.value["force_noise_share"] * axis.value["friction_N"])
    if axis.machine.axis.is_elastic:
        stretch = change[:, 0] - change[:, 1]
        size = max(size, stretch.std() / (math.sqrt(2.0) * axis.value["position_noise_m"]))
    return float(size)


def runs(axis: MujocoAxis, command: FloatArray, readings: FloatArray) -> bool:
    """Return whether its owner would run it: it follows, and neither rings nor is loud."""
    follows = np.abs(readings[:, 0] - command[:, 0]).max() < 0.1 * axis.value["travel_m"]
    quiet = np.abs(np.diff(readings[:, 2], n=2)).mean() < 0.05 * scales(axis.value)["peak_N"]
    return bool(np.isfinite(readings).all() and follows and quiet)


def draw(number: int, rng: np.random.Generator, is_exact: bool = False) -> Case:
    """Draw an axis and record it; kinds and roles take turns.

    Raises
    ------
    SimulationDiverged
        If nothing that was drawn shows, or its owner would not run the axis.
    """
    machine = MACHINES[number % len(MACHINES)]
    role = "nothing" if is_exact else ROLES[(number + number // len(MACHINES)) % len(ROLES)]
    axis = MujocoAxis(machine, is_exact, rng)
    controller_given = is_exact or bool(rng.integers(2))
    kind = machine.axis
    space = space_of(kind, axis.value)
    commands = {name: RECIPES[name](space, rng) for name in kind.motions}
    sound = {name: axis.readings({}, command, None) for name, command in commands.items()}
    if not all(runs(axis, commands[motion], readings) for motion, readings in sound.items()):
        raise SimulationDiverged("no loop that its owner would run.")
    injected: dict[str, dict[str, float]] = {}
    sizes: dict[str, float] = {}
    for _ in range(MOST_DRAWS if role != "nothing" else 0):
        name = str(rng.choice(axis.names(role == "listed", controller_given)))
        planted = axis.planted(name, rng)
        changed = {motion: axis.readings(planted, command, None) for motion, command in commands.items()}
        size = max(shows(axis, sound[motion], changed[motion]) for motion in commands)
        if size >= SMALLEST_CHANGE and all(runs(axis, commands[motion], changed[motion]) for motion in commands):
            injected, sizes = {name: planted}, {name: size**2}
            break
    else:
        if role != "nothing":
            raise SimulationDiverged(f"{MOST_DRAWS} draws, of which none shows.")
    repeats = 1 if is_exact else int(rng.integers(1, 3))
    given, is_full = next(iter(injected.values()), {}), controller_given
    held_out = {"other": RECIPES["other"](space, rng)} if not is_exact and rng.random() < 0.5 else {}

    def recorded(name: str, command: FloatArray) -> Record:
        readings = axis.readings(given, command, rng)
        if not runs(axis, command, readings):
            raise SimulationDiverged(f"{name}: no motion that its owner would record.")
        return axis.record(name, command, readings, is_full)

    return Case(
        model=axis.model(controller_given),
        records={
            f"{name}_{repeat + 1}": recorded(name, command)
            for name, command in commands.items()
            for repeat in range(repeats)
        },
        holdouts={name: recorded(name, command) for name, command in held_out.items()},
        truth={
            "kind": kind.name,
            "role": role,
            "repeats": repeats,
            "controller": controller_given,
            "late_cycles": axis.loop.late_cycles,
            **described(injected, sizes, list(ITEMS) if role == "listed" else []),
            "errors": axis.errors,
            "value": axis.value,
        },
        file_format="parquet",
    )


def usable(nonce: str, number: int, is_exact: bool = False) -> Case:
    """Return an axis that its owner would run; another is drawn anew."""
    message = ""
    for attempt in range(5):
        try:
            return draw(number, seal.generator(nonce, f"mujoco axis {number}, attempt {attempt}"), is_exact)
        except SimulationDiverged as error:
            message = str(error)
    raise SimulationDiverged(f"axis {number}: none of the draws is usable; the last: {message}")


def run(nonce: str, number: int) -> dict[str, Any]:
    """Return the line of an axis: what is planted, and what is said."""
    case = usable(nonce, number)
    with tempfile.TemporaryDirectory() as folder:
        nominal, records, holdouts = read_case(Path(folder) / "axis", write_case(Path(folder) / "axis", case))
    return {"key": f"{nonce}:{number}", "truth": case.truth, "said": answered(nominal, records, holdouts)}


def check(nonce: str, number: int) -> None:
    """Print how well the exact model predicts a sound axis."""
    case = usable(nonce, number, is_exact=True)
    with tempfile.TemporaryDirectory() as folder:
        nominal, records, _ = read_case(Path(folder) / "axis", write_case(Path(folder) / "axis", case))
    value = case.truth["value"]
    print(
        f"\n{case.truth['kind']}, force {case.truth['late_cycles']} cycles late, noise of position "
        f"{value['position_noise_m']:.2g}, of force {value['force_noise_share'] * value['friction_N']:.3g}, "
        f"friction {value['friction_N']:.3g}, creeping up to {value['friction_width_m_per_s']:.2g}"
    )
    print(evaluation_text(evaluate({"exact": nominal}, records).evaluation))


# ---- what is printed ----


def told(line: Mapping[str, Any]) -> str:
    """Return in a word how an axis was answered."""
    truth, said = line["truth"], line["said"]
    is_named = bool(named(said))
    if said["status"] == FAILED:
        return "failed"
    if truth["role"] == "nothing":
        return "named on nothing" if is_named else "nothing named"
    if truth["role"] == "unlisted":
        return "unknown told" if said["unknown"] > NAMED else "wrongly named" if is_named else "nothing told"
    first_three, own = ranked(said)[:3], truth["listed"][0]["name"]
    return "first" if first_three[:1] == [own] else "among three" if own in first_three else "missed"


def print_sheet(lines: Sequence[Mapping[str, Any]]) -> None:
    """Print a line for each axis, and how often each role was answered how."""
    for line in lines:
        truth = line["truth"]
        there = [
            f"{item['name']} ({math.sqrt(item['mean_square']):.1f})" for item in (*truth["listed"], *truth["unlisted"])
        ]
        print(
            f"- axis {number_of(line)}, {truth['kind']}, {'with' if truth['controller'] else 'without'} controller, "
            f"{truth['repeats']} repeats: {', '.join(there) or 'nothing'}; {told(line)}; {words(line['said'])}"
        )
    for role in dict.fromkeys(ROLES):
        for title, which in (("", (True, False)), (", with controller", (True,)), (", without", (False,))):
            found = [
                told(line) for line in lines if line["truth"]["role"] == role and line["truth"]["controller"] in which
            ]
            counts = ", ".join(f"{word} {found.count(word)}" for word in sorted(set(found)))
            print(f"{role}{title}: {len(found)} axes; {counts or '-'}")
    beside = [
        number_of(line)
        for line in lines
        if set(named(line["said"])) - {item["name"] for item in line["truth"]["listed"]}
    ]
    print(f"axes on which an effect that is not there is named: {', '.join(beside) or '-'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--axes", type=int, default=48, help="4 kinds and 6 roles take turns")
    parser.add_argument("--nonce", help="hexadecimal digits from which all is drawn; without, a new secret")
    parser.add_argument("--out", type=Path, default=Path("mujoco_axes.jsonl"), help="file of the lines")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--check", action="store_true", help="exact models beside sound axes; diagnose nothing")
    given = parser.parse_args()
    if mujoco is None:
        print("mujoco is not installed: pip install fdbench[peers]", file=sys.stderr)
        sys.exit(2)
    nonce = new_nonce() if given.nonce is None else check_nonce(given.nonce)
    print(f"nonce {nonce}, SHA-256 of the code {seal.code_digest()[:12]}, MuJoCo {mujoco.__version__}", flush=True)
    if given.check:
        for number in range(given.axes):
            check(nonce, number)
        return
    done = finished(given.out)
    left = [number for number in range(given.axes) if f"{nonce}:{number}" not in done]
    done |= {line["key"]: line for line in kept(given.out, in_processes(partial(run, nonce), left, given.jobs))}
    print_sheet([done[f"{nonce}:{number}"] for number in range(given.axes)])


if __name__ == "__main__":
    main()
