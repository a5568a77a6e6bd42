"""Where a controller is at its limit nothing is evidence: what its integral does there no data sheet tells."""

import dataclasses

import axis_lab
import numpy as np
import pytest
from search_lab import NOMINAL, search

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.evidence.at_limit import at_limit, told_at_limits, without_limited_controller
from fdbench.diagnosis.evidence.evidence import Evidence, gather
from fdbench.diagnosis.evidence.segment_products import segment_length
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.virtual_controller import prepared
from fdbench.diagnosis.records.runs import FORCE, POSITION, RecordedRun
from fdbench.diagnosis.repaired import model_text, repaired
from fdbench.effects import effects
from fdbench.plants._controllers import Cascade, OpenLoop
from fdbench.plants.feed_drive import FeedDrive, Following
from fdbench.record import Record


def limited(force_limit_N: float) -> FeedDrive:
    """Return the axis with another limit of its force."""
    drive = NOMINAL.drive
    assert isinstance(drive.controller, Cascade)
    return dataclasses.replace(drive, controller=dataclasses.replace(drive.controller, force_limit_N=force_limit_N))


def wound_up(drive: FeedDrive) -> tuple[list[RecordedRun], Evidence]:
    """Return runs of which one is elsewhere, by far, in the segment of its greatest force, and the evidence of both."""
    nominal = Nominal(plant=drive, simulation=NOMINAL.simulation)
    own = search(nominal=nominal)
    runs = list(own.split.runs)
    first, length = runs[0], segment_length(runs[0])
    place = int(np.abs(first.channels[FORCE]).argmax()) // length
    moved = first.channels[POSITION].copy()
    moved[place * length : (place + 1) * length] += 1e-3
    runs[0] = dataclasses.replace(first, channels={**first.channels, POSITION: moved})
    split = dataclasses.replace(own.split, runs=runs)
    return runs, gather(own.readings, split, start(nominal), ())


def greatest_force() -> float:
    return float(np.abs(search().split.runs[0].channels[FORCE]).max())


def test_it_is_the_segment_of_the_limit_and_the_one_after() -> None:
    run, limit = search().split.runs[0], greatest_force()
    length, n_segments = segment_length(run), -(-run.n_samples // segment_length(run))
    expected = np.zeros(n_segments, dtype=np.bool_)
    for place in np.flatnonzero(np.abs(run.channels[FORCE]) > 0.98 * limit) // length:
        expected[place : place + 2] = True
    assert 0 < expected.sum() < n_segments
    np.testing.assert_array_equal(at_limit(run, limited(limit)), expected)
    assert not at_limit(run, limited(1.1 * limit)).any()


def test_the_part_that_is_no_evidence_is_told() -> None:
    runs, limit = search().split.runs, greatest_force()
    (text,) = told_at_limits(runs, limited(limit))
    assert text.startswith("x")
    assert f"{100.0 * at_limit(runs[0], limited(limit)).mean():.0f} % of the time" in text
    assert told_at_limits(runs, limited(1.1 * limit)) == []
    assert told_at_limits(runs, limited(1e-3)) == []


def test_a_force_that_is_commanded_is_at_no_limit() -> None:
    run, drive = search().split.runs[0], limited(greatest_force())
    given = dataclasses.replace(run, given_force=run.channels[FORCE])
    assert not at_limit(given, drive).any()
    free = OpenLoop(acceleration_feedforward_kg=0.0, force_limit_N=1.0)
    assert not at_limit(run, dataclasses.replace(drive, controller=free)).any()


def test_what_a_loop_does_at_its_limit_is_no_evidence() -> None:
    limit = greatest_force()
    runs, told = wound_up(limited(1.1 * limit))
    _, untold = wound_up(limited(1.01 * limit))
    assert told.worst() > 1e4
    assert untold.worst() < 3.0
    assert untold.misfits(held_out=False)[0] == pytest.approx(1.0, abs=0.1)
    own = at_limit(runs[0], limited(1.01 * limit))
    np.testing.assert_array_equal(untold.weights[(untold.run == 0) & (untold.channel == 0)] == 0.0, own)


def test_a_loop_that_is_at_its_limit_all_the_time_is_judged_there() -> None:
    _, found = wound_up(limited(1e-3))
    assert (found.weights > 0.0).all()


def limited_axis(share: float) -> tuple[Nominal, list[Record], list[Record]]:
    """Return records of an axis with cogging, and a model whose force limit is this share of their greatest force."""
    nominal, fitted, judged = axis_lab.case((effects.get("cogging").typical(cogging_force_N=30.0),), seed=1)
    drive, controller = nominal.drive, nominal.drive.controller
    assert isinstance(controller, Cascade)
    greatest_N = max(float(np.abs(drive.motor_force(record)).max()) for record in (*fitted, *judged))
    controller = dataclasses.replace(controller, force_limit_N=share * greatest_N)
    return dataclasses.replace(nominal, plant=dataclasses.replace(drive, controller=controller)), fitted, judged


def test_a_controller_that_is_at_its_limit_for_long_is_left_out() -> None:
    nominal, fitted, judged = limited_axis(0.9)
    left_out, (text,) = without_limited_controller(nominal, [*fitted, *judged])
    assert isinstance(left_out.drive.controller, Following)
    assert "left out" in text
    found = diagnose(nominal, fitted, judged)
    answer = found.answer
    assert answer.warnings[0] == text
    assert repaired(found).drive.controller == nominal.drive.controller
    assert "was not judged" in model_text(found)
    assert answer.causes[0].effect == "cogging"
    assert answer.causes[0].probability > 0.9


@pytest.mark.parametrize("share", [1.1, 0.4])
def test_a_controller_stays_where_no_force_is_at_its_limit_or_one_is_far_beyond(share: float) -> None:
    nominal, fitted, judged = limited_axis(share)
    assert without_limited_controller(nominal, [*fitted, *judged]) == (nominal, [])
    assert without_limited_controller(nominal, []) == (nominal, [])


def test_its_side_of_the_screw_stays_known() -> None:
    nominal, fitted, judged = limited_axis(0.9)
    controller = nominal.drive.controller
    assert isinstance(controller, Cascade)
    unsaid = [
        Record(
            {"position_m": record["motor_position_m"]}
            | {name: record[name] for name in record if name not in ("motor_position_m", "table_position_m")},
            source=record.source,
        )
        for record in (*fitted, *judged)
    ]
    left_out, _ = without_limited_controller(nominal, unsaid)
    assert left_out.drive.controller == Following(feedback=controller.feedback)
    followed, _, _ = prepared(left_out, unsaid)
    assert isinstance(followed.drive.controller, Following)
    assert followed.drive.controller.uses_table == controller.uses_table


def test_a_loop_that_swings_between_its_limits_is_told_to_be_unstable() -> None:
    """At 25 Hz, for all of the time; a force that is at one limit for long, as in a stroke, does not swing."""
    t = np.arange(2000) * 1e-3
    told = []
    for force in (np.clip(900.0 * np.sin(50.0 * np.pi * t), -500.0, 500.0), np.where(t < 1.0, 500.0, -500.0)):
        record = Record({"time_s": t, "motor_position_m": 0.1 * t, "table_position_m": 0.1 * t, "motor_force_N": force})
        model = Nominal(plant=limited(500.0), simulation=NOMINAL.simulation)
        told.append(without_limited_controller(model, [record])[1])
    assert ["swings" in text for (text,) in told] == [True, False]
