"""A filter of the velocity that no data sheet tells of is calibrated, and one that smooths much is told of."""

import dataclasses
import math

import axis_lab
import pytest

from fdbench.diagnosis.diagnose import Diagnosis, diagnose
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.loop_parameters import VelocityFilter
from fdbench.diagnosis.model.nominal import Covered, Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.effects import Effect, effects
from fdbench.plants.feed_drive import Cascade, FeedDrive

COVERED = Covered(fastest_m_per_s=0.1, longest_s=5.0, force_N=100.0, period_s=1e-3)


def smoothed(axis: FeedDrive, filter_s: float) -> FeedDrive:
    assert isinstance(axis.controller, Cascade)
    return dataclasses.replace(axis, controller=dataclasses.replace(axis.controller, velocity_filter_s=filter_s))


def nominal(filter_s: float = 0.0, **uncertainty: float) -> Nominal:
    plant = smoothed(axis_lab.drive(), filter_s)
    return Nominal(plant=plant, simulation=Simulation(substeps=10), uncertainty=Uncertainty(**uncertainty))


def filters(model: Nominal) -> list[VelocityFilter]:
    return [item for item in nominal_parameters(model) if isinstance(item, VelocityFilter)]


def diagnosed(filter_s: float, *extra: Effect) -> Diagnosis:
    axis = smoothed(axis_lab.as_built(2), filter_s)
    return diagnose(nominal(), *axis_lab.repeated(axis, *extra))


def found_s(hypothesis: Hypothesis) -> float:
    controller = hypothesis.variant.plant.controller
    assert isinstance(controller, Cascade)
    return controller.velocity_filter_s


def test_a_filter_of_a_part_of_a_sampling_time_is_found_and_no_cause() -> None:
    found = diagnosed(0.15e-3)
    assert found_s(found.final) == pytest.approx(0.15e-3, rel=0.15)
    assert [cause.effect for cause in found.answer.causes if cause.probability > 0.5] == []
    assert found.answer.no_gap_probability > 0.5 > found.answer.unknown_probability


@pytest.mark.parametrize("name", [None, "inertia_mismatch"])
def test_a_filter_of_more_than_a_sampling_time_is_told_and_what_else_is_there_is_named(name: str | None) -> None:
    extra = () if name is None else (effects.get(name).typical(),)
    found = diagnosed(2e-3, *extra)
    answer = found.answer
    assert found_s(found.final) == pytest.approx(2e-3, rel=0.05)
    assert [cause.effect for cause in answer.causes if cause.probability > 0.5] == [item.name for item in extra]
    assert answer.no_gap_probability < 0.05
    assert answer.unknown_probability > 0.9
    assert [text for text in answer.warnings if text.startswith("velocity_filter seems to be 2")]


def test_a_filter_of_more_than_a_sampling_time_is_no_noise_where_friction_changes() -> None:
    """What is left without it is less than repeats differ by, and it is told all the same."""
    axis = smoothed(axis_lab.as_built(2), 1e-3)
    groups = [
        [
            axis_lab.record(axis_lab.other_friction(axis, change), (), *motion, seed=10 * place + repeat)
            for motion in axis_lab.protocol(factor).values()
            for repeat, change in enumerate((0.92, 1.08))
        ]
        for place, factor in enumerate((1.0, 1.3))
    ]
    found = diagnose(nominal(), *groups)
    assert all(own.recalibrated < 1.2 * own.noise_floor for own in found.answer.gap.channels.values())
    assert found.answer.unknown_probability > 0.5


def test_a_filter_is_never_negative() -> None:
    (own,) = filters(nominal().beside(COVERED))
    assert own.deviation == pytest.approx(0.1e-3)
    assert own.room == (0.0, math.inf)
    (own,) = filters(nominal(0.05e-3).beside(COVERED))
    assert own.room == pytest.approx((-0.5, math.inf))
    model = nominal(0.05e-3).beside(COVERED)
    lower = start(model).moved([-3.0 * (item.kind == own.kind) for item in nominal_parameters(model)])
    assert found_s(lower) == 0.0
    assert filters(nominal()) == [], "no sampling time is known"
    assert filters(nominal(velocity_filter=0.0).beside(COVERED)) == []
