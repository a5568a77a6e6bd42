"""Axes for closed-form anchors: any mechanics and controller, and the whole library of effects, all off but some.

All share the stepper of `test_every_effect`, which is compiled once.
"""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect, effects
from fdbench.motions import Motion
from fdbench.motions.held_levels import HeldLevels
from fdbench.plants._controllers import OpenLoop
from fdbench.plants.feed_drive import FeedDrive, LinearMotor, Screw, Table
from fdbench.scenario import load_scenario
from fdbench.simulate.axis import Axis
from fdbench.simulate.system import Noise, Setup, Timing

FloatArray = NDArray[np.float64]
MASS_KG = 50.0
AT_REST = HeldLevels(levels_m_per_s=(0.0,), hold_s=1.0, acceleration_limit_m_per_s2=1.0)
FREE = OpenLoop(acceleration_feedforward_kg=0.0, force_limit_N=1e6)
BALL_SCREW = load_scenario("BallScrewAxis-v0").plant
LIBRARY = tuple(effects.get(name) for name in effects.names())


def effect(name: str, **changes: float) -> Effect:
    """Return an effect at its typical size, with changes."""
    return effects.get(name).typical(**changes)


def rigid(viscous: float = 0.0, **changes: Any) -> FeedDrive:
    """Return a rigid axis of 50 kg without feedback."""
    drive = FeedDrive(
        motor=LinearMotor(mass_kg=MASS_KG, viscous_friction_N_s_per_m=viscous),
        controller=FREE,
        travel_m=100.0,
        velocity_limit_m_per_s=100.0,
        effects=BALL_SCREW.effects,
    )
    return dataclasses.replace(drive, **changes)


def elastic(**changes: Any) -> FeedDrive:
    """Return 30 kg and 20 kg on an undamped spring of 1 N/um, without feedback."""
    return rigid(
        motor=LinearMotor(mass_kg=30.0, viscous_friction_N_s_per_m=0.0),
        table=Table(mass_kg=20.0, viscous_friction_N_s_per_m=0.0),
        screw=Screw(stiffness_N_per_m=1e6, damping_N_s_per_m=0.0),
        **changes,
    )


def axis(
    drive: FeedDrive,
    *on: Effect,
    motion: Motion = AT_REST,
    duration_s: float = 1.0,
    sampling_time_s: float = 1e-3,
    substeps: int = 10,
    n_lanes: int = 1,
    noise: Noise | None = None,
) -> Axis:
    """Return lanes of an axis, started, with the given effects on in all lanes and no others."""
    timing = Timing(sampling_time_s=sampling_time_s, duration_s=duration_s, substeps=substeps)
    library = tuple(kind.typical() for kind in LIBRARY)
    setup = Setup(timing=timing, motion=motion, unmodelled=library, noise=noise or Noise())
    made = drive.system(setup, n_lanes)
    for number in range(len(made.effects)):
        made.enable(number, False)
    for item in on:
        switch(made, item)
    made.start(range(n_lanes))
    return made


def switch(made: Axis, item: Effect, on: bool = True, lanes: Any = None) -> None:
    """Set the parameters of an effect of the library and switch it on or off in some lanes."""
    number = len(made.effects) - len(LIBRARY) + LIBRARY.index(type(item))
    made.set_parameters(number, np.array(item.values()), lanes)
    made.enable(number, on, lanes)


def column(made: Axis, rows: FloatArray, name: str, lane: int = 0) -> FloatArray:
    """Return one logged column of one lane."""
    return rows[:, made.columns.index(name), lane]


def push(made: Axis, forces: FloatArray) -> FloatArray:
    """Return the rows of an axis without feedback under one force (N) for each sample, held over it."""
    return np.concatenate([made.advance(1, np.atleast_1d(force)) for force in forces])
