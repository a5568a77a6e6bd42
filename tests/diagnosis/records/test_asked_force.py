"""What a controller asks for on its own readings tells a force of another unit, whatever the machine is like."""

import dataclasses

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.records.asked_force import ForceScales, asked_force, force_scale
from fdbench.diagnosis.records.runs import RecordedRun, prepare
from fdbench.plants.feed_drive import Cascade, FeedDrive, Following


def runs(drive: FeedDrive, scale: float = 1.0) -> list[RecordedRun]:
    found = []
    for seed, name in enumerate(("fast", "steps")):
        motion, duration_s = axis_lab.protocol(1.0)[name]
        run = prepare(axis_lab.record(drive, (), motion, duration_s, seed), drive)
        channels = {**run.channels, "motor_force_N": scale * run.channels["motor_force_N"]}
        found.append(dataclasses.replace(run, channels=channels))
    return found


def test_the_force_of_a_controller_is_what_it_asks_for_whatever_the_machine_is() -> None:
    drive = axis_lab.drive()
    assert drive.table is not None
    heavier = dataclasses.replace(drive, table=dataclasses.replace(drive.table, mass_kg=90.0))
    for machine in (drive, heavier):
        scales = [force_scale(run, drive.controller) for run in runs(machine)]
        assert scales == pytest.approx([1.0, 1.0], abs=0.02)
    assert ForceScales.of(runs(heavier), drive).warnings() == []
    assert ForceScales.of(runs(heavier), drive).tell_the_unit


def test_friction_that_is_doubled_is_no_wrong_unit_where_the_controller_tells_the_force() -> None:
    drive = axis_lab.drive()
    (motion, duration_s) = axis_lab.protocol(1.0)["steps"]
    record = axis_lab.record(axis_lab.other_friction(drive, 3.0), (), motion, duration_s, 1)
    known = Nominal(plant=drive, simulation=Simulation(substeps=10))
    without = dataclasses.replace(known, plant=dataclasses.replace(drive, controller=Following()))
    said = [[line for line in aligned(model, [record], []).warnings if "gain" in line] for model in (known, without)]
    assert said[0] == []
    assert "Probably its gain" in said[1][0]


@pytest.mark.parametrize("scale", [1.2, 0.8, 2.0**0.5])
def test_a_force_of_another_unit_is_told_by_its_factor(scale: float) -> None:
    drive = axis_lab.drive()
    (said,) = ForceScales.of(runs(drive, scale), drive).warnings()
    told = float(said.split("motor_force_N is ")[1].split(" times")[0])
    assert told == pytest.approx(scale, rel=0.02)
    assert not ForceScales.of(runs(drive, scale), drive).tell_the_unit
    assert float(said.split("gain = ")[1].split(" in")[0]) == pytest.approx(1.0 / scale, rel=0.02)


def test_one_record_of_another_scale_is_no_unit_and_without_a_controller_nothing_is_asked() -> None:
    drive = axis_lab.drive()
    (fast, _), (_, slow) = runs(drive, 1.2), runs(drive)
    assert ForceScales.of([fast, slow], drive).warnings() == []
    assert not ForceScales.of([fast, slow], drive).tell_the_unit
    assert ForceScales.of(runs(drive, 1.2), dataclasses.replace(drive, controller=Following())).warnings() == []


def test_a_fast_loop_in_a_slow_log_asks_by_the_speed_of_its_own_cycle() -> None:
    drive = axis_lab.drive()
    (run, _) = runs(drive)
    assert isinstance(drive.controller, Cascade)
    stiff = dataclasses.replace(drive.controller, velocity_gain_N_s_per_m=1e5)
    time_s = np.arange(4000) * run.period_s
    for loops in (1, 4):
        # What moves smoothly has, a part of a sample before, the speed of then.
        earlier_s = time_s - 0.5 * run.period_s / loops
        channels = {"position_m": np.sin(time_s), "motor_force_N": -1e5 * np.cos(earlier_s)}
        reference = np.zeros((len(time_s), 3))
        smooth = dataclasses.replace(run, channels=channels, reference=reference)
        only = dataclasses.replace(stiff, position_gain_per_s=0.0, integral_gain_N_per_m=0.0)
        asked = asked_force(smooth, only, loops)
        assert asked is not None
        assert asked[1:-1] == pytest.approx(channels["motor_force_N"][1:-1], abs=1.0)
