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
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from diagnosis_recall import finished, kept
from threadpoolctl import threadpool_limits

from fdbench.cluster import in_processes
from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.evaluation.evaluate import evaluate
from fdbench.errors import FdbenchError, SimulationDiverged
from fdbench.nonce import check_nonce, new_nonce
from fdbench.record import FloatArray, Record
from fdbench.report.evaluation_text import evaluation_text
from fdbench.rotary import rotary_name
from fdbench.trials import seal
from fdbench.trials.answer import FAILED, OK, read_case
from fdbench.trials.make import write_case
from fdbench.trials.score import NAMED
from fdbench.virtual_axes.bench import between
from fdbench.virtual_axes.cases import Case, described
from fdbench.virtual_axes.foreign.kinds import (
    ERRORS,
    GAIN_ERROR,
    AxisKind,
    Imperfection,
    body_of,
    gains_of,
    imperfections,
    model_of,
    nominal_values,
    scales,
    space_of,
)
from fdbench.virtual_axes.foreign.mechanics import TURN, Body, Wrong
from fdbench.virtual_axes.foreign.motions import RECIPES

mujoco: Any
try:
    mujoco = import_module("mujoco")
except ModuleNotFoundError:
    mujoco = None

GRAVITY_M_PER_S2 = 9.81
UNBALANCE_RADIUS_M = 0.02
NUT_SHARE = 0.3  # of the table's mass, in front of a gap
SQUARE_HZ = 1.7
SMALLEST_CHANGE = 3.0  # root mean square of what is planted in a motion, in units of the noise
MOST_DRAWS = 40
FRICTION_CHANGE = 0.03  # from run to run
NATIVE = {
    *("payload_kg", "grease_N_s_per_m", "cable_N_per_m", "cable_length_m", "gap_m", "softening", "late_s", "step_m"),
    *("carried_kg", "carried_Hz", "carried_damping", "unbalance_N", "unbalance_rad"),
}  # what needs no force beside those of MuJoCo
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
UNLISTED = ("two_element_hysteresis", "friction_bump", "square_wave_force", "falling_friction")
LINK_GRAVITY = Imperfection(
    name="link_gravity",
    draw={"unbalance_N": (0.5, 1.5), "unbalance_rad": (-3.14, 3.14)},
    scale={"unbalance_N": "friction_N"},
)
ITEMS = {item.name: item for item in (*imperfections().listed, *imperfections().unlisted, LINK_GRAVITY)}
EVERYWHERE = {
    "friction_time_s": (5e-4, 1e-3),  # MuJoCo turns dry friction by half of it early, as no machine does: few steps
    "friction_impedance": (0.2, 0.9),
    "viscous_share": (0.3, 1.2),
    "force_noise_share": (0.01, 0.05),
}


class MachineKind(NamedTuple):
    """A kind of axis, the joint of its table, and how MuJoCo integrates it; `AxisKind.steps` in a cycle."""

    axis: AxisKind
    joint: str
    integrator: str


def machine_kind(
    name: str, joint: str, integrator: str, ranges: Mapping[str, tuple[float, float]], **own: Any
) -> MachineKind:
    """Return a machine with a cascade; its law of friction and integrator are MuJoCo's, those of tier F do nothing."""
    axis = AxisKind(
        name=name,
        law="soft",
        integrator="runge_kutta",
        form="cascade",
        ranges={**EVERYWHERE, **ranges},
        unlisted=UNLISTED,
        **{"motor": "linear", "logs": "motor_force_N", **own},
    )
    return MachineKind(axis, joint, integrator)


MACHINES = (
    machine_kind(
        "linear_stage",
        'type="slide" axis="1 0 0"',
        "RK4",
        {
            "mass_kg": (6.0, 60.0),
            "friction_N": (8.0, 50.0),
            "bandwidth_Hz": (30.0, 60.0),
            "travel_m": (0.2, 0.8),
            "speed_m_per_s": (0.3, 1.2),
            "acceleration_m_per_s2": (4.0, 15.0),
            "pitch_m": (0.016, 0.048),
            "position_noise_m": (1e-8, 1e-7),
        },
        motions=("speeds", "hard", "multisine"),
        steps=4,
    ),
    machine_kind(
        "screw_axis",
        'type="slide" axis="1 0 0"',
        "RK4",
        {
            "mass_kg": (60.0, 160.0),
            "friction_N": (60.0, 200.0),
            "stiffness_N_per_m": (4e7, 1.2e8),
            "bandwidth_Hz": (20.0, 40.0),
            "travel_m": (0.2, 0.6),
            "speed_m_per_s": (0.2, 0.6),
            "acceleration_m_per_s2": (4.0, 10.0),
            "pitch_m": (2e-3, 1e-2),
            "lead_m": (5e-3, 2e-2),
            "position_noise_m": (2e-8, 2e-7),
        },
        motions=("speeds", "hard", "small", "multisine"),
        motor="rotary",
        logs="motor_torque_Nm",
        columns="both_positions",
        period_s=5e-4,
        log_every=2,
        steps=4,
    ),
    machine_kind(
        "vertical_axis",
        'type="slide" axis="0 0 1"',
        "implicitfast",
        {
            "mass_kg": (10.0, 60.0),
            "friction_N": (15.0, 60.0),
            "weight_share": (0.6, 2.0),
            "bandwidth_Hz": (25.0, 50.0),
            "travel_m": (0.2, 0.6),
            "speed_m_per_s": (0.2, 0.8),
            "acceleration_m_per_s2": (3.0, 8.0),
            "pitch_m": (0.016, 0.048),
            "position_noise_m": (1e-8, 1e-7),
        },
        motions=("speeds", "hard", "multisine"),
        steps=10,
    ),
    machine_kind(
        "rotary_table",
        'type="hinge" axis="0 1 0"',
        "implicitfast",
        {
            "mass_kg": (0.2, 3.0),
            "friction_N": (1.0, 8.0),
            "bandwidth_Hz": (30.0, 60.0),
            "travel_m": (1.5, 4.0),
            "speed_m_per_s": (1.5, 5.0),
            "acceleration_m_per_s2": (10.0, 40.0),
            "pitch_m": (0.1, 0.4),
            "position_noise_m": (1e-8, 2e-7),
        },
        motions=("speeds", "hard", "small", "multisine"),
        period_s=5e-4,
        steps=10,
    ),
)


# ---- the machine and its loop ----


def compiled(machine: MachineKind, value: Mapping[str, float], body: Body, wrong: Mapping[str, float]) -> Any:
    """Return the machine as MuJoCo has it, with what is planted in its bodies, joints and tendons."""
    kind = machine.axis
    table_kg = body.table_mass_kg + body.motor_mass_kg * (not kind.is_elastic) + wrong["payload_kg"]
    viscous = body.table_viscous_N_s_per_m + body.motor_viscous_N_s_per_m * (not kind.is_elastic)
    held = 1.0 - body.weight_N / (table_kg * GRAVITY_M_PER_S2) if kind.name == "vertical_axis" else 1.0
    soft = (
        f'solreffriction="{value["friction_time_s"]} 1" '
        f'solimpfriction="{value["friction_impedance"]} {value["friction_impedance"]} 0.001"'
    )
    inner = beside = tendons = ""
    if wrong["carried_kg"] > 0.0:
        carried, omega = wrong["carried_kg"], TURN * wrong["carried_Hz"]
        inner += (
            f'<body gravcomp="1"><joint {machine.joint} stiffness="{carried * omega**2}" '
            f'damping="{2.0 * wrong["carried_damping"] * omega * carried}"/>{lump(carried)}</body>'
        )
    if wrong["unbalance_N"] > 0.0:
        angle, radius = wrong["unbalance_rad"], UNBALANCE_RADIUS_M
        place = f"{-radius * math.sin(angle)} 0 {-radius * math.cos(angle)}"
        inner += f'<body pos="{place}">{lump(wrong["unbalance_N"] / GRAVITY_M_PER_S2 / radius, 1e-9)}</body>'
    if kind.is_elastic:
        lever = value["lead_m"] / TURN
        nut = '<joint joint="table" coef="-1"/>'
        if wrong["gap_m"] > 0.0:
            beside += f'<body><joint name="nut" {machine.joint}/>{lump(NUT_SHARE * table_kg)}</body>'
            table_kg *= 1.0 - NUT_SHARE
            tendons += (
                f'<fixed limited="true" range="{-0.5 * wrong["gap_m"]} {0.5 * wrong["gap_m"]}" '
                f'solreflimit="{2.0 * kind.period_s / kind.steps} 1" solimplimit="0.99 0.99 0.001">'
                f'<joint joint="nut" coef="1"/>{nut}</fixed>'
            )
            nut = '<joint joint="nut" coef="-1"/>'
        beside += (
            f'<body><joint name="motor" type="hinge" axis="1 0 0" damping="{body.motor_viscous_N_s_per_m * lever**2}" '
            f'frictionloss="{body.motor_friction_N * lever}" {soft}/>{lump(body.motor_mass_kg * lever**2)}</body>'
        )
        tendons += (
            f'<fixed stiffness="{body.stiffness_N_per_m * (1.0 - wrong["softening"])}" springlength="0 0" '
            f'damping="{body.damping_N_s_per_m}"><joint joint="motor" coef="{lever}"/>{nut}</fixed>'
        )
    far = 5.0 * value["travel_m"]
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler angle="radian"/>
        <option timestep="{kind.period_s / kind.steps}" integrator="{machine.integrator}"
            gravity="0 0 {-GRAVITY_M_PER_S2}" tolerance="1e-12"><flag contact="disable"/></option>
        <worldbody>
            <body gravcomp="{held}"><joint name="table" {machine.joint} limited="true" range="{-far} {far}"
                damping="{viscous + wrong["grease_N_s_per_m"]}" stiffness="{wrong["cable_N_per_m"]}"
                frictionloss="{body.table_friction_N}" {soft}/>{lump(table_kg)}{inner}</body>
            {beside}
        </worldbody>
        <tendon>{tendons}</tendon></mujoco>"""
    )


def lump(mass: float, inertia: float | None = None) -> str:
    """Return a mass whose moment of inertia, about its joint, has the same number."""
    turned = mass if inertia is None else inertia
    return f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{turned} {turned} {turned}"/>'


class Loop(NamedTuple):
    """Gains of the cascade as they are, and by how many cycles its force is late."""

    gains: Mapping[str, float]
    late_cycles: float


def march(
    machine: MachineKind,
    value: Mapping[str, float],
    body: Body,
    loop: Loop,
    planted: Mapping[str, float],
    command: FloatArray,
    rng: np.random.Generator | None,
) -> FloatArray:
    """Return the (n, 3) readings of motor position, table position and asked force in each cycle, noise with an rng.

    Parameters
    ----------
    machine : MachineKind
    value : mapping
        Its data sheet.
    body : Body
        How it really is.
    loop : Loop
    planted : mapping
        Fields of `Wrong` that are not as in a sound axis.
    command : (n, 3) array
        Position, velocity and acceleration.
    rng : numpy Generator, optional
    """
    kind, gains = machine.axis, loop.gains
    wrong = {**Wrong()._asdict(), "unbalance_N": 0.0, "unbalance_rad": 0.0, **planted}
    model = compiled(machine, value, body, wrong)
    data = mujoco.MjData(model)
    table = model.joint("table").id
    motor = model.joint("motor").id if kind.is_elastic else table
    lever = value["lead_m"] / TURN if kind.is_elastic else 1.0
    noise, scale, n = np.zeros((len(command), 3)), 1.0, len(command)
    if rng is not None:
        scale += value["friction_change"] * float(np.clip(rng.standard_normal(), -2.5, 2.5))
        sizes = (value["position_noise_m"],) * 2 + (value["force_noise_share"] * value["friction_N"],)
        noise = rng.standard_normal((n, 3)) * sizes
        model.dof_frictionloss *= scale
    data.qpos[:] = command[0, 0] * (model.jnt_type != mujoco.mjtJoint.mjJNT_HINGE if kind.is_elastic else 1.0)
    data.qpos[motor] = command[0, 0] / lever
    if wrong["carried_kg"] > 0.0:
        data.qpos[table + 1] = 0.0
    surroundings = Surroundings(body, wrong, value, scale)
    is_plain = planted.keys() <= NATIVE
    held_N = 0.0 if kind.name == "vertical_axis" else body.weight_N
    h, late = kind.period_s / kind.steps, round((loop.late_cycles + wrong["late_s"] / kind.period_s) * kind.steps)
    top, integral_N = gains["force_limit_N"], body.weight_N
    asked, out = [integral_N] * (late + 1), np.empty((n, 3))
    last, lag_1, lag_2 = None, integral_N, integral_N
    for cycle, (position, speed, rate) in enumerate(command.tolist()):
        reading = float(data.qpos[motor]) * lever + noise[cycle, 0]
        if wrong["step_m"] > 0.0:
            reading = wrong["step_m"] * round(reading / wrong["step_m"])
        error = gains["velocity_feedforward"] * speed + gains["position_gain_per_s"] * (position - reading)
        error -= 0.0 if last is None else (reading - last) / kind.period_s
        last = reading
        ideal = gains["velocity_gain_N_s_per_m"] * error + integral_N + gains["acceleration_feedforward_kg"] * rate
        if abs(ideal) < top:
            integral_N += gains["integral_gain_N_per_m"] * kind.period_s * error
        force = min(max(ideal, -top), top)
        out[cycle] = reading, float(data.qpos[table]) + noise[cycle, 1], force + noise[cycle, 2]
        for _ in range(kind.steps):
            asked.append(force)
            acting = asked[-1 - late]
            if wrong["lag_s"] > 0.0:
                share = 1.0 - math.exp(-2.0 * h / wrong["lag_s"])
                lag_1 += (acting - lag_1) * share
                lag_2 += (lag_1 - lag_2) * share
                acting = lag_2
            if wrong["knee_N"] > 0.0:
                acting /= (1.0 + abs(acting / wrong["knee_N"]) ** 3) ** (1.0 / 3.0)
            resists = held_N
            if not is_plain:
                x, v, at = float(data.qpos[table]), float(data.qvel[table]), float(data.qpos[motor]) * lever
                load = body.stiffness_N_per_m * (at - x) if kind.is_elastic else acting
                more_N, model.dof_frictionloss[table] = surroundings.forces(data.time, h, x, v, load)
                resists += more_N
                acting -= surroundings.cogging(at)
            data.qfrc_applied[table] = -resists
            data.qfrc_applied[motor] = acting * lever if kind.is_elastic else acting - resists
            mujoco.mj_step(model, data)
        del asked[: -late - 1]
    return out


class Surroundings:
    """What acts on the table beside MuJoCo's own springs, damping and gravity, and the level of its dry friction."""

    def __init__(self, body: Body, wrong: Mapping[str, float], value: Mapping[str, float], scale: float) -> None:
        self.body, self.wrong, self.scale = body, wrong, scale
        self.width, self.pitch_m = value["friction_width_m_per_s"], value["pitch_m"]
        self.path_m = 0.0
        self.stops_N = [0.0, 0.0]
        self.most_N = (0.6 * wrong["loop_N"], 0.4 * wrong["loop_N"])
        self.far_m = (0.5 * wrong["loop_m"], 1.5 * wrong["loop_m"])

    def cogging(self, x: float) -> float:
        """Return the pull of magnets against motion of the motor at x."""
        if self.wrong["cogging_N"] == 0.0:
            return 0.0
        angle = TURN * x / self.pitch_m + self.wrong["pitch_phase_rad"]
        return self.wrong["cogging_N"] * (math.sin(angle) + 0.2 * math.sin(2.0 * angle))

    def forces(self, t: float, h: float, x: float, v: float, load: float) -> tuple[float, float]:
        """Return the force against motion, and the level of friction, from t for a step h."""
        w = self.wrong
        self.path_m += abs(v) * h
        sign = math.tanh(v / self.width)
        force = w["constant_N"] + w["direction_viscous_N_s_per_m"] * abs(v)
        force += w["drag_N_at_1_m_per_s"] * abs(v) ** 0.8 * v
        force += w["square_N"] * ((t * SQUARE_HZ) % 1.0 >= 0.5)
        force += w["line_N"] * math.sin(TURN * w["line_Hz"] * t + w["line_phase_rad"])
        if w["loop_N"] > 0.0:
            for index, (most, far) in enumerate(zip(self.most_N, self.far_m, strict=True)):
                self.stops_N[index] = min(max(self.stops_N[index] + most / far * v * h, -most), most)
            force += sum(self.stops_N)
        level = self.scale * self.body.table_friction_N * (1.0 + w["direction_share"] * sign)
        level *= 1.0 - w["dip"] * math.exp(-abs(v) / w["dip_m_per_s"])
        level += w["preload_N"] + w["stick_N"] / (1.0 + (v / w["stick_m_per_s"]) ** 2) + w["load_share"] * abs(load)
        level += w["place_N"] * math.sin(TURN * x / w["place_period_m"] + w["place_phase_rad"])
        level += w["cold_N"] * math.exp(-self.path_m / w["cold_path_m"])
        level += w["bump_N"] * math.exp(-0.5 * ((x - w["bump_place_m"]) / w["bump_width_m"]) ** 2)
        return force, max(level, 0.0)


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
    start, said = process_time(), {"status": FAILED, "effects": {}, "unknown": 0.0, "none": 0.0}
    try:
        with threadpool_limits(1):
            answer = diagnose(nominal, records, holdouts).answer
        said = {
            "status": OK,
            "effects": answer.chances(),
            "unknown": answer.unknown_probability,
            "none": answer.no_gap_probability,
        }
    except FdbenchError as error:
        said["message"] = str(error)
    return {"key": f"{nonce}:{number}", "truth": case.truth, "said": {**said, "seconds": process_time() - start}}


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
    order = sorted(said["effects"], key=said["effects"].__getitem__, reverse=True)
    is_named = bool(order) and said["effects"][order[0]] > NAMED
    if said["status"] == FAILED:
        return "failed"
    if truth["role"] == "nothing":
        return "named on nothing" if is_named else "nothing named"
    if truth["role"] == "unlisted":
        return "unknown told" if said["unknown"] > NAMED else "wrongly named" if is_named else "nothing told"
    own = truth["listed"][0]["name"]
    place = order.index(own) if said["effects"].get(own, 0.0) > 0.0 else len(order)
    return "first" if place == 0 else "among three" if place < 3 else "missed"


def print_sheet(lines: Sequence[Mapping[str, Any]]) -> None:
    """Print a line for each axis, and how often each role was answered how."""
    for line in lines:
        truth, said = line["truth"], line["said"]
        there = [
            f"{item['name']} ({math.sqrt(item['mean_square']):.1f})" for item in (*truth["listed"], *truth["unlisted"])
        ]
        order = sorted(said["effects"], key=said["effects"].__getitem__, reverse=True)[:3]
        given = ", ".join(f"{name} {said['effects'][name]:.2f}" for name in order if said["effects"][name] > 0.0)
        print(
            f"- axis {line['key'].rsplit(':', 1)[1]}, {truth['kind']}, {'with' if truth['controller'] else 'without'} "
            f"controller, {truth['repeats']} repeats: {', '.join(there) or 'nothing'}; {told(line)}: {given or '-'}; "
            f"unknown {said['unknown']:.2f}, none {said['none']:.2f}; {said['seconds']:.0f} s"
        )
    for role in dict.fromkeys(ROLES):
        for title, which in (("", (True, False)), (", with controller", (True,)), (", without", (False,))):
            words = [
                told(line) for line in lines if line["truth"]["role"] == role and line["truth"]["controller"] in which
            ]
            counts = ", ".join(f"{word} {words.count(word)}" for word in sorted(set(words)))
            print(f"{role}{title}: {len(words)} axes; {counts or '-'}")
    beside = [
        line["key"].rsplit(":", 1)[1]
        for line in lines
        for there in [{item["name"] for item in line["truth"]["listed"]}]
        if any(chance > NAMED and name not in there for name, chance in line["said"]["effects"].items())
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
