"""A force at its own phase in each record is named with its size; pick-up, and what was there before, are not."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from axis_lab import PERIOD_S, as_built, drive, protocol, record

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.cause import READING
from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.evidence.force_out_of_step import (
    Looked,
    lines_between_repeats,
    lines_of_all,
    without_forces_out_of_step,
)
from fdbench.diagnosis.evidence.sensor_artefacts import Artefact
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.runs import FORCE, POSITION, RecordedRun, differences
from fdbench.diagnosis.records.spectral_lines import Stretches
from fdbench.effects import Effect, effects
from fdbench.plants.feed_drive import RotaryMotor
from fdbench.record import Record
from fdbench.statistics import rms

AMPLITUDE_N, FREQUENCY_HZ = 40.0, 27.3
Made = Callable[[object, float, int], Record]


def records(made: Made, seed: int) -> list[Record]:
    """Return three repeats of each motion."""
    return [
        made(motion, duration_s, seed + 10 * place + repeat)
        for place, (motion, duration_s) in enumerate(protocol(1.0).values())
        for repeat in range(3)
    ]


def force(phase_rad: float) -> Effect:
    return effects.get("periodic_force").typical(
        force_amplitude_N=AMPLITUDE_N, frequency_Hz=FREQUENCY_HZ, phase_rad=phase_rad
    )


def turning(motion: object, duration_s: float, seed: int) -> Record:
    """Return a record beside something that turns."""
    phase = float(np.random.default_rng(seed).uniform(-math.pi, math.pi))
    return record(as_built(1), (force(phase),), motion, duration_s, seed)


def quiet(motion: object, duration_s: float, seed: int) -> Record:
    return record(as_built(1), (), motion, duration_s, seed)


def picked_up(motion: object, duration_s: float, seed: int) -> Record:
    """Return a record in which the reading of the force alone has the line."""
    found, phase = quiet(motion, duration_s, seed), float(np.random.default_rng(seed).uniform(-math.pi, math.pi))
    angle = 2.0 * np.pi * FREQUENCY_HZ * found["time_s"] + phase
    motor = drive().motor
    assert isinstance(motor, RotaryMotor)
    columns = {name: found[name] for name in found}
    columns["motor_torque_Nm"] = columns["motor_torque_Nm"] + AMPLITUDE_N * np.sin(angle) * motor.lead_m / (2.0 * np.pi)
    return Record(columns, {}, found.source)


def answer_to(now: list[Record], before: list[Record] | None = None) -> Answer:
    return diagnose(Nominal(plant=drive(), simulation=Simulation(substeps=10)), now, baseline=before or []).answer


def named(answer: Answer) -> list[str]:
    return [cause.effect for cause in answer.causes if cause.probability > 0.5]


def test_a_force_out_of_step_is_named_with_its_size_and_taken_out_of_the_noise() -> None:
    answer = answer_to(records(turning, 100))
    assert named(answer) == ["periodic_force"]
    (cause,) = (cause for cause in answer.causes if cause.effect == "periodic_force")
    assert cause.kind == READING
    assert cause.parameters["force_amplitude_N"].value == pytest.approx(AMPLITUDE_N, rel=0.1)
    assert cause.parameters["frequency_Hz"].value == pytest.approx(FREQUENCY_HZ, abs=0.05)
    assert sum("which is not in step with their command" in text for text in answer.warnings) == 1
    assert answer.gap.channels["motor_force_N"].noise_floor < 0.1 * AMPLITUDE_N


def test_an_axis_that_cannot_have_one_is_given_none() -> None:
    nominal = Nominal(plant=drive(), simulation=Simulation(substeps=10), exclude=("periodic_force",))
    answer = diagnose(nominal, records(turning, 100)).answer
    assert named(answer) == []
    assert sum("which is not in step with their command" in text for text in answer.warnings) == 1


def test_motions_that_were_recorded_once_show_it_too() -> None:
    once = [
        turning(motion, duration_s, seed)
        for seed, (motion, duration_s) in enumerate((*protocol(1.0).values(), *protocol(1.3).values()), 300)
    ]
    assert named(answer_to(once)) == ["periodic_force"]


def test_a_wave_over_the_way_is_no_line_over_time() -> None:
    """All strokes are at one speed and begin elsewhere: cogging is a line at 20 Hz, at another phase each."""
    rng = np.random.default_rng(2)
    runs, lines = [], []
    for first in (0.0, 0.0012, 0.0031):
        reference = moves((first, first + 0.4, first + 0.1), (0.1,), 4.0, PERIOD_S, dwell_s=1.0)
        noise = rng.standard_normal(len(reference))
        cogging = 20.0 * np.sin(2.0 * np.pi * reference[:, 0] / 0.005) * (np.abs(reference[:, 1]) > 0.0)
        fan = 20.0 * np.sin(2.0 * np.pi * 20.0 * np.arange(len(reference)) * PERIOD_S + 1e3 * first)
        for found, force_N in ((runs, cogging), (lines, fan)):
            channels = {"motor_force_N": force_N + noise, "position_m": reference[:, 0]}
            found.append(RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None))
    assert lines_of_all(list(map(Looked.everywhere, runs))) == []
    (line,) = lines_of_all(list(map(Looked.everywhere, lines)))
    assert line == pytest.approx(20.0, abs=0.05)


@pytest.mark.parametrize(("decay_s", "n_lines"), [(math.inf, 1), (0.8, 0)])
def test_what_rings_is_no_force_that_acts_all_the_time(decay_s: float, n_lines: int) -> None:
    rng = np.random.default_rng(4)
    runs = []
    for first in (0.0, 0.7, 1.9):
        reference = moves((0.0, 0.3 + 0.05 * first, 0.1, 0.4, 0.0), (0.2,), 4.0, PERIOD_S, dwell_s=0.5)
        time_s = np.arange(len(reference)) * PERIOD_S
        force_N = rng.standard_normal(len(reference)) + 20.0 * np.exp(-time_s / decay_s) * np.sin(
            126.0 * time_s + first
        )
        channels = {"motor_force_N": force_N, "position_m": reference[:, 0]}
        runs.append(RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None))
    assert len(lines_of_all(list(map(Looked.everywhere, runs)))) == n_lines


def test_a_force_that_friction_holds_at_rest_is_found_while_the_axis_moves() -> None:
    rng = np.random.default_rng(3)
    reference = moves((0.0, 0.08, 0.02, 0.11, 0.0), (0.08,), 4.0, PERIOD_S, dwell_s=0.7)
    moving, time_s = np.abs(reference[:, 1]) > 0.0, np.arange(len(reference)) * PERIOD_S
    runs = []
    for phase in (0.3, 2.0, 4.4):
        wave = np.sin(2.0 * np.pi * FREQUENCY_HZ * time_s + phase) * moving
        gap = {
            FORCE: AMPLITUDE_N * wave + rng.standard_normal(len(wave)),
            POSITION: 1e-6 * wave + 1e-7 * rng.standard_normal(len(wave)),
        }
        channels = {FORCE: gap[FORCE], POSITION: reference[:, 0] + gap[POSITION]}
        run = RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None)
        runs.append(dataclasses.replace(run, left=gap))
    whole = [Stretches.whole(run.n_samples) for run in runs]
    assert lines_between_repeats(differences(runs, FORCE), whole[1:], PERIOD_S) == [], "not there throughout"
    nominal = Nominal(plant=drive(), simulation=Simulation(substeps=10))
    found = without_forces_out_of_step(runs, nominal, Replay(nominal.drive, nominal.library, 10))
    assert found.artefact is not None
    assert found.artefact.kind.name == "periodic_force"
    assert found.artefact.further["frequency_Hz"] == pytest.approx(FREQUENCY_HZ, abs=0.02)
    assert found.artefact.value == pytest.approx(AMPLITUDE_N / 0.74, rel=0.05), "the loop answers with 74 % of it"
    for run in found.runs:
        assert run.left is not None
        assert rms(run.left[FORCE]) < 0.1 * AMPLITUDE_N


def test_friction_that_differs_between_two_of_many_repeats_is_no_line() -> None:
    """Slow, and large, but in one of four differences alone; and as slow as the stretches of motion are short."""
    rng = np.random.default_rng(4)
    time_s = np.arange(8000) * PERIOD_S
    whole = [Stretches.whole(8000)] * 4
    between = [rng.standard_normal(8000) for _ in whole]
    slow = 30.0 * np.sin(2.0 * np.pi * 2.5 * time_s)
    assert lines_between_repeats([between[0] + slow, *between[1:]], whole, PERIOD_S) == []
    (line,) = lines_between_repeats([own + slow for own in between], whole, PERIOD_S)
    assert line == pytest.approx(2.5, abs=0.05)
    short = [Stretches(n_samples=8000, slices=(slice(500, 1200), slice(3000, 3700)))] * 4
    assert lines_between_repeats([own + slow for own in between], short, PERIOD_S) == []


def test_pick_up_of_the_measurement_is_no_force() -> None:
    answer = answer_to(records(picked_up, 100))
    assert named(answer) == []
    assert sum("pick-up of the measurement, which is taken out" in text for text in answer.warnings) == 1


def test_a_force_that_was_there_before_is_no_change() -> None:
    assert named(answer_to(records(turning, 200), records(turning, 100))) == []
    assert named(answer_to(records(turning, 200), records(quiet, 100))) == ["periodic_force"]


def test_what_repeats_do_not_differ_by_is_no_line() -> None:
    rng = np.random.default_rng(5)
    time_s = np.arange(2000) * PERIOD_S
    still = RecordedRun(
        name="x", period_s=PERIOD_S, reference=np.zeros((2000, 3)), channels={"position_m": np.zeros(2000)}, lap=None
    )

    def run(amplitude_N: float, phase_rad: float) -> RecordedRun:
        wave = amplitude_N * np.sin(2.0 * np.pi * FREQUENCY_HZ * time_s + phase_rad)
        channels = {**still.channels, "motor_force_N": wave + rng.standard_normal(2000)}
        return dataclasses.replace(still, channels=channels)

    def lines(amplitude_N: float, *phases: float) -> list[float]:
        between = differences([run(amplitude_N, phase) for phase in phases], FORCE)
        return lines_between_repeats(between, [Stretches.whole(len(own)) for own in between], PERIOD_S)

    assert lines(5.0, 0.3, 0.3, 0.3) == [], "in step with the command"
    assert lines(0.0, 0.0, 0.0, 0.0) == [], "noise"
    (line,) = lines(5.0, 0.0, 2.0, 4.0)
    assert line == pytest.approx(FREQUENCY_HZ, abs=0.05)


def test_what_is_left_of_a_force_that_was_taken_out_is_no_second_cause() -> None:
    kind = effects.get("periodic_force")
    taken = Artefact(
        kind=kind, probability=0.99, value=20.0, low=19.0, high=21.0, energy={}, further={"frequency_Hz": 9.3}
    )
    assert taken.tells_of(kind.typical(frequency_Hz=9.29))
    assert not taken.tells_of(kind.typical(frequency_Hz=18.6))
    assert not taken.tells_of(effects.get("runout_force").typical())
    assert not dataclasses.replace(taken, further={}).tells_of(kind.typical(frequency_Hz=9.3))
