"""Axes in MuJoCo: its bodies, joints, tendons and soft dry friction, and the cascade that moves them."""

import math
from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from fdbench.record import FloatArray
from fdbench.virtual_axes.foreign.kinds import AxisKind
from fdbench.virtual_axes.foreign.mechanics import TURN, Body, Wrong

mujoco: Any
try:
    mujoco = import_module("mujoco")
except ModuleNotFoundError:
    mujoco = None

GRAVITY_M_PER_S2 = 9.81
UNBALANCE_RADIUS_M = 0.02
NUT_SHARE = 0.3  # of the table's mass, in front of a gap
SQUARE_HZ = 1.7
NATIVE = {
    *("payload_kg", "grease_N_s_per_m", "cable_N_per_m", "cable_length_m", "gap_m", "softening", "late_s", "step_m"),
    *("carried_kg", "carried_Hz", "carried_damping", "unbalance_N", "unbalance_rad"),
}  # what needs no force beside those of MuJoCo
UNLISTED = ("two_element_hysteresis", "friction_bump", "square_wave_force", "falling_friction")
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
