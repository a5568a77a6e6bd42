"""Gains of a controller that are a little off are calibrated, and no cause."""

import dataclasses

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.loop_parameters import GAINS, ControllerGain
from fdbench.diagnosis.model.nominal import Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.settings import MODEL
from fdbench.plants.feed_drive import FeedDrive, OpenLoop

OFF = (-0.02, 0.03, -0.03)


def nominal(**uncertainty: float) -> Nominal:
    return Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10), uncertainty=Uncertainty(**uncertainty))


def with_gains(axis: FeedDrive, ratios: tuple[float, ...]) -> FeedDrive:
    gains = {name: getattr(axis.controller, name) * ratio for name, ratio in zip(GAINS, ratios, strict=True)}
    return dataclasses.replace(axis, controller=dataclasses.replace(axis.controller, **gains))  # type: ignore[type-var]


def test_gains_that_are_off_are_found_and_no_cause() -> None:
    axis = with_gains(axis_lab.as_built(2), tuple(1.0 + share for share in OFF))
    found = diagnose(nominal(), *axis_lab.repeated(axis))
    built, paper = found.final.variant.plant.controller, axis_lab.drive().controller
    for name, share in zip(GAINS, OFF, strict=True):
        assert getattr(built, name) / getattr(paper, name) - 1.0 == pytest.approx(share, abs=0.005), name
    assert [cause.effect for cause in found.answer.causes if cause.probability > 0.5] == []
    assert found.answer.no_gap_probability > 0.5 > found.answer.unknown_probability


def test_what_is_known_exactly_or_is_zero_is_not_moved() -> None:
    def gains(model: Nominal) -> list[str]:
        return [item.name for item in nominal_parameters(model) if isinstance(item, ControllerGain)]

    assert gains(nominal()) == list(GAINS)
    assert gains(nominal(controller_gains=0.0)) == []
    without = with_gains(axis_lab.drive(), (1.0, 1.0, 0.0))
    assert gains(dataclasses.replace(nominal(), plant=without)) == list(GAINS[:2])
    open_loop = dataclasses.replace(
        axis_lab.drive(), controller=OpenLoop(acceleration_feedforward_kg=1.0, force_limit_N=1e3)
    )
    assert gains(dataclasses.replace(nominal(), plant=open_loop)) == []


def test_no_gain_turns_its_sign() -> None:
    far = start(nominal())
    built = far.moved(np.full(len(far.shifts), -1e6)).variant.plant.controller
    for name in GAINS:
        smallest = MODEL.smallest_ratio * getattr(axis_lab.drive().controller, name)
        assert getattr(built, name) == pytest.approx(smallest, rel=1e-12)
