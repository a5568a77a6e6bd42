"""Plant and records of a rotary axis as those of its arc, and back."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fdbench.effects import effects
from fdbench.errors import RecordError, SpecError
from fdbench.record import COLUMNS, FloatArray, Record
from fdbench.rotary import COLUMN_OF_FORCE, PARTS, name_on_the_arc, rotary_name

LINEAR_COLUMNS = tuple(name for name in COLUMNS if rotary_name(name) != name)
_MOTORS = {"torque_motor": "linear_motor", "geared_motor": "rotary_motor"}


def plant_on_the_arc(plant: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the table [plant] of a rotary axis as that of its arc.

    A ``torque_motor`` turns the axis itself; a ``geared_motor`` turns it by a gear, with its inertia and its torque on
    the motor's side. Behind it are a ``load`` and, where it is elastic, a ``shaft``. Everything else has the names of
    a linear axis with the units of a rotary one.
    """
    found: dict[str, Any] = {}
    for key, value in plant.items():
        name = PARTS.get(key, name_on_the_arc(key))
        if key == "effects" and isinstance(value, list):
            value = [_effect_on_the_arc(item) for item in value]
        elif key == "motor" and isinstance(value, Mapping):
            value = _motor_on_the_arc(value, f"{where}.motor")
        elif isinstance(value, Mapping):
            value = {name_on_the_arc(inner): item for inner, item in value.items()}
        found[name] = value
    return found


def _motor_on_the_arc(motor: Mapping[str, Any], where: str) -> dict[str, Any]:
    kind = motor.get("kind")
    if kind not in _MOTORS:
        raise SpecError(f"{where}.kind: {kind!r}; a rotary axis has one of {', '.join(_MOTORS)}.")
    if kind == "torque_motor":
        return {name_on_the_arc(key): value for key, value in motor.items()} | {"kind": _MOTORS[kind]}
    ratio = motor.get("gear_ratio")
    if isinstance(ratio, bool) or not isinstance(ratio, int | float) or not 0.0 < ratio < math.inf:
        raise SpecError(f"{where}.gear_ratio: {ratio!r}; turns of the motor for one of the axis, a number above 0.")
    kept = {key: value for key, value in motor.items() if key not in ("kind", "gear_ratio")}
    named = {(name_on_the_arc(key) if key.startswith("viscous") else key): value for key, value in kept.items()}
    return {"kind": _MOTORS[kind], "lead_m": 2.0 * math.pi / ratio, **named}


def _effect_on_the_arc(effect: Any) -> Any:
    if not isinstance(effect, Mapping) or effect.get("kind") not in effects.names():
        return effect
    angles = {item.name for item in effects.get(effect["kind"]).parameters()}
    return {key if key in angles else name_on_the_arc(key): value for key, value in effect.items()}


def plant_of_rotary(plant: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table [plant] of an arc as that of the rotary axis, the inverse of `plant_on_the_arc`."""
    parts = {linear: rotary for rotary, linear in PARTS.items()}
    motors = {linear: rotary for rotary, linear in _MOTORS.items()}
    found: dict[str, Any] = {}
    for key, value in plant.items():
        name = parts.get(key, rotary_name(key))
        if key == "effects":
            value = [{rotary_name(inner): item for inner, item in effect.items()} for effect in value]
        elif key == "motor":
            geared = {"gear_ratio": 2.0 * math.pi / value["lead_m"]} if "lead_m" in value else {}
            kept = {inner: item for inner, item in value.items() if inner not in ("kind", "lead_m")}
            value = {"kind": motors[value["kind"]], **geared, **{rotary_name(k): item for k, item in kept.items()}}
        elif isinstance(value, Mapping):
            value = {rotary_name(inner): item for inner, item in value.items()}
        found[name] = value
    return found


def record_of_rotary(record: Record) -> Record:
    """Return the record of an arc with the columns of the rotary axis."""
    return Record({rotary_name(name): values for name, values in record.items()}, record.provenance, record.source)


def record_on_the_arc(record: Record, geared: bool) -> Record:
    """Return the record of a rotary axis with the columns of its arc; angles that start anew each turn are unwound.

    Parameters
    ----------
    record : Record
        With ``position_rad``, ``reference_position_rad`` and so on, and ``motor_torque_Nm`` or ``motor_current_A``.
    geared : bool
        Whether the torque is that in front of a gear.

    Raises
    ------
    RecordError
        If a column is one of a linear axis.
    """
    columns: dict[str, FloatArray] = {}
    for name, values in record.items():
        if name in LINEAR_COLUMNS:
            raise RecordError(
                f"{record.source}: column {name} is of a linear axis, the model's is rotary: {rotary_name(name)}."
            )
        linear = COLUMN_OF_FORCE.get(name, name_on_the_arc(name))
        kept = linear not in LINEAR_COLUMNS or (geared and name in COLUMN_OF_FORCE)
        columns[name if kept else linear] = np.unwrap(values) if name.endswith("position_rad") else values
    return Record(columns, record.provenance, record.source)
