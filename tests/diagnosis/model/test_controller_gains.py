"""Gains of a controller that are a little off are calibrated, and no cause."""

import dataclasses
from collections.abc import Mapping

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.loop_parameters import GAINS, ControllerGain
from fdbench.diagnosis.model.nominal import Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import effects
from fdbench.plants.feed_drive import FeedDrive, OpenLoop

OFF = {
    "position_gain_per_s": -0.02,
    "velocity_gain_N_s_per_m": 0.03,
    "integral_gain_N_per_m": -0.03,
    "velocity_feedforward": 0.03,
}


def nominal(**uncertainty: float) -> Nominal:
    return Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10), uncertainty=Uncertainty(**uncertainty))


def with_gains(axis: FeedDrive, off: Mapping[str, float]) -> FeedDrive:
    gains = {name: getattr(axis.controller, name) * (1.0 + share) for name, share in off.items()}
    return dataclasses.replace(axis, controller=dataclasses.replace(axis.controller, **gains))  # type: ignore[type-var]


def test_gains_that_are_off_are_found_and_no_cause() -> None:
    axis = with_gains(axis_lab.as_built(2), OFF)
    found = diagnose(nominal(), *axis_lab.repeated(axis))
    built, paper = found.final.variant.plant.controller, axis_lab.drive().controller
    for name, share in OFF.items():
        assert getattr(built, name) / getattr(paper, name) - 1.0 == pytest.approx(share, abs=0.005), name
    assert [cause.effect for cause in found.answer.causes if cause.probability > 0.5] == []
    assert found.answer.no_gap_probability > 0.5 > found.answer.unknown_probability


@pytest.mark.parametrize("name", [None, "backlash"])
def test_feedforward_that_is_far_off_is_unknown_and_what_is_beside_it_is_named(name: str | None) -> None:
    extra = () if name is None else (effects.get(name).typical(),)
    axis = with_gains(axis_lab.as_built(3), {"velocity_feedforward": -0.15})
    found = diagnose(nominal(), *axis_lab.repeated(axis, *extra))
    assert found.final.variant.plant.controller.rows()["VELOCITY_FEEDFORWARD"] == pytest.approx(0.85, abs=0.005)
    assert [cause.effect for cause in found.answer.causes if cause.probability > 0.5] == [item.name for item in extra]
    assert found.answer.unknown_probability > 0.9


def test_what_is_known_exactly_or_is_zero_is_not_moved() -> None:
    def gains(model: Nominal) -> list[str]:
        return [item.name for item in nominal_parameters(model) if isinstance(item, ControllerGain)]

    assert gains(nominal()) == list(OFF)
    assert gains(nominal(controller_gains=0.0)) == []
    with_all = dataclasses.replace(axis_lab.drive().controller, acceleration_feedforward_kg=100.0)  # type: ignore[type-var]
    assert gains(
        dataclasses.replace(nominal(), plant=dataclasses.replace(axis_lab.drive(), controller=with_all))
    ) == list(GAINS)
    without = with_gains(axis_lab.drive(), {"integral_gain_N_per_m": -1.0, "velocity_feedforward": -1.0})
    assert gains(dataclasses.replace(nominal(), plant=without)) == list(OFF)[:2]
    open_loop = dataclasses.replace(
        axis_lab.drive(), controller=OpenLoop(acceleration_feedforward_kg=1.0, force_limit_N=1e3)
    )
    assert gains(dataclasses.replace(nominal(), plant=open_loop)) == []


def test_no_gain_turns_its_sign_and_none_is_higher_than_a_model_may_have() -> None:
    far = start(nominal())
    moves = np.array([isinstance(item, ControllerGain) for item in nominal_parameters(nominal())])
    low, high = (far.moved(shift * moves).variant.plant.controller for shift in (-1e6, 1e6))
    for name in OFF:
        smallest = MODEL.smallest_ratio * getattr(axis_lab.drive().controller, name)
        assert getattr(low, name) == pytest.approx(smallest, rel=1e-12)
    assert high.rows()["VELOCITY_FEEDFORWARD"] == 2.0


@pytest.mark.parametrize("share", [0.02, 2.0])
def test_a_mass_fed_forward_is_in_doubt_by_a_part_of_what_is_moved(share: float) -> None:
    """Of one that is 2 % of the moved mass, another 2 % of that mass is no more than one deviation."""
    mass_kg = axis_lab.drive().mass_kg
    fed = dataclasses.replace(axis_lab.drive().controller, acceleration_feedforward_kg=share * mass_kg)  # type: ignore[type-var]
    model = dataclasses.replace(nominal(), plant=dataclasses.replace(axis_lab.drive(), controller=fed))
    (gain,) = (item for item in nominal_parameters(model) if item.name == "acceleration_feedforward_kg")
    doubt_kg = model.uncertainty.controller_gains * max(share, 1.0) * mass_kg
    assert gain.deviation * share * mass_kg == pytest.approx(doubt_kg, rel=1e-12)
