"""A controller that holds a weight when a record begins has it in its integral."""

import dataclasses

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.runs import RecordedRun, prepare
from fdbench.effects import effects
from fdbench.record import Record
from fdbench.virtual_axes.library_axis import Tabulated

REST = 3000  # samples, of which the last 200 are recorded
WEIGHT = effects.get("constant_force")


def held(axis: object, *extra: object, factor: float, seed: int) -> list[Record]:
    """Return records that begin at rest, after the loop has settled."""
    found = []
    for motion, duration_s in axis_lab.protocol(factor).values():
        moved = motion.reference(axis_lab.PERIOD_S, round(duration_s / axis_lab.PERIOD_S))  # type: ignore[attr-defined]
        whole = np.vstack((np.repeat(moved[:1] * [1.0, 0.0, 0.0], REST, axis=0), moved))
        full = axis_lab.record(axis, extra, Tabulated(values=whole), len(whole) * axis_lab.PERIOD_S, seed)  # type: ignore[arg-type]
        columns = {name: values[REST - 200 :] for name, values in full.items()}
        found.append(Record({**columns, "time_s": columns["time_s"] - columns["time_s"][0]}, {}, full.source))
    return found


def run(force: np.ndarray, still: int) -> RecordedRun:
    reference = np.zeros((len(force), 3))
    reference[still:, 1] = 0.1
    channels = {"motor_force_N": force, "position_m": np.zeros(len(force))}
    return RecordedRun(name="x", period_s=1e-3, reference=reference, channels=channels, lap=None)


def test_a_force_is_held_where_it_is_there_from_the_first_sample_to_the_first_motion() -> None:
    noise = np.random.default_rng(0).standard_normal(400)
    assert run(100.0 + noise, 200).held_force_N == pytest.approx(100.0, abs=0.3)
    assert run(noise, 200).held_force_N == 0.0, "noise alone"
    assert run(100.0 + noise, 10).held_force_N == 0.0, "too short to tell"
    builds_up = 100.0 * (1.0 - np.exp(-np.arange(400) / 30.0))
    assert run(builds_up + noise, 200).held_force_N == 0.0, "switched on as the record begins"


def test_a_force_that_builds_up_is_told_however_loud_it_is() -> None:
    rise = 50.0 * (1.0 - np.exp(-np.arange(400) / 40.0))
    for seed in range(50):
        noise = 17.0 * np.random.default_rng(seed).standard_normal(400)
        assert run(rise + noise, 150).held_force_N == 0.0
        assert run(50.0 + noise, 150).held_force_N == pytest.approx(50.0, abs=12.0)


def test_a_force_that_builds_up_does_so_less_what_is_left_of_a_baseline() -> None:
    noise = np.random.default_rng(0).standard_normal(400)
    read = run(100.0 * (1.0 - np.exp(-np.arange(400) / 30.0)) + noise, 200)
    level = {**read.channels, "motor_force_N": 100.0 + noise}
    corrected = dataclasses.replace(read, channels=level, readings=read.channels)
    assert corrected.held_force_N == read.held_force_N == 0.0


def test_a_known_weight_that_is_held_is_no_gap_and_another_one_is_told() -> None:
    paper = axis_lab.drive()
    known = dataclasses.replace(paper, effects=(*paper.effects, WEIGHT.typical(constant_force_N=300.0)))
    nominal = Nominal(plant=known, simulation=Simulation(substeps=10))
    for extra_N, named in ((0.0, []), (80.0, ["constant_force"])):
        axis = dataclasses.replace(paper, effects=(*paper.effects, WEIGHT.typical(constant_force_N=300.0 + extra_N)))
        fitted = [item for seed in (1, 2) for item in held(axis, factor=1.0, seed=seed)]
        answer = diagnose(nominal, fitted, held(axis, factor=1.3, seed=3)).answer
        assert [cause.effect for cause in answer.causes if cause.probability > 0.5] == named
        assert answer.unknown_probability < 0.5


def test_a_held_weight_moves_nothing_at_rest() -> None:
    paper = axis_lab.drive()
    known = dataclasses.replace(paper, effects=(*paper.effects, WEIGHT.typical(constant_force_N=300.0)))
    record = held(known, factor=1.0, seed=1)[0]
    nominal = Nominal(plant=known, simulation=Simulation(substeps=10))
    own = prepare(record, nominal.drive)
    assert own.held_force_N == pytest.approx(300.0, abs=known.effects[0].coulomb_force_N), "friction holds some of it"
    simulated = Replay(nominal.drive, nominal.library, 10).alone(own, start(nominal).variant)
    left = own.channels["position_m"] - simulated["position_m"]
    assert np.abs(left[:150]).max() < 1e-6


def test_a_velocity_loop_that_is_recorded_in_motion_has_its_integral_from_the_force() -> None:
    """Without a position loop nothing brings the simulated axis back to where the measured one is."""
    paper = axis_lab.drive()
    loop = dataclasses.replace(paper.controller, position_gain_per_s=0.0)
    axis = dataclasses.replace(paper, controller=loop)
    motion, duration_s = axis_lab.protocol(1.0)["steps"]
    full = axis_lab.record(axis, (), motion, duration_s, 1)
    begun = 700  # in motion at constant speed
    columns = {name: values[begun:] for name, values in full.items()}
    record = Record({**columns, "time_s": columns["time_s"] - columns["time_s"][0]}, {}, full.source)
    nominal = Nominal(plant=axis, simulation=Simulation(substeps=10))
    own = prepare(record, nominal.drive)
    assert own.held_force_N == 0.0
    assert own.carried_force_N == pytest.approx(float(record["motor_torque_Nm"][0]) * 2.0 * np.pi / 0.01, rel=0.05)
    simulated = Replay(nominal.drive, nominal.library, 10).alone(own, start(nominal).variant)
    apart = own.channels["position_m"] - simulated["position_m"]
    empty_m = own.carried_force_N / loop.integral_gain_N_per_m
    assert np.abs(apart[-500:]).max() < 0.05 * empty_m, "an integral that begins at nothing leaves all of it"
