"""Beside records of before, causes are of what has changed since: all of that, however large, and nothing else."""

import dataclasses
import math

import numpy as np
import pytest
from axis_lab import PERIOD_S, as_built, drive, other_friction, protocol, record

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.quantity import Quantity
from fdbench.diagnosis.diagnose import calibrated_on, diagnose
from fdbench.diagnosis.evidence.baseline import Baseline
from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.evidence.sensor_artefacts import Artefact
from fdbench.diagnosis.model.nominal import Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.virtual_controller import prepared
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.diagnosis.search.set_anew import gains_set_anew
from fdbench.effects import Effect, effects
from fdbench.errors import UnstableLoop
from fdbench.plants._controllers import Cascade
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench.report.verdict_text import verdict

WAVE = effects.get("encoder_interpolation_error").typical()


def records(axis: FeedDrive, *extra: Effect, seed: int, factor: float = 1.0) -> list[Record]:
    return [
        record(axis, extra, motion, duration, seed + repeat)
        for motion, duration in protocol(factor).values()
        for repeat in range(2)
    ]


def answer_to(before: list[Record], now: list[Record]) -> Answer:
    return diagnose(Nominal(plant=drive(), simulation=Simulation(substeps=10)), now, baseline=before).answer


def named(answer: Answer) -> list[str]:
    return [cause.effect for cause in answer.causes if cause.probability > 0.5]


def test_a_load_of_a_hundred_deviations_is_named() -> None:
    axis = as_built(1)
    assert axis.table is not None
    loaded = dataclasses.replace(axis, table=dataclasses.replace(axis.table, mass_kg=axis.table.mass_kg + 40.0))
    answer = answer_to(records(axis, seed=100), records(loaded, seed=200))
    assert named(answer) == ["inertia_mismatch"]
    assert answer.causes[0].parameters["change"].value == pytest.approx(40.0, rel=0.05)


def test_a_weight_that_came_on_top_is_named() -> None:
    """Alone it is within what this model has in doubt."""
    axis = as_built(1)
    loaded = dataclasses.replace(
        axis, effects=(*axis.effects, effects.get("constant_force").typical(constant_force_N=10.0))
    )
    now = records(loaded, seed=200)
    uncertainty = Uncertainty(force_offset_N=4.0)
    nominal = Nominal(plant=drive(), simulation=Simulation(substeps=10), uncertainty=uncertainty)
    assert named(diagnose(nominal, now).answer) == []
    answer = diagnose(nominal, now, baseline=records(axis, seed=100)).answer
    assert named(answer) == ["constant_force"]
    assert answer.causes[0].parameters["change"].value == pytest.approx(10.0, rel=0.1)


@pytest.mark.parametrize(
    "change",
    [
        effects.get("quadratic_drag").typical(quadratic_drag_N_s2_per_m2=120.0),
        effects.get("viscous_friction").typical(viscous_friction_N_s_per_m=150.0),
    ],
)
def test_a_drag_of_air_and_another_grease_are_told_apart(change: Effect) -> None:
    """Either explains most of what the other does."""
    axis = as_built(2)
    answer = answer_to(records(axis, seed=100), records(axis, change, seed=200))
    assert named(answer) == [change.name]
    chances = answer.chances()
    assert sum(chances.get(name, 0.0) for name in ("quadratic_drag", "viscous_friction")) <= 1.0 + 1e-9


def test_another_grease_on_both_sides_of_the_screw_is_named() -> None:
    """Each side moves by far more deviations than of a data sheet, where no cause changes both so far."""
    axis = as_built(2)
    assert axis.table is not None
    greased = dataclasses.replace(
        axis,
        motor=dataclasses.replace(axis.motor, viscous_friction_N_s_per_m=900.0),
        table=dataclasses.replace(axis.table, viscous_friction_N_s_per_m=600.0),
    )
    answer = answer_to(records(axis, seed=100), records(greased, seed=200))
    assert named(answer) == ["viscous_friction"]
    assert answer.causes[0].parameters["change"].value == pytest.approx(900.0, rel=0.1)
    assert answer.parametric.values["viscous_friction"].value == pytest.approx(900.0, rel=0.1)


def test_what_a_form_leaves_of_the_baseline_differs_by_a_part_of_itself() -> None:
    """A twentieth of 10 N, beside a floor of 1 N now and in the baseline."""
    reference, left = np.zeros((8192, 3)), 10.0 * np.random.default_rng(0).standard_normal(8192)
    run = RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels={"motor_force_N": left}, lap=None)
    baseline = Baseline(runs=[run], residuals=[{"motor_force_N": left}])
    floor = baseline.noise({"motor_force_N": white(1.0, measured=True)}, [run])["motor_force_N"]
    assert floor.rms == pytest.approx(math.sqrt(2.0))
    assert floor.total**2 - floor.rms**2 == pytest.approx(0.25, rel=0.05)
    assumed = baseline.noise({"motor_force_N": white(1.0, measured=False)}, [run])["motor_force_N"]
    assert assumed.total == 1.0, "it is in what the model leaves already"


@pytest.mark.parametrize("change", [-0.1, 0.07])
def test_a_motor_constant_that_has_changed_is_named_once(change: float) -> None:
    """Both masses, both frictions and the screw seem to have changed by one share."""
    axis = as_built(2)
    now = effects.get("motor_constant").typical(relative_change=change)
    answer = answer_to(records(axis, seed=100), records(axis, now, seed=200))
    assert named(answer) == ["motor_constant"]
    found = answer.causes[0].parameters["relative_change"]
    assert found.value == pytest.approx(change, rel=0.15)


@pytest.mark.parametrize(
    ("gain", "factor", "friction", "causes"),
    [
        ("position_gain_per_s", 0.9, 1.0, []),
        ("velocity_gain_N_s_per_m", 1.2, 1.3, ["coulomb_friction"]),
        ("integral_gain_N_per_m", 2.0, 1.0, []),
    ],
)
def test_a_gain_that_was_set_anew_is_known_beside_causes(
    gain: str, factor: float, friction: float, causes: list[str]
) -> None:
    axis = as_built(2)
    changed = {gain: factor * getattr(axis.controller, gain)}
    tuned = dataclasses.replace(axis, controller=dataclasses.replace(axis.controller, **changed))
    answer = answer_to(records(axis, seed=100), records(other_friction(tuned, friction), seed=200))
    (found,) = answer.parametric.set_anew.items()
    assert found == (gain, Quantity(value=pytest.approx(factor - 1.0, rel=0.02), ci95=None, unit=""))
    assert named(answer) == causes
    assert answer.no_gap_probability > 0.9 or causes
    assert f"set anew since the baseline: {gain}" in " ".join(verdict(answer))


def test_a_gain_that_its_law_does_not_confirm_is_not_set_anew() -> None:
    """Beside a closed loop, gains may move for what has changed in the machine."""
    axis = as_built(2)
    nominal = Nominal(plant=drive(), simulation=Simulation(substeps=10))
    known, healthy = calibrated_on(nominal, records(axis, seed=100))
    ready = aligned(known, records(axis, seed=200), [], healthy)
    found = Calibrated.of(ready, narrow=True)
    names = [item.name for item in nominal_parameters(found.ready.nominal)]
    shifts = tuple(100.0 * (name == "position_gain_per_s") for name in names)
    moved = dataclasses.replace(found, hypothesis=dataclasses.replace(found.hypothesis, shifts=shifts))
    assert gains_set_anew(moved) == {}


def test_where_nothing_has_changed_nothing_is_named() -> None:
    axis = as_built(2)
    assert named(answer_to(records(axis, WAVE, seed=100), records(axis, WAVE, seed=200))) == []


def test_an_error_of_the_encoder_that_is_new_is_named() -> None:
    axis = as_built(2)
    assert named(answer_to(records(axis, seed=100), records(axis, WAVE, seed=200))) == [WAVE.name]


def test_motions_that_were_not_recorded_before_are_said() -> None:
    axis = as_built(3)
    answer = answer_to(records(axis, seed=100), records(axis, seed=200, factor=1.3))
    assert named(answer) == []
    new = [warning for warning in answer.warnings if "no baseline record has its command" in warning]
    assert len(new) == 4
    assert not set(new) & set(answer.assumptions)
    assert next(verdict(answer)).startswith("Read the warnings under Doubts first")


def test_one_motion_that_is_new_is_no_fault_of_the_records() -> None:
    """It is said how it is compared, and nobody has to read that before the verdict."""
    axis = as_built(3)
    every = records(axis, seed=200)
    answer = answer_to(records(axis, seed=100), [*every[:-1], *records(axis, seed=300, factor=1.3)[-1:]])
    (new,) = (warning for warning in answer.warnings if "no baseline record has its command" in warning)
    assert new in answer.assumptions
    assert not next(verdict(answer)).startswith("Read the warnings under Doubts first")


@pytest.mark.parametrize(("low", "probability"), [(1.9e-8, 0.0), (2.1e-8, 0.8)])
def test_what_readings_showed_before_is_a_cause_only_where_it_grew(low: float, probability: float) -> None:
    before = artefact(1e-8, 2e-8)
    now = dataclasses.replace(artefact(low, 3e-8), probability=0.8)
    assert Baseline(runs=(), residuals=(), artefacts=[before]).since(now).probability == probability
    assert Baseline(runs=(), residuals=()).since(now).probability == 0.8


def artefact(low: float, high: float) -> Artefact:
    return Artefact(kind=type(WAVE), probability=0.1, value=0.5 * (low + high), low=low, high=high, energy={})


def test_a_loop_that_records_are_fitted_by_may_be_at_the_edge_of_its_stability() -> None:
    stable = drive()
    assert isinstance(stable.controller, Cascade)
    loud = dataclasses.replace(stable.controller, velocity_gain_N_s_per_m=1e6)
    nominal = Nominal(plant=dataclasses.replace(stable, controller=loud), simulation=Simulation(substeps=10))
    given = records(as_built(1), seed=100)
    with pytest.raises(UnstableLoop):
        prepared(nominal, given)
    assert prepared(nominal, given, on_paper=False)[0] == nominal
