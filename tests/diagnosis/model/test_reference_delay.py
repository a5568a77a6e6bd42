"""A reference of the velocity that is late by a part of a sampling time is a matter of the loop, and no cause."""

import dataclasses

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.nominal import Covered, Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.settings import MODEL
from fdbench.plants.feed_drive import Cascade, FeedDrive

HALF_S = 0.5 * axis_lab.PERIOD_S
LEAD_M, VELOCITY_GAIN, ACCELERATION = 0.01, 2e4, 2.0


def late(axis: FeedDrive, delay_s: float) -> FeedDrive:
    assert isinstance(axis.controller, Cascade)
    controller = dataclasses.replace(axis.controller, velocity_reference_delay_s=delay_s)
    return dataclasses.replace(axis, controller=controller)


def in_doubt() -> Nominal:
    uncertainty = Uncertainty(reference_delay=0.5)
    return Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10), uncertainty=uncertainty)


def delay(found: Hypothesis) -> float:
    """Return by how much the velocity's reference of a model is late, in sampling times."""
    controller = found.variant.plant.controller
    assert isinstance(controller, Cascade)
    return controller.velocity_reference_delay_s / axis_lab.PERIOD_S


def test_a_late_reference_asks_for_less_where_an_acceleration_begins() -> None:
    """By K_p a delta, before anything has moved."""
    motion, duration_s = axis_lab.protocol(1.0)["steps"]
    as_planned, as_late = (
        axis_lab.record(late(axis_lab.drive(), value), (), motion, duration_s, seed=1)["motor_torque_Nm"]
        for value in (0.0, HALF_S)
    )
    less_N = (as_planned - as_late) * 2.0 * np.pi / LEAD_M
    assert less_N[np.flatnonzero(less_N)[0]] == pytest.approx(VELOCITY_GAIN * HALF_S * ACCELERATION, rel=1e-9)


@pytest.mark.parametrize("delay_s", [HALF_S, -HALF_S])
def test_half_a_sampling_time_is_found_and_no_cause(delay_s: float) -> None:
    axis = late(axis_lab.as_built(2), delay_s)
    found = diagnose(in_doubt(), *axis_lab.repeated(axis))
    assert delay(found.final) == pytest.approx(delay_s / axis_lab.PERIOD_S, abs=0.1)
    assert [cause.effect for cause in found.answer.causes if cause.probability > 0.5] == []


def test_more_than_a_sampling_time_is_no_matter_of_the_loop() -> None:
    nominal = in_doubt()
    assert "reference_delay" not in [item.kind for item in nominal_parameters(nominal)], "no sampling time is known"
    nominal = nominal.beside(Covered(fastest_m_per_s=0.5, period_s=axis_lab.PERIOD_S))
    place = [item.kind for item in nominal_parameters(nominal)].index("reference_delay")
    for moved in (0.0, 1.5, -1.0):
        low, high = start(nominal).moved(moved * np.eye(len(nominal_parameters(nominal)))[place]).room()[place]
        assert (low, high) == (-MODEL.most_delay - moved, MODEL.most_delay - moved)


def test_no_slow_log_asks_for_more_than_a_model_may_have() -> None:
    slow = start(in_doubt().beside(Covered(fastest_m_per_s=0.5, period_s=1.0)))
    controller = slow.moved(np.full(len(slow.shifts), -1.0)).variant.plant.controller
    assert isinstance(controller, Cascade)
    assert controller.velocity_reference_delay_s == -0.1
