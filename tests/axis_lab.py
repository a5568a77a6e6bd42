"""A two-mass axis in a laboratory: its nominal model, and records of a few motions with one effect more."""

import dataclasses

import numpy as np
from scipy.interpolate import CubicSpline

from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.effects import Effect, effects
from fdbench.motions import motions
from fdbench.plants._controllers import Cascade
from fdbench.plants.feed_drive import FeedDrive, RotaryMotor, Screw, Table
from fdbench.record import Record
from fdbench.simulate.system import Noise, Setup, Timing

PERIOD_S, NOISE_M = 1e-3, 3e-8


def drive() -> FeedDrive:
    """Return the nominal axis: 118 kg of motor and screw, 60 kg of table, 60 N/um, 120 N of Coulomb friction."""
    return FeedDrive(
        motor=RotaryMotor(inertia_kg_m2=3e-4, lead_m=0.01, viscous_friction_N_s_per_m=400.0),
        table=Table(mass_kg=60.0, viscous_friction_N_s_per_m=200.0),
        screw=Screw(stiffness_N_per_m=6e7, damping_N_s_per_m=2900.0),
        controller=Cascade(
            position_gain_per_s=40.0,
            velocity_gain_N_s_per_m=2e4,
            integral_gain_N_per_m=2e5,
            velocity_feedforward=1.0,
            acceleration_feedforward_kg=0.0,
            force_limit_N=6000.0,
            feedback="motor",
            difference_span=1,
        ),
        travel_m=1.0,
        velocity_limit_m_per_s=3.0,
        effects=(effects.get("coulomb_friction").typical(coulomb_force_N=120.0),),
    )


def as_built(seed: int) -> FeedDrive:
    """Return the axis with values that the paper has slightly wrong."""
    random = np.random.default_rng(seed)
    paper = drive()
    assert isinstance(paper.motor, RotaryMotor)
    assert paper.table is not None
    mass, table, friction = 1.0 + 0.02 * random.normal(size=3)
    return dataclasses.replace(
        paper,
        motor=dataclasses.replace(paper.motor, inertia_kg_m2=3e-4 * mass),
        table=dataclasses.replace(paper.table, mass_kg=60.0 * table),
        effects=(paper.effects[0].scaled(friction),),
    )


def other_friction(axis: FeedDrive, factor: float) -> FeedDrive:
    """Return the axis with another friction, as it has from run to run."""
    return dataclasses.replace(axis, effects=tuple(item.scaled(factor) for item in axis.effects))


def protocol(factor: float) -> dict[str, tuple[object, float]]:
    """Return motions and durations; ``factor`` makes the held-out ones other motions of the same kind."""
    levels = tuple(factor * v for v in (0.01, 0.03, 0.06, 0.1, -0.1, -0.06, -0.03, -0.01))
    moves = motions.get("jerk_limited_moves")
    limits = {"velocity_m_per_s": 0.5 * factor, "acceleration_m_per_s2": 12.0 * factor, "jerk_m_per_s3": 800.0}
    return {
        "steps": (motions.get("held_levels")(levels_m_per_s=levels, hold_s=0.5, acceleration_limit_m_per_s2=2.0), 4.5),
        "fast": (moves(stops_m=(0.0, 0.15 * factor, 0.05, 0.2, 0.0), dwell_s=0.1, **limits), 3.0),
    }


def record(
    axis: FeedDrive,
    extra: tuple[Effect, ...],
    motion: object,
    duration_s: float,
    seed: int,
    noise_m: float = NOISE_M,
) -> Record:
    """Return what a logger writes."""
    setup = Setup(
        timing=Timing(sampling_time_s=PERIOD_S, duration_s=duration_s, substeps=10),
        motion=motion,  # type: ignore[arg-type]
        noise=Noise(motor_position_m=noise_m, table_position_m=noise_m),
        unmodelled=extra,
    )
    system = axis.system(setup)
    system.start([seed])
    rows = system.advance(system.n_samples)[:, :, 0]
    columns = {name: rows[:, index] for index, name in enumerate(system.columns)}
    return Record({"time_s": np.arange(system.n_samples) * PERIOD_S, **columns}, {}, f"record {seed}")


def repeated(axis: FeedDrive, *extra: Effect) -> list[list[Record]]:
    """Return two repeats of each motion, and of each held-out one."""
    return [
        [
            record(axis, extra, *motion, seed=10 * place + repeat)
            for motion in protocol(factor).values()
            for repeat in range(2)
        ]
        for place, factor in enumerate((1.0, 1.3))
    ]


def case(extra: tuple[Effect, ...], seed: int, noise_m: float = NOISE_M) -> tuple[Nominal, list[Record], list[Record]]:
    """Return the nominal model, two repeats of each motion, and one held-out record of each kind."""
    axis = as_built(seed)
    fitted = [
        record(axis, extra, motion, duration, 100 * seed + repeat, noise_m)
        for motion, duration in protocol(1.0).values()
        for repeat in range(2)
    ]
    judged = [
        record(axis, extra, motion, duration, 100 * seed + 50, noise_m) for motion, duration in protocol(1.3).values()
    ]
    return Nominal(plant=drive(), simulation=Simulation(substeps=10)), fitted, judged


def read_late(record: Record, late_s: float) -> Record:
    """Return a record whose table is read so much after the motor."""
    table = CubicSpline(record["time_s"], record["table_position_m"])(record["time_s"] - late_s)
    return Record({**record, "table_position_m": table}, dict(record.provenance), record.source)
