"""Repeats are recognised by what was commanded: a motion, or in open loop a force."""

from collections.abc import Sequence

import axis_lab
import numpy as np
import pytest
from open_loop import NOMINAL, STAIRS, recorded

from fdbench.diagnosis.evidence.baseline import Baseline
from fdbench.diagnosis.evidence.prepare import split_runs
from fdbench.diagnosis.model.virtual_controller import prepared
from fdbench.diagnosis.records.noise_model import noise_models
from fdbench.diagnosis.records.runs import RecordedRun, merged, prepare, repeated, same_command, same_force, same_motion
from fdbench.record import Record


def runs_of(records: Sequence[Record]) -> list[RecordedRun]:
    return prepared(NOMINAL, records)[1]


def test_runs_under_the_same_force_are_repeats_though_they_move_apart() -> None:
    runs = runs_of([recorded(STAIRS, friction, seed) for seed, friction in enumerate((30.0, 33.0, 36.0))])
    assert not same_motion(*runs[:2])
    assert same_command(*runs[:2])
    assert same_command(*(run.after(100).up_to(700) for run in runs[:2]))
    assert len(repeated(runs)) == 2
    assert all(floor.measured for floor in noise_models([run.beside(run.channels) for run in runs]).values())


def test_of_repeats_that_move_apart_the_last_is_judged_on_and_none_are_averaged() -> None:
    runs = runs_of([recorded(STAIRS, friction, seed) for seed, friction in enumerate((30.0, 33.0, 36.0))])
    assert len(merged(runs)) == 3
    split, judged_on = split_runs(runs, [], noise_models(runs))
    assert judged_on == "held-out repeats"
    assert [bool(mask.all()) for mask in split.held_out] == [False, False, True]


def test_a_baseline_that_moved_apart_is_none() -> None:
    """What the model left at some time of a motion is nothing that it leaves at this time of another one."""
    before, now = runs_of([recorded(STAIRS, friction, seed) for seed, friction in enumerate((30.0, 36.0))])
    baseline = Baseline(runs=[before], residuals=[before.channels])
    assert baseline.of(before) is not None
    assert baseline.of(now) is None


def test_repeats_that_move_alike_are_averaged() -> None:
    (run,) = merged(runs_of([recorded(STAIRS, 30.0, seed) for seed in range(2)]))
    assert run.repeats == 2


@pytest.mark.parametrize("other", [1.001 * STAIRS, np.roll(STAIRS, 1), np.repeat(STAIRS[:4], 500)])
def test_another_force_is_no_repeat(other: np.ndarray) -> None:
    runs = runs_of([recorded(STAIRS, 30.0, 0), recorded(other, 36.0, 1)])
    assert not same_command(*runs)


def test_a_force_that_never_changes_tells_nothing() -> None:
    steady = runs_of([recorded(STAIRS, 30.0, 0), *(recorded(np.full(2000, 20.0), own, 1) for own in (10.0, 30.0))])
    assert not same_force(*steady[1:])


def test_a_commanded_motion_tells_repeats_by_itself() -> None:
    commands = 0.1 * np.sin(np.arange(2000) / 200.0), 0.1 * np.sin(np.arange(2000) / 300.0)
    runs = runs_of([recorded(STAIRS, 30.0, seed, reference_position_m=own) for seed, own in enumerate(commands)])
    assert not same_command(*runs)


def test_rows_that_are_repeated_as_a_whole_have_no_command_of_their_own() -> None:
    motion, duration_s = axis_lab.protocol(1.0)["fast"]
    record = axis_lab.record(axis_lab.drive(), (), motion, duration_s, 1)
    whole = prepare(record, axis_lab.drive())
    rng, n = np.random.default_rng(0), record.n_samples
    stale = rng.random(n) < 0.03
    stale[0] = False
    rows = np.maximum.accumulate(np.where(stale, 0, np.arange(n)))
    repeated = Record({**{name: values[rows] for name, values in record.items()}, "time_s": record["time_s"]}, {}, "x")
    run = prepare(repeated, axis_lab.drive())
    moves = whole.moves
    as_logged = np.abs(repeated["reference_position_m"] - record["reference_position_m"])[moves].max()
    mended = np.abs(run.reference[:, 0] - whole.reference[:, 0])[moves].max()
    assert mended < 0.05 * as_logged
    assert run.held is not None
    assert run.held[stale & moves].all()


def test_a_coarse_command_is_left_as_it_is() -> None:
    motion, duration_s = axis_lab.protocol(1.0)["steps"]
    record = axis_lab.record(axis_lab.drive(), (), motion, duration_s, 1)
    coarse = 1e-5 * np.round(record["reference_position_m"] / 1e-5)
    columns = {name: np.zeros(record.n_samples) for name in record if name != "time_s"}
    still = Record({**columns, "time_s": record["time_s"], "reference_position_m": coarse}, {}, "x")
    assert np.array_equal(prepare(still, axis_lab.drive()).reference[:, 0], coarse)
