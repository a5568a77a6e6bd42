"""A nominal drive with knobs: what an output error turns until the simulation is the record."""

import cmath
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect, Port
from fdbench.plants._controllers import Cascade
from fdbench.plants._friction_curve import steady_force
from fdbench.plants.feed_drive import FeedDrive, LinearMotor, RotaryMotor

LEAST = -0.9  # setting of a factor, which stays positive


class Knob(NamedTuple):
    """One number that is 0 at the nominal value; ``turned`` gives the drive at another.

    ``is_stated``: it moves a parameter of the rigid model, of which the data sheet says how exact it is.
    """

    name: str
    turned: Callable[[FeedDrive, float], FeedDrive]
    is_stated: bool


def knobs_of(drive: FeedDrive) -> list[Knob]:
    r"""Return the knobs of a drive.

    Stated are factors :math:`1 + \theta` of mass, viscous friction and each nominal friction, shared between both
    sides as before, and a constant force in units of the Coulomb friction. Others are factors :math:`e^\theta` of
    the screw's stiffness, of the numbers that shape a friction, and of the gains of a cascade's velocity loop, in which
    the motor's constant is. The gain of a velocity loop alone cannot be told from the mass.

    >>> from fdbench.scenario import load_scenario
    >>> [knob.name for knob in knobs_of(load_scenario("ShakerControl-v1").plant)]
    ['mass', 'viscous_friction', 'effects.0', 'effects.0.transition_velocity_m_per_s']
    """
    knobs = [Knob("mass", _heavier, True)]
    if drive.viscous_friction_N_s_per_m > 0.0:
        knobs.append(Knob("viscous_friction", _thicker, True))
    for place, effect in enumerate(drive.effects):
        if effect.port not in (Port.MOTOR_FORCE, Port.TABLE_FORCE) or effect.disturbance:
            continue
        knobs.append(Knob(f"effects.{place}", _level(drive, place), True))
        amplitudes = (effect.amplitude, *effect.further_amplitudes)
        for name in (item.name for item in effect.parameters() if item.name not in amplitudes):
            knobs.append(Knob(f"effects.{place}.{name}", _shape(place, name), False))
    if drive.screw is not None:
        knobs.append(Knob("screw.stiffness_N_per_m", _stiffer, False))
    if isinstance(drive.controller, Cascade):
        knobs.append(Knob("controller.velocity_gain_N_s_per_m", _louder, False))
    return knobs


def turned(drive: FeedDrive, knobs: Sequence[Knob], settings: NDArray[np.inexact]) -> FeedDrive:
    """Return the drive with each of the knobs at its setting (n_knobs,), which may be complex to differentiate."""
    for knob, setting in zip(knobs, settings.tolist(), strict=True):
        drive = knob.turned(drive, setting)
    return drive


def _heavier(drive: FeedDrive, setting: float) -> FeedDrive:
    factor = 1.0 + setting
    motor: LinearMotor | RotaryMotor = drive.motor
    if isinstance(motor, LinearMotor):
        motor = dataclasses.replace(motor, mass_kg=factor * motor.mass_kg)
    else:
        motor = dataclasses.replace(motor, inertia_kg_m2=factor * motor.inertia_kg_m2)
    table = drive.table
    if table is not None:
        table = dataclasses.replace(table, mass_kg=factor * table.mass_kg)
    return dataclasses.replace(drive, motor=motor, table=table)


def _thicker(drive: FeedDrive, setting: float) -> FeedDrive:
    factor = 1.0 + setting
    motor, table = drive.motor, drive.table
    motor = dataclasses.replace(motor, viscous_friction_N_s_per_m=factor * motor.viscous_friction_N_s_per_m)
    if table is not None:
        table = dataclasses.replace(table, viscous_friction_N_s_per_m=factor * table.viscous_friction_N_s_per_m)
    return dataclasses.replace(drive, motor=motor, table=table)


def _stiffer(drive: FeedDrive, setting: float) -> FeedDrive:
    screw = drive.screw
    if screw is not None:
        screw = dataclasses.replace(screw, stiffness_N_per_m=_exp(setting) * screw.stiffness_N_per_m)
    return dataclasses.replace(drive, screw=screw)


def _louder(drive: FeedDrive, setting: float) -> FeedDrive:
    controller, factor = drive.controller, _exp(setting)
    if isinstance(controller, Cascade):
        controller = dataclasses.replace(
            controller,
            velocity_gain_N_s_per_m=factor * controller.velocity_gain_N_s_per_m,
            integral_gain_N_per_m=factor * controller.integral_gain_N_per_m,
        )
    return dataclasses.replace(drive, controller=controller)


def _exp(setting: Any) -> Any:
    return cmath.exp(setting) if isinstance(setting, complex) else math.exp(setting)


def _with_effect(drive: FeedDrive, place: int, effect: Effect) -> FeedDrive:
    return dataclasses.replace(drive, effects=(*drive.effects[:place], effect, *drive.effects[place + 1 :]))


def _with_value(effect: Effect, name: str, value: float) -> Effect:
    return type(effect)(**{item.name: getattr(effect, item.name) for item in effect.parameters()} | {name: value})


def _level(drive: FeedDrive, place: int) -> Callable[[FeedDrive, float], FeedDrive]:
    effect, fast = drive.effects[place], drive.velocity_limit_m_per_s
    if steady_force(effect, fast) != steady_force(effect, -fast):
        return lambda other, setting: _with_effect(other, place, other.effects[place].scaled(1.0 + setting))
    nominal = getattr(effect, effect.amplitude)
    unit = abs(drive.friction_line.coulomb_N) or 1.0
    return lambda other, setting: _with_effect(
        other, place, _with_value(other.effects[place], effect.amplitude, nominal + setting * unit)
    )


def _shape(place: int, name: str) -> Callable[[FeedDrive, float], FeedDrive]:
    def moved(drive: FeedDrive, setting: float) -> FeedDrive:
        effect = drive.effects[place]
        value = _exp(setting) * getattr(effect, name)
        return _with_effect(drive, place, _with_value(effect, name, value))

    return moved
