"""Stribeck friction of bristles that a model knows is a part of them: they hold the static force, too."""

import dataclasses

import axis_lab
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.as_nominal import as_nominal
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.effects import effects

LUGRE = effects.get("lugre_friction").typical(coulomb_force_N=120.0, static_force_N=120.0)
STRIBECK = effects.get("stribeck_friction").typical(stribeck_force_N=60.0, stribeck_velocity_m_per_s=6e-3)
PAPER = dataclasses.replace(axis_lab.drive(), effects=(LUGRE,))


def test_they_are_one_friction_in_what_is_simulated_and_written() -> None:
    model = start(Nominal(plant=PAPER, simulation=Simulation(substeps=10)))
    with_stribeck = model.with_effect(STRIBECK)
    whole = LUGRE.changed(static_force_N=180.0, stribeck_velocity_m_per_s=6e-3)
    assert with_stribeck.variant.extra == ()
    assert with_stribeck.variant.plant.effects == (whole,)
    assert as_nominal(with_stribeck).drive.effects == (whole,)
    assert model.with_effect(STRIBECK.changed(stribeck_force_N=0.0)).variant.plant.effects == (LUGRE,)


def test_speeds_are_those_of_both_parts() -> None:
    own = LUGRE.changed(static_force_N=140.0, stribeck_velocity_m_per_s=2e-3)
    whole = STRIBECK.joined_to(own)
    assert whole is not None
    assert whole.static_force_N == pytest.approx(200.0)
    assert whole.stribeck_velocity_m_per_s == pytest.approx((20.0 * 2e-3 + 60.0 * 6e-3) / 80.0)
    assert STRIBECK.joined_to(effects.get("coulomb_friction").typical()) is None


def test_it_is_named_beside_bristles_that_are_known() -> None:
    built = dataclasses.replace(PAPER, effects=(LUGRE.changed(static_force_N=180.0, stribeck_velocity_m_per_s=6e-3),))
    records = [
        axis_lab.record(built, (), motion, duration_s, seed)  # type: ignore[arg-type]
        for seed in (1, 2)
        for motion, duration_s in axis_lab.protocol(1.0).values()
    ]
    held_out = [axis_lab.record(built, (), *item, 3) for item in axis_lab.protocol(1.3).values()]  # type: ignore[arg-type]
    answer = diagnose(Nominal(plant=PAPER, simulation=Simulation(substeps=10)), records, held_out).answer
    assert answer.causes[0].effect == "stribeck_friction"
    assert answer.causes[0].probability > 0.5
    assert answer.causes[0].parameters["stribeck_force_N"].value == pytest.approx(60.0, rel=0.2)
