"""Nominal values that deviate: how far off a kind of value is that a machine has on both sides of its screw."""

import dataclasses
import math

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.judge import probability_models
from fdbench.diagnosis.judge.nominal_values import Deviating, deviating_parameters, with_mass_of
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect, effects

PERIOD_S = 1e-3
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=10))


def deviating(*extra: Effect, **moved: float) -> Deviating:
    """Return what is said of a machine whose values are off by so many standard deviations, all of which was found."""
    found = start(NOMINAL).moved([moved.get(item.name, 0.0) for item in nominal_parameters(NOMINAL)])
    for effect in extra:
        found = found.with_effect(effect)
    noise_models = {"motor_force_N": white(0.1, measured=True), "position_m": white(1e-8, measured=True)}
    reference = moves((0.0, 0.06, 0.01), (0.08,), 2.0, PERIOD_S)
    still = dict.fromkeys(noise_models, np.zeros(len(reference)))
    run = RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=still, lap=None)
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    simulated = replay.simulate(run, [found.variant])
    run = dataclasses.replace(run, channels={name: simulated[name][0] for name in noise_models})
    held_out = [np.arange(run.n_samples) >= run.n_samples // 2]
    split = Split(runs=[run], held_out=held_out, noise_models=noise_models)
    search = Search(Refinement(Readings(replay, [run]), split))
    return deviating_parameters(search, found, 0.5, probability_models.models())


def test_a_load_on_the_table_is_not_measured_by_the_motor() -> None:
    """Seven deviations of the table's mass are fewer of both masses together, of which the motor's is known."""
    found = deviating(motor_mass=-0.5, table_mass=7.0)
    assert found.features["inertia_mismatch"]["distance"] == pytest.approx(math.log(7.0))
    (cause,) = found.causes
    sizes = {item.name: item.size(NOMINAL.drive) for item in nominal_parameters(NOMINAL)}
    change = 7.0 * sizes["table_mass"] - 0.5 * sizes["motor_mass"]
    assert cause.parameters["change"].value == pytest.approx(change)
    assert change / math.hypot(sizes["motor_mass"], sizes["table_mass"]) < 6.0


def test_a_mass_on_both_sides_is_further_off_than_on_either() -> None:
    sizes = [item.size(NOMINAL.drive) for item in nominal_parameters(NOMINAL) if item.kind == "mass"]
    together = 4.0 * sum(sizes) / math.hypot(*sizes)
    assert 4.0 < together < 4.0 * math.sqrt(2.0) + 1e-9
    found = deviating(motor_mass=4.0, table_mass=4.0)
    assert found.features["inertia_mismatch"]["distance"] == pytest.approx(math.log(together))


def test_what_a_mode_carries_was_in_the_mass_that_is_known() -> None:
    """A part of the axis on a spring of its own: slowly, the axis is as heavy as the data sheet says."""
    (size,) = (item.size(NOMINAL.drive) for item in nominal_parameters(NOMINAL) if item.name == "table_mass")
    mode = effects.get("structural_mode").typical(moving_mass_kg=9.0 * size)
    assert deviating(mode, table_mass=-9.5).causes == []
    for extra, shift in (((), -9.5), ((mode,), 9.5)):
        (cause,) = deviating(*extra, table_mass=shift).causes
        assert cause.effect == "inertia_mismatch"
        assert cause.parameters["change"].value == pytest.approx(shift * size)


def test_what_an_improbable_mode_carries_is_a_mass_that_is_off() -> None:
    """As it is without the mode; what else is off there may be a stand-in."""
    told, recalibrated = deviating(known_coulomb_friction=6.0), deviating(table_mass=7.0, table_viscous=9.0)
    assert {cause.effect for cause in recalibrated.causes} == {"inertia_mismatch", "viscous_friction"}
    found = with_mass_of(told, recalibrated, start(NOMINAL))
    assert [cause.effect for cause in found.causes] == [*(cause.effect for cause in told.causes), "inertia_mismatch"]
    assert found.features.keys() == {cause.effect for cause in found.causes}
    assert with_mass_of(found, recalibrated, start(NOMINAL)) == found


def test_friction_that_came_on_top_is_told_by_its_side() -> None:
    """Where the table has the friction that is known of it, the rest is the motor's; else the known one is wrong."""
    (size,) = (item for item in nominal_parameters(NOMINAL) if item.name == "known_coulomb_friction")
    (side,) = (item for item in nominal_parameters(NOMINAL) if item.name == "friction_side")
    growth = 1.0 + 20.0 * size.deviation
    (on_top,) = deviating(known_coulomb_friction=20.0, friction_side=(1.0 - 1.0 / growth) / side.deviation).causes
    assert on_top.effect == "motor_coulomb_friction"
    assert on_top.parameters["change"].value == pytest.approx(20.0 * size.size(NOMINAL.drive))
    assert (1.0 - 1.0 / growth) / side.deviation > JUDGE.beyond_doubt
    (grown,) = deviating(known_coulomb_friction=20.0, friction_side=0.0).causes
    assert grown.effect == "coulomb_friction"
    for cause, other in ((on_top, "coulomb_friction"), (grown, "motor_coulomb_friction")):
        assert cause.probability > 5.0 * cause.alternatives[other] > 0.0
    assert sum([on_top.probability, *on_top.alternatives.values()]) == pytest.approx(
        sum([grown.probability, *grown.alternatives.values()]), rel=0.05
    )
