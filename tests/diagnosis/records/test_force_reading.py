"""A force that is written in few steps, or cut off, is told; one that is as it should be is not."""

import dataclasses

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.records.force_reading import limits_of_forces, step_of
from fdbench.diagnosis.records.runs import RecordedRun, prepare
from fdbench.plants.feed_drive import Following


def runs(n: int) -> list[RecordedRun]:
    motion, duration_s = axis_lab.protocol(1.0)["fast"]
    drive = axis_lab.drive()
    return [prepare(axis_lab.record(drive, (), motion, duration_s, seed), drive) for seed in range(n)]


def with_force(run: RecordedRun, force: np.ndarray) -> RecordedRun:
    return dataclasses.replace(run, channels={**run.channels, "motor_force_N": force})


def test_a_force_as_it_is_has_no_word() -> None:
    assert limits_of_forces(runs(2), axis_lab.drive()) == []


def test_steps_that_are_fine_enough_have_no_word() -> None:
    (run,) = runs(1)
    rounded = with_force(run, 20.0 * np.round(run.channels["motor_force_N"] / 20.0))
    assert limits_of_forces([rounded], axis_lab.drive()) == []


def test_coarse_steps_are_told_once() -> None:
    coarse = [with_force(run, 100.0 * np.round(run.channels["motor_force_N"] / 100.0)) for run in runs(2)]
    (said,) = limits_of_forces(coarse, axis_lab.drive())
    assert said.startswith("record 0 and 1 more: motor_force_N is written in steps of 100 N, ")


def in_open_loop(n: int, force: np.ndarray, given: bool = True) -> list[RecordedRun]:
    """Return runs without a commanded motion; a force that is not ``given`` differs by a step somewhere."""
    found = []
    for place, run in enumerate(runs(n)):
        own = np.resize(force, run.n_samples)
        own[500] += 0.0 if given else 0.1 * place
        found.append(dataclasses.replace(with_force(run, own), given_force=own))
    return found


STAIRS = np.repeat([0.0, 1.2, 0.6, -1.0, -0.5, 1.4, 0.4, 0.0], 300)


@pytest.mark.parametrize(
    ("n", "force", "is_told"),
    [
        (1, STAIRS, False),  # jumps over steps
        (2, np.repeat([0.0, 0.5, 1.0, 0.5, 0.0, -0.5], 300), False),  # goes from step to step, but twice alike
        (1, np.repeat([0.0, 0.5, 1.0, 0.5, 0.0, -0.5], 300), True),
        (1, np.round(np.random.default_rng(0).standard_normal(2000) / 0.2) * 0.2, True),  # changes at every sample
    ],
)
def test_steps_of_a_force_that_was_commanded_so_are_no_few_digits(n: int, force: np.ndarray, is_told: bool) -> None:
    drive = dataclasses.replace(axis_lab.drive(), controller=Following())
    assert bool(limits_of_forces(in_open_loop(n, force), drive)) is is_told


def test_a_force_with_few_digits_is_never_the_same_twice() -> None:
    force = np.round(np.cumsum(np.random.default_rng(0).standard_normal(2000)) / 10.0) * 0.1
    drive = dataclasses.replace(axis_lab.drive(), controller=Following())
    (said,) = limits_of_forces(in_open_loop(2, force, given=False), drive)
    assert "is written in steps of 0.1 N" in said


def test_what_is_cut_off_is_told_unless_the_model_says_so() -> None:
    drive = axis_lab.drive()
    (run,) = runs(1)
    cut = with_force(run, np.clip(run.channels["motor_force_N"], -900.0, 900.0))
    (said,) = limits_of_forces([cut], drive)
    assert "motor_force_N stands at its greatest value, 900 N, for " in said
    assert "the model's force_limit_N is 6000" in said
    known = dataclasses.replace(drive, controller=dataclasses.replace(drive.controller, force_limit_N=900.0))
    assert limits_of_forces([cut], known) == []
    assert limits_of_forces([cut], dataclasses.replace(drive, controller=Following())) == []


@pytest.mark.parametrize(
    ("values", "step"),
    [([0.0, 0.1, 0.3], 0.1), ([1.0, 1.0, 1.0], 0.0), ([0.0, 1.0, 2.5], 0.0), (list(range(200)), 0.0)],
)
def test_steps_are_those_of_which_all_values_are_multiples(values: list[float], step: float) -> None:
    assert step_of(np.array(values, dtype=float)) == pytest.approx(step)
