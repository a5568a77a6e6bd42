"""A known friction that sticks is no cause; one whose bristles are seen to bend is."""

import dataclasses
from collections.abc import Callable

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.effects import Effect, effects
from fdbench.plants._controllers import Cascade, Following
from fdbench.plants.feed_drive import FeedDrive, LinearMotor
from fdbench.record import Record

COULOMB, LUGRE = effects.get("coulomb_friction"), effects.get("lugre_friction")


def stage(mass_kg: float, friction: Effect) -> FeedDrive:
    """Return a light stage that an integral part moves on only once its friction is overcome."""
    return FeedDrive(
        motor=LinearMotor(mass_kg=mass_kg, viscous_friction_N_s_per_m=20.0),
        controller=Cascade(
            position_gain_per_s=60.0,
            velocity_gain_N_s_per_m=2e3,
            integral_gain_N_per_m=6e4,
            velocity_feedforward=1.0,
            acceleration_feedforward_kg=0.0,
            force_limit_N=1000.0,
            feedback="motor",
            difference_span=1,
        ),
        travel_m=1.0,
        velocity_limit_m_per_s=3.0,
        effects=(friction,),
    )


def bristles(force_N: float, bend_m: float) -> Effect:
    """Return bristles that bend over a way."""
    stiffness = force_N / bend_m
    return LUGRE.typical(
        coulomb_force_N=force_N,
        static_force_N=force_N,
        bristle_stiffness_N_per_m=stiffness,
        bristle_damping_N_s_per_m=5e-4 * stiffness,
    )


def nominal() -> Nominal:
    """Return the stage on paper, with Coulomb friction."""
    return Nominal(plant=stage(20.0, COULOMB.typical(coulomb_force_N=20.0)), simulation=Simulation(substeps=10))


def recorded(friction: Callable[[], Effect], *extra: Effect) -> list[list[Record]]:
    """Return two repeats of each motion, and one of each held-out one, each with a friction of its own."""
    return [
        [
            axis_lab.record(stage(20.4, friction()), extra, *motion, seed=int(10 * factor) + repeat)
            for motion in axis_lab.protocol(factor).values()
            for repeat in range(repeats)
        ]
        for factor, repeats in ((1.0, 2), (1.3, 1))
    ]


@pytest.mark.parametrize(("bend_m", "sticks"), [(2e-8, True), (5e-6, False)])
def test_bristles_that_are_not_seen_to_bend_are_no_cause(bend_m: float, sticks: bool) -> None:
    diagnosis = diagnose(nominal(), *recorded(lambda: bristles(19.0, bend_m)))
    answer, known = diagnosis.answer, diagnosis.final.nominal.drive.effects[0]
    assert any("seems to stick at rest" in text for text in answer.assumptions) is sticks
    assert (answer.chances().get("lugre_friction", 0.0) > 0.9) is not sticks
    assert isinstance(known, LUGRE) is sticks
    forces = [getattr(known, name) for name in (type(known).amplitude, *type(known).further_amplitudes)]
    assert set(forces) == {20.0}


def test_beside_another_cause_and_without_a_controller_what_sticks_is_none() -> None:
    cogging, random = effects.get("cogging").typical(cogging_force_N=8.0, pitch_m=0.016), np.random.default_rng(0)
    groups = recorded(lambda: bristles(19.0 * (1.0 + 0.03 * random.standard_normal()), 2e-8), cogging)
    model = nominal()
    follows = dataclasses.replace(model, plant=dataclasses.replace(model.drive, controller=Following()))
    answer = diagnose(follows, *groups).answer
    assert any("seems to stick at rest" in text for text in answer.assumptions)
    assert [cause.effect for cause in answer.causes if cause.probability > 0.5] == ["cogging"]


def test_on_a_baseline_what_sticks_is_known_too() -> None:
    """With a friction that creeps at rest, what the model leaves of the baseline hides what has changed since."""
    random = np.random.default_rng(0)

    def friction() -> Effect:
        return bristles(19.0 * (1.0 + 0.03 * random.standard_normal()), 2e-8)

    before, _ = recorded(friction)
    now = recorded(friction, effects.get("motor_constant").typical(relative_change=-0.15))
    answer = diagnose(nominal(), *now, baseline=before).answer
    assert any("seems to stick at rest" in text for text in answer.assumptions)
    assert [cause.effect for cause in answer.causes if cause.probability > 0.5] == ["motor_constant"]
    assert answer.causes[0].parameters["relative_change"].value == pytest.approx(-0.15, rel=0.15)
