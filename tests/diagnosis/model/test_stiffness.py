"""A screw is as stiff as its data sheet says within a twentieth, and damped as none says: no cause, unless since."""

import dataclasses
import math

import axis_lab
import pytest

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.axis_parameters import Damping, Stiffness
from fdbench.diagnosis.model.nominal import Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.settings import MODEL
from fdbench.plants.feed_drive import FeedDrive

NOMINAL = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))


def softer(share: float) -> FeedDrive:
    axis = axis_lab.as_built(2)
    assert axis.screw is not None
    screw = dataclasses.replace(axis.screw, stiffness_N_per_m=(1.0 - share) * axis.screw.stiffness_N_per_m)
    return dataclasses.replace(axis, screw=screw)


def named(answer: Answer) -> list[str]:
    return [cause.effect for cause in answer.causes if cause.probability > 0.5]


@pytest.mark.parametrize(("share", "causes"), [(0.05, []), (0.2, ["axial_compliance"])])
def test_a_screw_within_its_data_sheet_is_no_cause_and_a_softer_one_is(share: float, causes: list[str]) -> None:
    assert named(diagnose(NOMINAL, *axis_lab.repeated(softer(share))).answer) == causes


def test_what_a_screw_has_lost_since_is_a_cause_however_little() -> None:
    before, _ = axis_lab.repeated(softer(0.0))
    now, _ = axis_lab.repeated(softer(0.05))
    assert named(diagnose(NOMINAL, now, baseline=before).answer) == ["axial_compliance"]


def test_it_is_bounded_and_belongs_to_a_screw() -> None:
    (own,) = (item for item in nominal_parameters(NOMINAL) if isinstance(item, Stiffness))
    assert own.room == (-MODEL.most_stiffness, MODEL.most_stiffness)
    screw = own.apply(NOMINAL.drive, -1.0)[0].screw
    assert screw is not None
    assert screw.stiffness_N_per_m == pytest.approx(0.95 * 6e7)
    assert own.text(NOMINAL.drive, -1.0) == "5.7e+07 N/m"
    known = dataclasses.replace(NOMINAL, uncertainty=Uncertainty(stiffness=0.0))
    stiff = dataclasses.replace(NOMINAL, plant=dataclasses.replace(axis_lab.drive(), screw=None))
    for model in (known, stiff):
        assert not [item for item in nominal_parameters(model) if isinstance(item, Stiffness)]


def test_its_damping_is_in_doubt_and_no_cause() -> None:
    (own,) = (item for item in nominal_parameters(NOMINAL) if isinstance(item, Damping))
    axis = axis_lab.as_built(2)
    assert axis.screw is not None
    before = axis.screw.damping_N_s_per_m
    moved = own.apply(axis, 2.0)[0].screw
    assert moved is not None
    assert moved.damping_N_s_per_m == pytest.approx(before * math.exp(0.6))
    assert "N s/m" in own.text(axis, 2.0)
    assert own.size(axis) == pytest.approx(0.3 * before)
    screw = dataclasses.replace(axis.screw, damping_N_s_per_m=0.6 * before)
    assert named(diagnose(NOMINAL, *axis_lab.repeated(dataclasses.replace(axis, screw=screw))).answer) == []
    undamped = dataclasses.replace(axis_lab.drive(), screw=dataclasses.replace(axis.screw, damping_N_s_per_m=0.0))
    assert Damping.of(dataclasses.replace(NOMINAL, plant=undamped)) == []
