"""Kinds of foreign axis: what a machine is nominally, how it really is, and the model that its owner would write."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from fdbench.specification import load_toml, read
from fdbench.virtual_axes.foreign import loops, mechanics
from fdbench.virtual_axes.foreign.mechanics import TURN
from fdbench.virtual_axes.foreign.motions import Space

KINDS = Path(__file__).with_name("kinds.toml")
IMPERFECTIONS = Path(__file__).with_name("imperfections.toml")
LAWS = {name: float(getattr(mechanics, name.upper())) for name in ("tanh", "soft", "arctan", "root", "bristle")}
INTEGRATORS = {name: float(getattr(mechanics, name.upper())) for name in ("runge_kutta", "heun", "proximal")}
FORMS = {
    name: float(getattr(loops, name.upper()))
    for name in ("cascade", "filtered", "tachometer", "counts", "two_sensors", "torque")
}
MOTOR_SHARE, FRICTION_ON_MOTOR, SCREW_DAMPING = 0.35, 0.3, 0.04
NOMINAL_WIDTH_M_PER_S, MOST_NOMINAL_WIDTH_M_PER_S = 1e-3, 0.05
BRISTLE_DAMPING = 0.3
DEADBAND_COUNTS = 10.0

# Standard deviations by which data sheets are off, as shares; that of the force offset in units of the friction.
ERRORS: Mapping[str, float] = MappingProxyType(
    {
        "mass": 0.05,
        "viscous": 0.3,
        "friction": 0.3,
        "offset": 0.05,
    }
)
GAIN_ERROR, CONSTANT_ERROR, WEIGHT_ERROR = 0.02, 0.05, 0.1


@dataclass(frozen=True, kw_only=True)
class AxisKind:
    """One kind of axis in ``kinds.toml``.

    Attributes
    ----------
    name, law, integrator, form : str
    ranges : mapping of str to (low, high)
    motions, unlisted, without : tuple of str
        Recipes that are recorded, effects that the library lacks, and listed effects that this kind has not.
    motor, logs, columns, command, file_format, feedback : str
        How its owner models and logs it.
    controller_given : bool
    period_s : float
        Control period; every ``log_every``-th cycle is logged, each is integrated in ``steps``.
    unlisted_probability : float
    """

    name: str
    law: str
    integrator: str
    form: str
    motions: tuple[str, ...]
    motor: str
    logs: str
    ranges: Mapping[str, tuple[float, float]]
    unlisted: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    columns: str = "position"
    command: str = "full"
    file_format: str = "parquet"
    feedback: str = "motor"
    controller_given: bool = True
    period_s: float = 1e-3
    log_every: int = 1
    steps: int = 20
    unlisted_probability: float = 0.12

    @property
    def is_elastic(self) -> bool:
        """Whether motor and table are two masses."""
        return "stiffness_N_per_m" in self.ranges

    @property
    def is_open(self) -> bool:
        """Whether forces are commanded."""
        return self.form == "torque"


@dataclass(frozen=True, kw_only=True)
class Imperfection:
    """One entry of ``imperfections.toml``: how fields of `mechanics.Wrong` are drawn, and in units of what."""

    name: str
    draw: Mapping[str, tuple[float, float]]
    scale: Mapping[str, str] = field(default_factory=dict)
    signed: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ()
    wrong_nominal_value: bool = False
    needs_two_masses: bool = False
    background: tuple[bool, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _AxisKinds:
    nominal: Mapping[str, str]
    kinds: tuple[AxisKind, ...]


@dataclass(frozen=True, kw_only=True)
class ImperfectionFile:
    """What stands in ``imperfections.toml``."""

    listed: tuple[Imperfection, ...]
    unlisted: tuple[Imperfection, ...]


@lru_cache(maxsize=1)
def _file() -> _AxisKinds:
    return read(_AxisKinds, load_toml(KINDS), KINDS.name)


def kinds() -> tuple[AxisKind, ...]:
    """Return every kind."""
    return _file().kinds


@lru_cache(maxsize=1)
def imperfections() -> ImperfectionFile:
    """Return every imperfection."""
    return read(ImperfectionFile, load_toml(IMPERFECTIONS), IMPERFECTIONS.name)


def nominal_values(kind: AxisKind, upper: bool, rng: np.random.Generator) -> dict[str, float]:
    """Return the drawn values of a data sheet, from the upper or the lower half of each range."""
    start = 0.5 if upper else 0.0
    found = {
        name: float(f"{low * (high / low) ** (start + 0.5 * rng.random()):.4g}")
        for name, (low, high) in kind.ranges.items()
    }
    found["viscous_N_s_per_m"] = float(f"{found['viscous_share'] * found['friction_N'] / found['speed_m_per_s']:.4g}")
    found["weight_N"] = float(f"{found.get('weight_share', 0.0) * found['friction_N']:.4g}")
    return found


def scales(value: Mapping[str, float]) -> dict[str, float]:
    """Return the units in which imperfections are drawn."""
    friction, speed, travel = value["friction_N"], value["speed_m_per_s"], value["travel_m"]
    return {
        **value,
        "peak_N": value["mass_kg"] * value["acceleration_m_per_s2"] + friction * (1.0 + value["viscous_share"]),
        "noise_m": value["position_noise_m"],
        "drag_N_at_1_m_per_s": friction / speed**1.8,
        "spring_N_per_m": friction / travel,
        "softness": math.sqrt(5e7 / value.get("stiffness_N_per_m", 5e7)),
    }


def space_of(kind: AxisKind, value: Mapping[str, float]) -> Space:
    """Return what the machine allows; a loop in counts follows unsmoothed trapezoids."""
    smoothing_s = 0.0 if kind.form == "counts" else 0.03
    return Space(value["travel_m"], value["speed_m_per_s"], value["acceleration_m_per_s2"], kind.period_s, smoothing_s)


def body_of(kind: AxisKind, value: Mapping[str, float], errors: Mapping[str, float]) -> mechanics.Body:
    """Return the machine whose values are off their nominal ones by ``errors``."""
    mass = value["mass_kg"] * (1.0 + errors["mass"])
    viscous = value["viscous_N_s_per_m"] * (1.0 + errors["viscous"])
    friction = value["friction_N"] * (1.0 + errors["friction"])
    share = MOTOR_SHARE if kind.is_elastic else 0.0
    on_motor = FRICTION_ON_MOTOR if kind.is_elastic else 0.0
    stiffness = value.get("stiffness_N_per_m", 0.0)
    return mechanics.Body(
        motor_mass_kg=share * mass,
        table_mass_kg=(1.0 - share) * mass,
        motor_viscous_N_s_per_m=share * viscous,
        table_viscous_N_s_per_m=(1.0 - share) * viscous,
        stiffness_N_per_m=stiffness,
        damping_N_s_per_m=_damping(stiffness, value["mass_kg"]),
        motor_friction_N=on_motor * friction,
        table_friction_N=(1.0 - on_motor) * friction,
        law=LAWS[kind.law],
        width_m_per_s=value["friction_width_m_per_s"],
        presliding_m=value.get("presliding_m", 0.0),
        presliding_damping_N_s_per_m=_bristle_damping(value) if "presliding_m" in value else 0.0,
        weight_N=value["weight_N"] * (1.0 + errors.get("weight", 0.0)) + errors["offset"] * value["friction_N"],
        integrator=INTEGRATORS[kind.integrator],
    )


def _damping(stiffness: float, mass: float) -> float:
    return 2.0 * SCREW_DAMPING * math.sqrt(stiffness * mass * MOTOR_SHARE * (1.0 - MOTOR_SHARE))


def _bristle_damping(value: Mapping[str, float]) -> float:
    return BRISTLE_DAMPING * math.sqrt(value["friction_N"] / value["presliding_m"] * value["mass_kg"])


def gains_of(kind: AxisKind, value: Mapping[str, float]) -> dict[str, float]:
    """Return the nominal gains, for the bandwidth of the machine."""
    omega = TURN * value["bandwidth_Hz"]
    velocity_gain = float(f"{omega * value['mass_kg']:.4g}")
    integral = 0.0 if kind.form in ("tachometer", "counts") else omega / 12.0
    ahead = value["mass_kg"] if kind.form in ("counts", "tachometer") else 0.0
    return {
        "position_gain_per_s": float(f"{omega / 4.5:.4g}"),
        "velocity_gain_N_s_per_m": velocity_gain,
        "integral_gain_N_per_m": float(f"{integral * velocity_gain:.4g}"),
        "velocity_feedforward": 1.0 if kind.form != "counts" else 1.0 + value["viscous_N_s_per_m"] / velocity_gain,
        "acceleration_feedforward_kg": ahead,
        "force_limit_N": float(f"{4.0 * scales(value)['peak_N']:.3g}"),
    }


def loop_of(kind: AxisKind, value: Mapping[str, float], errors: Mapping[str, float]) -> loops.ForeignLoop:
    """Return the controller with its gains and the motor constant off their nominal ones by ``errors``."""
    gains = gains_of(kind, value)
    for name in ("position_gain_per_s", "velocity_gain_N_s_per_m", "integral_gain_N_per_m"):
        gains[name] *= 1.0 + errors.get(name, 0.0)
    return loops.ForeignLoop(
        form=FORMS[kind.form],
        reads_table=float(kind.feedback == "table"),
        filter_s=value.get("filter_s", 0.0),
        count_m=value.get("count_m", 0.0),
        deadband_counts=DEADBAND_COUNTS,
        latency_s=value["latency"] * kind.period_s,
        force_constant_ratio=1.0 + errors.get("constant", 0.0),
        **gains,
    )


def model_of(kind: AxisKind, value: Mapping[str, float]) -> dict[str, Any]:
    """Return the tables of the model file that the owner of the machine would write."""
    share = MOTOR_SHARE if kind.is_elastic else 1.0
    mass, viscous = value["mass_kg"], value["viscous_N_s_per_m"]
    motor: dict[str, Any] = {"kind": f"{kind.motor}_motor", "viscous_friction_N_s_per_m": share * viscous}
    if kind.motor == "rotary":
        motor |= {"inertia_kg_m2": share * mass * (value["lead_m"] / TURN) ** 2, "lead_m": value["lead_m"]}
    else:
        motor["mass_kg"] = share * mass
    motor |= {name: value[name] for name in value if name.endswith("_per_A")}
    plant: dict[str, Any] = {
        "kind": "feed_drive",
        "travel_m": 1.5 * value["travel_m"],
        "velocity_limit_m_per_s": 2.0 * value["speed_m_per_s"],
        "motor": motor,
    }
    if kind.controller_given:
        span = 0 if kind.form == "tachometer" else 1
        gains = gains_of(kind, value)
        plant["controller"] = {"kind": "cascade", **gains, "feedback": kind.feedback, "difference_span": span}
    if kind.is_elastic:
        stiffness = value["stiffness_N_per_m"]
        plant["table"] = {"mass_kg": (1.0 - share) * mass, "viscous_friction_N_s_per_m": (1.0 - share) * viscous}
        plant["screw"] = {"stiffness_N_per_m": stiffness, "damping_N_s_per_m": _damping(stiffness, mass)}
    plant["effects"] = _known(value)
    return {
        "plant": plant,
        "simulation": {"substeps": 10},
        "uncertainty": {
            "mass": math.hypot(ERRORS["mass"], CONSTANT_ERROR),
            "viscous": ERRORS["viscous"],
            "known_effects": ERRORS["friction"],
            "force_offset_N": ERRORS["offset"] * value["friction_N"],
        },
    }


def _known(value: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the nominal effects: the friction, and a weight where there is one."""
    friction, names = value["friction_N"], _file().nominal
    known: list[dict[str, Any]] = []
    if "presliding_m" in value:
        known.append(
            {
                "kind": names["bristles"],
                "coulomb_force_N": friction,
                "static_force_N": friction,
                "stribeck_velocity_m_per_s": NOMINAL_WIDTH_M_PER_S,
                "bristle_stiffness_N_per_m": friction / value["presliding_m"],
                "bristle_damping_N_s_per_m": _bristle_damping(value),
            }
        )
    else:
        width = min(MOST_NOMINAL_WIDTH_M_PER_S, max(NOMINAL_WIDTH_M_PER_S, 2e-3 * value["speed_m_per_s"]))
        known.append({"kind": names["friction"], "coulomb_force_N": friction, "transition_velocity_m_per_s": width})
    if value["weight_N"] != 0.0:
        known.append({"kind": names["weight"], "constant_force_N": value["weight_N"]})
    return known
