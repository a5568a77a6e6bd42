"""Masses and viscous friction, whichever side a data sheet writes them down for."""

import dataclasses
import math

import pytest

from fdbench.diagnosis.model.axis_parameters import Mass, Viscous
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.plants._controllers import Cascade
from fdbench.plants.feed_drive import FeedDrive, LinearMotor, Screw, Table


def rigid(motor_kg: float, table_kg: float, motor_N_s_per_m: float, table_N_s_per_m: float) -> Nominal:
    plant = FeedDrive(
        motor=LinearMotor(mass_kg=motor_kg, viscous_friction_N_s_per_m=motor_N_s_per_m),
        table=Table(mass_kg=table_kg, viscous_friction_N_s_per_m=table_N_s_per_m),
        controller=Cascade(
            position_gain_per_s=60.0,
            velocity_gain_N_s_per_m=5e3,
            integral_gain_N_per_m=1e5,
            velocity_feedforward=1.0,
            acceleration_feedforward_kg=0.0,
            force_limit_N=1000.0,
            feedback="motor",
            difference_span=1,
        ),
        travel_m=1.0,
        velocity_limit_m_per_s=1.0,
    )
    return Nominal(plant=plant, simulation=Simulation(substeps=4))


@pytest.mark.parametrize("sides", [(34.0, 1.0, 0.0, 80.0), (1.0, 34.0, 80.0, 0.0)])
def test_the_sum_moves_wherever_it_is_written(sides: tuple[float, float, float, float]) -> None:
    nominal = rigid(*sides)
    (mass,), (viscous,) = Mass.of(nominal), Viscous.of(nominal)
    heavier, lighter = mass.apply(nominal.drive, 2.0)[0], mass.apply(nominal.drive, -4.0)[0]
    assert heavier.mass_kg == pytest.approx(35.0 * (1.0 + 2.0 * nominal.uncertainty.mass))
    assert lighter.mass_kg == pytest.approx(35.0 * (1.0 - 4.0 * nominal.uncertainty.mass))
    half = viscous.apply(nominal.drive, 0.5 * viscous.room[0])[0]
    assert half.viscous_friction_N_s_per_m == pytest.approx(40.0)
    assert mass.size(nominal.drive) == pytest.approx(35.0 * nominal.uncertainty.mass)


def test_a_rigid_axis_without_a_table_has_those_of_its_motor() -> None:
    whole = rigid(34.0, 1.0, 80.0, 0.0)
    nominal = dataclasses.replace(whole, plant=dataclasses.replace(whole.drive, table=None))
    assert [item.name for item in (*Mass.of(nominal), *Viscous.of(nominal))] == ["motor_mass", "motor_viscous"]


def test_viscous_friction_is_as_much_in_doubt_with_a_screw_as_without() -> None:
    """It may be on either side, and what is on paper is off by one share in all."""
    nominal = rigid(20.0, 15.0, 50.0, 30.0)
    screw = Screw(stiffness_N_per_m=1e8, damping_N_s_per_m=1e3)
    elastic = dataclasses.replace(nominal, plant=dataclasses.replace(nominal.drive, screw=screw))
    (whole,), (motor, table) = Viscous.of(nominal), Viscous.of(elastic)
    assert whole.deviation == pytest.approx(80.0 * nominal.uncertainty.viscous)
    assert motor.deviation == table.deviation
    assert math.hypot(motor.deviation, table.deviation) == pytest.approx(whole.deviation)
