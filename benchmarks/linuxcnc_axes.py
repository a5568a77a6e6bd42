"""Axes under a controller that nobody here wrote: LinuxCNC's own `pid`, recorded by its `halsampler` and diagnosed.

Each axis is a component of HAL in C, `fdbench_axis.comp`, which shares no code with fdbench: a mass, or two and a
screw, with friction that sticks or turns over smoothly. LinuxCNC's `streamer` gives the commands, `pid` the force, and
`sampler` takes command, position and force, eight axes at a time, in real time. A third of the axes has nothing that
the data sheet lacks; each other one has one effect, of the library or, seldom, one that the library lacks, and is run
without it too, to see how far it shows. Diagnosed is what `halsampler` printed, with the model that the owner would
write: the data sheet, and the settings of `pid` as a cascade. Motions are those of tier F.

Needed are LinuxCNC (2.9, `linuxcnc-uspace`), and once `sudo halcompile --install benchmarks/fdbench_axis.comp`
(`linuxcnc-uspace-dev`); without them it ends with 2. Every axis is a line of a file, so that a run that was stopped
goes on where it ended.
"""

import argparse
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _axes import answered, finished, kept, named, number_of, ranked, words

from fdbench.cluster import in_processes
from fdbench.diagnosis.model.nominal import load_nominal
from fdbench.diagnosis.repaired import toml_lines
from fdbench.errors import FdbenchError
from fdbench.nonce import check_nonce, new_nonce
from fdbench.reading import read_record
from fdbench.record import FloatArray
from fdbench.trials import seal
from fdbench.trials.answer import OK
from fdbench.trials.score import NAMED
from fdbench.virtual_axes.foreign.kinds import MOTOR_SHARE, SCREW_DAMPING
from fdbench.virtual_axes.foreign.mechanics import TURN
from fdbench.virtual_axes.foreign.motions import RECIPES, Space

PERIOD_S = 1e-3
AT_ONCE = 8  # axes in one instance of HAL, which has so many samplers
MOTIONS, REPEATS = ("speeds", "hard", "multisine"), 2
REST_S, SMOOTHING_S = 0.3, 0.02  # before each record, not in it; of the commands
NOBODY = 65534  # LinuxCNC does not run as root
NEEDED = ("halrun", "halcmd", "halsampler", "halstreamer")
MODULES = (Path("/usr/lib/linuxcnc/modules"), Path("/usr/realtime/modules/linuxcnc"))
ONE_IN = 3  # axes on which nothing is planted
LATE = ("dead_time", "current_loop_lag")  # which make a loop behind a screw ring, that nobody would run
LACKED = ("two_element_hysteresis", "square_wave_force", "friction_bump")  # by the library
MODEL, FOLLOWING, HEALTHY = "model.toml", "without_controller.toml", "healthy"
POSITIONS = (("reference_position_m", "mm"), ("position_m", "mm"))
COLUMNS = (*POSITIONS, ("motor_force_N", "N"), ("table_position_m", "mm"))

Values = Mapping[str, float]


class Drawn(NamedTuple):
    """An axis: parameters of its component, with and without what is planted, settings of its `pid`, and its model."""

    plant: Values
    healthy: Values
    pid: Values
    model: Mapping[str, Any]
    commands: Mapping[str, FloatArray]
    is_elastic: bool
    previous_target: bool
    planted: str
    size: Values


# ---- what is drawn ----


def listed(value: Values, rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Return drawn parameters of the component for each effect of the library."""

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    friction, speed = value["friction_N"], value["speed_m_per_s"]
    sign = float(rng.choice((-1.0, 1.0)))
    return {
        "inertia_mismatch": {"added_mass": value["mass_kg"] * between(0.3, 0.7)},
        "coulomb_friction": {"added_coulomb": friction * between(1.2, 2.5)},
        "viscous_friction": {"added_viscous": value["viscous_N_s_per_m"] * between(1.5, 4.0)},
        "constant_force": {"added_weight": sign * friction * between(0.3, 1.0)},
        "stribeck_friction": {"stribeck": friction * between(0.3, 0.8), "stribeck_speed": speed * between(0.01, 0.03)},
        "direction_dependent_friction": {"direction": sign * between(0.15, 0.35)},
        "cable_stiffness": {"cable": friction / value["travel_m"] * between(0.4, 1.2)},
        "cogging": {"cogging": friction * between(0.2, 0.6), "pitch": between(0.01, 0.03), "phase": between(0.0, TURN)},
        "periodic_force": {
            "periodic": friction * between(0.2, 0.5),
            "frequency": between(4.0, 60.0),
            "phase": between(0.0, TURN),
        },
        "dead_time": {"dead_cycles": float(rng.integers(1, 3))},
        "current_loop_lag": {"lag": between(8e-4, 2e-3)},
        "force_saturation": {"knee": value["peak_N"] * between(0.9, 1.6)},
        "encoder_quantisation": {"count": value["noise_m"] * between(20.0, 60.0)},
    }


def unlisted(value: Values, rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Return drawn parameters of the component for each effect that the library lacks."""
    friction, travel = value["friction_N"], value["travel_m"]
    return {
        "two_element_hysteresis": {
            "hysteresis": friction * rng.uniform(0.4, 0.8),
            "hysteresis_way": travel * rng.uniform(1e-3, 3e-3),
        },
        "square_wave_force": {"square": friction * rng.uniform(0.3, 0.8), "frequency": rng.uniform(1.0, 3.0)},
        "friction_bump": {
            "bump": friction * rng.uniform(0.6, 1.2),
            "bump_place": travel * rng.uniform(0.1, 0.3),
            "bump_width": travel * rng.uniform(0.015, 0.04),
        },
    }


def data_sheet(rng: np.random.Generator) -> dict[str, float]:
    """Return the nominal values of a small machine."""
    ranges = {
        "mass_kg": (8.0, 60.0),
        "friction_N": (15.0, 80.0),
        "travel_m": (0.15, 0.4),
        "speed_m_per_s": (0.15, 0.4),
        "acceleration_m_per_s2": (1.0, 4.0),
        "bandwidth_Hz": (25.0, 50.0),
        "noise_m": (1e-7, 3e-7),
        "screw_Hz": (90.0, 180.0),
    }
    found = {name: float(f"{low * (high / low) ** rng.random():.4g}") for name, (low, high) in ranges.items()}
    friction = found["friction_N"]
    found["viscous_N_s_per_m"] = float(f"{friction * rng.uniform(0.3, 1.2) / found['speed_m_per_s']:.4g}")
    found["weight_N"] = float(f"{friction * rng.uniform(1.0, 2.0) * (rng.random() < 1 / 4):.4g}")
    viscous_N = found["viscous_N_s_per_m"] * found["speed_m_per_s"]
    found["peak_N"] = found["mass_kg"] * found["acceleration_m_per_s2"] + friction + viscous_N
    return found


def draw(nonce: str, number: int) -> Drawn:
    """Draw an axis; where something is planted, the effects take turns in an order that is drawn."""
    rng = seal.generator(nonce, f"LinuxCNC axis {number}")
    value = data_sheet(rng)
    is_elastic, has_integral, previous_target = (bool(rng.random() < chance) for chance in (1 / 3, 1 / 2, 1 / 2))
    offered = {**listed(value, rng), **unlisted(value, rng), "": {}}
    names = [name for name in offered if name]
    order = seal.generator(nonce, "order of the effects").permutation(names)
    planted = str(order[(number - number // ONE_IN - 1) % len(names)]) if number % ONE_IN else ""

    is_elastic = is_elastic and planted not in LATE
    settings, controller = pid_and_cascade(value, has_integral, previous_target)
    width = 10 ** rng.uniform(-4.0, -3.0) if rng.random() < 1 / 2 else 0.0
    healthy = real_axis(value, is_elastic, rng) | {"width": width, "seed": int(rng.integers(1, 2**31))}
    plant = dict(healthy)
    for name, size in offered[planted].items():
        side = "table_mass" if is_elastic else "mass"
        into = {"added_mass": side}.get(name, name.removeprefix("added_"))
        plant[into] = plant.get(into, 0.0) + size

    space = Space(value["travel_m"], value["speed_m_per_s"], value["acceleration_m_per_s2"], PERIOD_S, SMOOTHING_S)
    commands = {}
    for name in MOTIONS:
        way, _, rate = RECIPES[name](space, rng).T
        allowed = min(1.0, value["acceleration_m_per_s2"] / np.abs(rate).max()) if name == "multisine" else 1.0
        commands[name] = np.round(1e3 * allowed * (way - way[0]), 6)
    model = model_of(value, is_elastic, previous_target, controller)
    return Drawn(plant, healthy, settings, model, commands, is_elastic, previous_target, planted, offered[planted])


def real_axis(value: Values, is_elastic: bool, rng: np.random.Generator) -> dict[str, Any]:
    """Return parameters of the component: those of the data sheet, and by how much it is off."""

    def off(share: float) -> float:
        return 1.0 + share * float(np.clip(rng.standard_normal(), -2.0, 2.0))

    mass, friction = value["mass_kg"] * off(0.05), value["friction_N"]
    found = {
        "mass": mass,
        "force_ratio": off(0.02),
        "viscous": value["viscous_N_s_per_m"] * off(0.3),
        "coulomb": friction * off(0.3),
        "weight": value["weight_N"] * off(0.1) + friction * (off(0.05) - 1.0),
        "noise": value["noise_m"],
        "rub": 0.01 * friction,
        "wander": 0.005,
    }
    if is_elastic:
        found |= {"mass": MOTOR_SHARE * mass, "table_mass": (1.0 - MOTOR_SHARE) * mass}
        found |= dict(zip(("stiffness", "damping"), screw(value), strict=True))
    return found


def screw(value: Values) -> tuple[float, float]:
    """Return stiffness and damping of a screw between two masses."""
    reduced, omega = MOTOR_SHARE * (1.0 - MOTOR_SHARE) * value["mass_kg"], TURN * value["screw_Hz"]
    return float(f"{reduced * omega**2:.4g}"), float(f"{2.0 * SCREW_DAMPING * reduced * omega:.4g}")


def pid_and_cascade(
    value: Values, has_integral: bool, previous_target: bool
) -> tuple[dict[str, float], dict[str, Any]]:
    """Return the settings of `pid`, for mm, and the cascade that does the same.

    The integral of `pid` has this cycle's error, that of a cascade the errors before. Where the error is of the
    previous target, velocities are of the change to the next: half a cycle early, and a cascade's integral has one
    velocity more, which FF1 feeds forward.
    """
    omega = TURN * value["bandwidth_Hz"]
    gain, position_gain = omega * value["mass_kg"], omega / 4.5
    integral = gain * omega / 12.0 if has_integral else 0.0
    ahead = 0.0 if has_integral else value["viscous_N_s_per_m"]
    limit = float(f"{4.0 * value['peak_N']:.3g}")
    settings = {
        "Pgain": (gain * position_gain + integral * (1.0 - position_gain * PERIOD_S)) / 1e3,
        "Igain": integral * position_gain / 1e3,
        "Dgain": (gain - integral * PERIOD_S) / 1e3,
        "FF1": (ahead + integral * PERIOD_S * previous_target) / 1e3,
        "FF2": value["mass_kg"] / 1e3,
        "maxoutput": limit,
    }
    cascade = {
        "kind": "cascade",
        "position_gain_per_s": position_gain,
        "velocity_gain_N_s_per_m": gain,
        "integral_gain_N_per_m": integral,
        "velocity_feedforward": 1.0 + ahead / gain,
        "acceleration_feedforward_kg": value["mass_kg"],
        "force_limit_N": limit,
        "feedback": "motor",
        "difference_span": 1,
        "velocity_reference_delay_s": -0.5 * PERIOD_S * previous_target,
    }
    return settings, cascade


def model_of(value: Values, is_elastic: bool, previous_target: bool, controller: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of the model that the owner would write."""
    share = MOTOR_SHARE if is_elastic else 1.0
    friction = {"kind": "coulomb_friction", "coulomb_force_N": value["friction_N"], "transition_velocity_m_per_s": 1e-3}
    weight = {"kind": "constant_force", "constant_force_N": value["weight_N"]}
    plant: dict[str, Any] = {
        "kind": "feed_drive",
        "travel_m": 1.5 * value["travel_m"],
        "velocity_limit_m_per_s": 2.0 * value["speed_m_per_s"],
        "motor": {
            "kind": "linear_motor",
            "mass_kg": share * value["mass_kg"],
            "viscous_friction_N_s_per_m": 0.0 if is_elastic else value["viscous_N_s_per_m"],
        },
        "controller": controller,
        "effects": [friction] + [weight] * (value["weight_N"] > 0.0),
    }
    if is_elastic:
        table = {"mass_kg": (1.0 - share) * value["mass_kg"], "viscous_friction_N_s_per_m": value["viscous_N_s_per_m"]}
        plant["table"] = table
        plant["screw"] = dict(zip(("stiffness_N_per_m", "damping_N_s_per_m"), screw(value), strict=True))
    return {
        "plant": plant,
        "simulation": {"substeps": 10, "loops": 1, "command_rates": "central" if previous_target else "backward"},
        "uncertainty": {
            "mass": math.hypot(0.05, 0.02),
            "viscous": 0.3,
            "known_effects": 0.3,
            "force_offset_N": 0.05 * value["friction_N"],
        },
    }


# ---- what LinuxCNC does ----


def hal_file(axes: Sequence[Drawn], folder: Path, rows: int) -> str:
    """Return the configuration: plant, command, `pid` and log of each axis in the servo thread, in this order.

    A row has what the controller read, what it was asked for (before, where its error is of the previous target) and
    the force that it then asks for.
    """
    many = len(axes)
    pins = ",".join("ffff" if axis.is_elastic else "fff" for axis in axes)
    lines = [
        f"loadrt threads name1=servo period1={round(PERIOD_S * 1e9)}",
        f"loadrt pid num_chan={many}",
        f"loadrt fdbench_axis count={many}",
        f"loadrt sum2 count={many}",
        f"loadrt streamer depth={','.join([str(rows + 8)] * many)} cfg={','.join('f' * many)}",
        f"loadrt sampler depth={','.join([str(rows + 2000)] * many)} cfg={pins}",
    ]
    for n, axis in enumerate(axes):
        before = f"before.{n}" if axis.previous_target else f"command.{n}"
        lines += [
            f"net command.{n} streamer.{n}.pin.0 => pid.{n}.command sum2.{n}.in0",
            f"net before.{n} sum2.{n}.out",
            f"net position.{n} fdbench-axis.{n}.position => pid.{n}.feedback sampler.{n}.pin.1",
            f"net force.{n} pid.{n}.output => fdbench-axis.{n}.force sampler.{n}.pin.2",
            f"net {before} => sampler.{n}.pin.0",
        ]
        if axis.is_elastic:
            lines.append(f"net table.{n} fdbench-axis.{n}.table-position => sampler.{n}.pin.3")
        lines += [f"setp fdbench-axis.{n}.{name.replace('_', '-')} {size:.10g}" for name, size in axis.plant.items()]
        lines += [f"setp pid.{n}.{name} {size:.12g}" for name, size in axis.pid.items()]
        lines += [f"setp pid.{n}.error-previous-target {int(axis.previous_target)}", f"setp pid.{n}.enable 1"]
        functions = "fdbench-axis.{n} sum2.{n} streamer.{n} pid.{n}.do-pid-calcs sampler.{n}"
        lines += [f"addf {name} servo" for name in functions.format(n=n).split()]
    lines += [f"loadusr -w halstreamer -c {n} {folder / f'{n}.command'}" for n in range(many)]
    lines.append("start")
    lines += [f"loadusr -w halsampler -c {n} -n {rows} {folder / f'{n}.log'}" for n in range(many)]
    return "\n".join(lines) + "\n"


def recorded(axes: Sequence[Drawn], folders: Sequence[Path]) -> None:
    """Run axes together, and write model and records of each into its folder: a log as it is printed, and a mapping."""
    rest = np.zeros(round(REST_S / PERIOD_S))
    parts = [
        [part for _ in range(REPEATS) for command in axis.commands.values() for part in (rest, command)]
        for axis in axes
    ]
    rows = max(sum(map(len, part)) for part in parts)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for n, part in enumerate(parts):
            text = "".join(f"{value:.6f}\n" for value in np.concatenate(part))
            (folder / f"{n}.command").write_text(text, encoding="utf-8")
        (folder / "axes.hal").write_text(hal_file(axes, folder, rows), encoding="utf-8")
        is_root = os.geteuid() == 0
        if is_root:
            for file in (folder, *folder.iterdir()):
                os.chown(file, NOBODY, NOBODY)
        done = subprocess.run(
            ["halrun", "axes.hal"],
            cwd=folder,
            env={**os.environ, "HOME": place, "RTAPI_FIFO_PATH": str(folder / "rtapi_fifo")},
            user=NOBODY if is_root else None,
            group=NOBODY if is_root else None,
            extra_groups=[] if is_root else None,
            capture_output=True,
            text=True,
            check=False,
        )
        logs = [folder / f"{n}.log" for n in range(len(axes))]
        if done.returncode or not all(log.exists() for log in logs):
            raise FdbenchError(f"halrun ended with {done.returncode}:\n{done.stderr or done.stdout}")
        for axis, part, log, kept in zip(axes, parts, logs, folders, strict=True):
            write_records(axis, part, log.read_text("utf-8").splitlines(keepends=True), kept)


def write_records(axis: Drawn, parts: Sequence[FloatArray], lines: Sequence[str], folder: Path) -> None:
    """Cut what was logged into records, and write them with model and mappings."""
    if len(lines) < sum(map(len, parts)) or "overrun\n" in lines:
        raise FdbenchError(f"halsampler printed {len(lines)} lines, or lost some.")
    folder.mkdir(parents=True, exist_ok=True)
    plant = {name: table for name, table in axis.model["plant"].items() if name != "controller"}
    for name, model in ((MODEL, axis.model), (FOLLOWING, {**axis.model, "plant": plant})):
        (folder / name).write_text("\n".join(toml_lines(model)).lstrip() + "\n", encoding="utf-8")
    ends = np.cumsum([len(part) for part in parts])
    names = [f"{name}_{repeat + 1}" for repeat in range(REPEATS) for name in axis.commands]
    columns = COLUMNS[: 4 if axis.is_elastic else 3]
    mapping = [f'{name} = {{ from = "pin.{pin}", unit = "{unit}" }}' for pin, (name, unit) in enumerate(columns)]
    if axis.is_elastic:
        mapping.append('motor_position_m = { from = "pin.1", unit = "mm" }')
    for name, start, end in zip(names, ends[0::2], ends[1::2], strict=True):
        (folder / f"{name}.log").write_text("".join(lines[start:end]), encoding="utf-8")
        head = ["[record]", f'file = "{name}.log"', f"sampling_time_s = {PERIOD_S}", "", "[columns]"]
        (folder / f"{name}.toml").write_text("\n".join((*head, *mapping)) + "\n", encoding="utf-8")


# ---- what is said ----


def shows(folder: Path) -> float:
    """Return by how much more what is planted changes force or position than repeats differ, root mean square."""
    change, noise = np.zeros(2), np.zeros(2)
    for name in MOTIONS:
        with_it, healthy, repeat = (
            np.loadtxt(place / f"{name}_{number}.log")[:, 1:3]
            for place, number in ((folder, 1), (folder / HEALTHY, 1), (folder / HEALTHY, 2))
        )
        change += np.mean((with_it - healthy) ** 2, axis=0)
        noise += np.mean((repeat - healthy) ** 2, axis=0) / 2.0
    return float(np.sqrt(change / noise).max())


def run(task: tuple[str, Path, Drawn], with_controller: bool) -> dict[str, Any]:
    """Return the line of an axis, of its key, folder and draw: what is planted, and what is said."""
    key, folder, drawn = task
    records = [read_record(file) for file in sorted(folder.glob("*.toml")) if file.name not in (MODEL, FOLLOWING)]
    truth = {"planted": drawn.planted, "size": dict(drawn.size), "shows": shows(folder) if drawn.planted else 0.0}
    truth |= {"elastic": drawn.is_elastic, "previous_target": drawn.previous_target}
    truth |= {"integral": drawn.pid["Igain"] > 0.0, "sticks": drawn.plant["width"] == 0.0}
    said = answered(load_nominal(folder / (MODEL if with_controller else FOLLOWING)), records)
    return {"key": key, "truth": truth, "said": said}


def judged(line: Mapping[str, Any]) -> list[tuple[str, bool]]:
    """Return what is asked of an answer, and whether it is so; the first is what counts."""
    planted, said = line["truth"]["planted"], line["said"]
    is_named = bool(named(said))
    is_silent = said["status"] == OK and not is_named
    if not planted:
        return [("nothing planted: nothing named", is_silent)]
    if planted in LACKED:
        told = is_silent and said["unknown"] > NAMED
        return [("the library lacks it: told as unknown", told), ("the library lacks it: another named", is_named)]
    comes_first = ranked(said)[:1] == [planted]
    return [("of the library: comes first", comes_first), ("of the library: named", comes_first and is_named)]


def print_sheet(lines: Sequence[Mapping[str, Any]]) -> None:
    """Print the sums, and a line for each axis."""
    judgements = [judged(line) for line in lines]
    print()
    for name in dict.fromkeys(name for found in judgements for name, _ in found):
        answers = [is_so for found in judgements for asked, is_so in found if asked == name]
        print(f"{name}: {sum(answers)} of {len(answers)}")
    for line, ((_, is_right), *_) in zip(lines, judgements, strict=True):
        truth = line["truth"]
        kind = ", ".join(name for name in ("elastic", "integral", "sticks", "previous_target") if truth[name])
        there = f"{truth['planted']} (shows {truth['shows']:.3g})" if truth["planted"] else "nothing"
        print(
            f"- axis {number_of(line)} ({kind or 'plain'}): {there}; {'right' if is_right else 'WRONG'}; "
            f"{words(line['said'])}"
        )


def missing() -> str:
    """Return what is not installed."""
    programs = [name for name in NEEDED if shutil.which(name) is None]
    if programs:
        return f"LinuxCNC is not installed ({', '.join(programs)}): apt-get install linuxcnc-uspace linuxcnc-uspace-dev"
    if not any((place / "fdbench_axis.so").exists() for place in MODULES):
        return "its component is not: sudo halcompile --install benchmarks/fdbench_axis.comp"
    return ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--axes", type=int, default=24)
    parser.add_argument("--nonce", help="hexadecimal digits from which all is drawn; without, a new secret")
    parser.add_argument("--without-controller", action="store_true", help="from a model without [plant.controller]")
    parser.add_argument("--jobs", type=int, default=1, help="processes that diagnose")
    parser.add_argument("--out", type=Path, default=Path("linuxcnc_axes.jsonl"), help="file of the lines")
    parser.add_argument("--records", type=Path, default=Path("linuxcnc_axes"), help="folder of models and records")
    given = parser.parse_args()
    if lacking := missing():
        print(lacking, file=sys.stderr)
        sys.exit(2)
    nonce = new_nonce() if given.nonce is None else check_nonce(given.nonce)
    print(f"nonce {nonce}, SHA-256 of the code {seal.code_digest()[:12]}", flush=True)
    way = "without" if given.without_controller else "with"
    keys = [f"{nonce}:{number}:{way}" for number in range(given.axes)]
    drawn = [draw(nonce, number) for number in range(given.axes)]
    folders = [given.records / nonce / f"axis_{number}" for number in range(given.axes)]
    for start in range(0, given.axes, AT_ONCE):
        part = slice(start, start + AT_ONCE)
        if not all((folder / HEALTHY).exists() for folder in folders[part]):
            recorded(drawn[part], folders[part])
            without = [axis._replace(plant=axis.healthy) for axis in drawn[part]]
            recorded(without, [folder / HEALTHY for folder in folders[part]])
            print(f"{min(start + AT_ONCE, given.axes)} axes recorded", flush=True)
    done = finished(given.out)
    tasks = [task for task in zip(keys, folders, drawn, strict=True) if task[0] not in done]
    results = in_processes(partial(run, with_controller=not given.without_controller), tasks, given.jobs)
    done |= {line["key"]: line for line in kept(given.out, results)}
    print_sheet([done[key] for key in keys])


if __name__ == "__main__":
    main()
