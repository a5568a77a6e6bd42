"""Records under another force than their repeats are told apart, and the force is found by inverse dynamics."""

import dataclasses

import numpy as np
import pytest
from axis_lab import as_built, drive, protocol, record

from fdbench.diagnosis.diagnose import Diagnosis, diagnose
from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.judge.process_force import process_forces
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.effects import Effect, effects
from fdbench.errors import SpecError
from fdbench.plants.feed_drive import Following
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.report.diagnosis_text import summary

AMPLITUDE_N, FREQUENCY_HZ = 150.0, 7.0


def nominal() -> Nominal:
    return Nominal(plant=drive(), simulation=Simulation(substeps=10))


def force() -> Effect:
    return effects.get("periodic_force").typical(force_amplitude_N=AMPLITUDE_N, frequency_Hz=FREQUENCY_HZ)


def repeats(*extra: tuple[Effect, ...]) -> list[Record]:
    motion, duration_s = protocol(1.0)["steps"]
    return [record(as_built(1), own, motion, duration_s, seed) for seed, own in enumerate(extra)]


def test_a_repeat_under_another_force_is_no_noise() -> None:
    ready = aligned(nominal(), repeats((), (), (force(),), ()), [])
    assert [item.run.name for item in ready.others] == ["record 2"]
    assert sum(run.repeats for run in ready.split.runs) == 3
    alone = aligned(nominal(), repeats((), ()), [])
    for name, floor in alone.split.noise_models.items():
        assert ready.split.noise_models[name].rms == pytest.approx(floor.rms, rel=0.1)


def test_friction_and_offset_of_a_day_are_no_condition() -> None:
    rubbing = effects.get("coulomb_friction").typical(coulomb_force_N=15.0)
    pulled = effects.get("constant_force").typical(constant_force_N=20.0)
    assert not aligned(nominal(), repeats((), (rubbing,), (pulled,)), []).others


def test_two_records_that_differ_do_not_tell_which_is_noise() -> None:
    assert not aligned(nominal(), repeats((), (force(),)), []).others


@pytest.mark.parametrize("place", [0, 1])
def test_of_two_records_that_differ_as_those_of_no_other_command_do_the_model_tells_which(place: int) -> None:
    fast, duration_s = protocol(1.0)["fast"]
    others = [record(as_built(1), (), fast, duration_s, 7 + seed) for seed in range(2)]
    disturbed = [(), ()]
    disturbed[place] = (force(),)
    ready = aligned(nominal(), [*repeats(*disturbed), *others], [])
    assert [item.run.name for item in ready.others] == [f"record {place}"]
    (own,) = process_forces(ready.others, ready.readings, start(ready.nominal))
    assert own.beside == "repeats"
    assert own.amplitude_N == pytest.approx(AMPLITUDE_N, rel=0.05)
    assert own.standard_deviation_N < 0.2 * AMPLITUDE_N


def test_a_force_out_of_step_in_both_of_two_records_is_of_no_other_condition() -> None:
    fast, duration_s = protocol(1.0)["fast"]
    others = [record(as_built(1), (), fast, duration_s, 7 + seed) for seed in range(2)]
    later = force().within(phase_rad=2.0)
    assert not aligned(nominal(), [*repeats((force(),), (later,)), *others], []).others


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """Two repeats of one motion with cogging, and under another force as the record held out."""
    cogging = effects.get("cogging").typical(cogging_force_N=20.0, pitch_m=0.01)
    *usual, other = repeats((cogging,), (cogging,), (cogging, force()))
    return diagnose(nominal(), usual, [other])


def test_the_force_is_found_and_the_cause_stays(found: Diagnosis) -> None:
    (own,) = found.answer.process_forces
    assert own.record == "record 2"
    assert own.beside == "repeats"
    assert own.frequency_Hz == pytest.approx(FREQUENCY_HZ, rel=0.01)
    assert own.amplitude_N == pytest.approx(AMPLITUDE_N, rel=0.05)
    assert own.rms_N == pytest.approx(AMPLITUDE_N / np.sqrt(2.0), rel=0.05)
    assert own.standard_deviation_N < 0.05 * AMPLITUDE_N
    assert found.answer.causes[0].effect == "cogging"
    assert found.answer.shrinkage.judged_on == "held-out repeats"


def test_text_says_what_acts_where(found: Diagnosis) -> None:
    text = " ".join(summary(found.answer).split())
    assert "Of another condition and left out: record 2" in text
    assert "at 7 Hz" in text


def test_a_condition_that_is_named_is_kept_apart(tmp_path) -> None:
    """Of another motion: the force is what the final model lacks."""
    motion, duration_s = protocol(1.0)["fast"]
    record(as_built(1), (force(),), motion, duration_s, 5).save(tmp_path / "cut.csv")
    columns = ["time_s", "reference_position_m", "motor_position_m", "table_position_m", "motor_torque_Nm"]
    names = "\n".join(f'{name} = {{ from = "{name}" }}' for name in columns)
    mapping = tmp_path / "cut.toml"
    mapping.write_text(f'[record]\nfile = "cut.csv"\ncondition = "cut"\n[columns]\n{names}\n', encoding="utf-8")
    plain = [Record({name: item[name] for name in columns}, {}, item.source) for item in repeats((), ())]
    answer = diagnose(nominal(), [*plain, read_record(mapping)]).answer
    (own,) = answer.process_forces
    assert own.condition == "cut"
    assert own.beside == "model"
    assert own.frequency_Hz == pytest.approx(FREQUENCY_HZ, rel=0.02)
    assert own.rms_N == pytest.approx(AMPLITUDE_N / np.sqrt(2.0), rel=0.15)


def test_a_condition_is_a_word(tmp_path) -> None:
    (tmp_path / "cut.csv").write_text("a,b\n0,0\n", encoding="utf-8")
    mapping = tmp_path / "cut.toml"
    mapping.write_text('[record]\nfile = "cut.csv"\ncondition = 3\n[columns]\ntime_s = { from = "a" }\n')
    with pytest.raises(SpecError, match="'condition' is 3; it has to be a text"):
        read_record(mapping)


def test_a_force_that_does_not_repeat_with_the_laps_is_no_noise() -> None:
    """Pulses of 1.3 Hz over laps of 1 s: nothing that the library has, and not named as one of its effects."""
    place = np.arange(6000) * 1e-3
    lap = np.concatenate([0.05 * (1.0 - np.cos(2.0 * np.pi * place[:1000]))] * 6)
    speed, acceleration = np.gradient(lap, 1e-3), np.gradient(np.gradient(lap, 1e-3), 1e-3)
    axis = drive()
    pulses = np.where(np.mod(1.3 * place, 1.0) < 0.3, 400.0, 0.0)
    noise = np.random.default_rng(0).normal(size=6000)
    force = axis.mass_kg * acceleration + 600.0 * speed + 120.0 * np.tanh(speed / 1e-3) + pulses + noise
    columns = {"time_s": place, "motor_position_m": lap, "motor_force_N": force}
    answer = diagnose(
        Nominal(
            plant=dataclasses.replace(axis, controller=Following(), screw=None, table=None),
            simulation=Simulation(substeps=10),
        ),
        [Record(columns, {}, "pulses")],
    ).answer
    (own,) = answer.process_forces
    assert own.beside == "nominal"
    assert any("does not repeat with the motion" in text for text in answer.warnings)
    assert answer.unknown_probability > 0.5
