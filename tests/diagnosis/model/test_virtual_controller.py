"""Diagnosis without the controller: the measured motion is followed, and the cause is still named first."""

import dataclasses
import json
import re
from collections.abc import Sequence
from pathlib import Path

import axis_lab
import numpy as np
import pytest
import scipy.signal
from conftest import REPOSITORY, shared_file

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.as_nominal import as_nominal
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation, load_nominal
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.model.virtual_controller import holds, prepared
from fdbench.diagnosis.repaired import model_text
from fdbench.effects import Effect, effects
from fdbench.errors import RecordError, SpecError
from fdbench.plants._controllers import Cascade
from fdbench.plants.feed_drive import FeedDrive, Following, LinearMotor
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.report.diagnosis_text import summary
from fdbench.simulate.system import Setup, Timing

EXAMPLE = REPOSITORY / "examples" / "emps"
ENCODER_NOISE_M = 3e-8


def unknown(nominal: Nominal, **fields: object) -> Nominal:
    """Return the model without its controller."""
    drive = dataclasses.replace(nominal.drive, controller=Following(**fields))  # type: ignore[arg-type]
    return dataclasses.replace(nominal, plant=drive)


def kept(records: Sequence[Record], *names: str) -> list[Record]:
    return [Record({name: item[name] for name in ("time_s", *names)}, {}, item.source) for item in records]


def blind(extra: tuple[Effect, ...], seed: int) -> tuple[Nominal, list[Record], list[Record]]:
    """Return the case of the laboratory without controller and command."""
    nominal, *groups = axis_lab.case(extra, seed)
    names = "motor_position_m", "table_position_m", "motor_torque_Nm"
    return unknown(nominal), kept(groups[0], *names), kept(groups[1], *names)


def simulated(nominal: Nominal, records: Sequence[Record]) -> list[tuple[dict[str, np.ndarray], dict[str, np.ndarray]]]:
    """Return measured and simulated channels of each record."""
    nominal, runs, _ = prepared(nominal, records)
    replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
    pairs = []
    for run in runs:
        columns = replay.simulate(run, [start(nominal).variant])
        pairs.append((run.channels, {name: values[0] for name, values in columns.items()}))
    return pairs


# ---- the virtual controller ----


@pytest.mark.parametrize("gain", [5e3, 2e4])
def test_a_complete_model_needs_the_measured_force_whatever_the_controller(gain: float) -> None:
    """Forces differ by the loop's reaction to the encoder's noise alone, K_v sqrt(2) n / T for differences."""
    drive = axis_lab.drive()
    assert isinstance(drive.controller, Cascade)
    axis = dataclasses.replace(
        drive, controller=dataclasses.replace(drive.controller, velocity_gain_N_s_per_m=gain, velocity_feedforward=0.9)
    )
    motion, duration_s = axis_lab.protocol(1.0)["fast"]
    records = [axis_lab.record(axis, (), motion, duration_s, seed=3)]
    nominal = Nominal(plant=drive, simulation=Simulation(substeps=10))
    bandwidth_Hz = 20.0
    ((measured, model),) = simulated(unknown(nominal, bandwidth_Hz=bandwidth_Hz), records)
    reaction_N = 2.0 * np.pi * bandwidth_Hz * drive.mass_kg * np.sqrt(2.0) * ENCODER_NOISE_M / axis_lab.PERIOD_S
    assert np.ptp(measured["motor_force_N"]) > 1000.0
    difference = (measured["motor_force_N"] - model["motor_force_N"])[50:]
    assert difference.std() < 1.5 * reaction_N
    assert (measured["position_m"] - model["position_m"])[50:].std() < 2.0 * ENCODER_NOISE_M


def test_a_lacking_force_is_what_the_model_needs_less() -> None:
    drive = axis_lab.drive()
    motion, duration_s = axis_lab.protocol(1.0)["steps"]
    constant = effects.get("constant_force").typical(constant_force_N=25.0)
    records = [axis_lab.record(drive, (constant,), motion, duration_s, seed=4)]
    ((measured, model),) = simulated(unknown(Nominal(plant=drive, simulation=Simulation(substeps=10))), records)
    difference = measured["motor_force_N"] - model["motor_force_N"]
    assert difference[500:].mean() == pytest.approx(25.0, abs=0.5)


def test_the_loop_is_as_fast_as_the_axis_allows() -> None:
    drive, period = axis_lab.drive(), axis_lab.PERIOD_S
    assert holds(drive, Following(bandwidth_Hz=20.0, mass_kg=drive.mass_kg), period)
    assert not holds(drive, Following(bandwidth_Hz=200.0, mass_kg=drive.mass_kg), period)
    assert not holds(drive, Following(bandwidth_Hz=20.0, mass_kg=drive.mass_kg), 20.0 * period)
    # Through the screw the table cannot be followed as fast as the motor.
    assert not holds(drive, Following(bandwidth_Hz=25.0, mass_kg=drive.mass_kg, feedback="table"), period)


def test_the_side_that_was_measured_is_followed() -> None:
    nominal, records, _ = blind((), seed=1)
    assert prepared(nominal, records)[0].drive.controller.uses_table is False
    table = kept(records, "table_position_m", "motor_torque_Nm")
    assert prepared(nominal, table)[0].drive.controller.uses_table is True
    either = [Record({"time_s": item["time_s"], "position_m": item["table_position_m"], **item}) for item in table]
    nameless = [Record({name: item[name] for name in item if name != "table_position_m"}) for item in either]
    with pytest.raises(RecordError, match="say on which side"):
        prepared(nominal, nameless)


# ---- the model file ----


def test_a_model_without_controller_is_read(tmp_path: Path) -> None:
    text = (EXAMPLE / "model.toml").read_text("utf-8")
    path = tmp_path / "axis.toml"
    path.write_text(re.sub(r"\[plant\.controller\].*?\n\n", "", text, flags=re.DOTALL), encoding="utf-8")
    assert load_nominal(path) == unknown(load_nominal(EXAMPLE / "model.toml"))


def test_a_loop_is_stable_or_not_at_its_own_rate() -> None:
    """One that is faster than its log would not be so at the sampling time of that."""
    nominal, fitted, _ = axis_lab.case((), 0)
    controller = nominal.drive.controller
    assert isinstance(controller, Cascade)
    stiff = dataclasses.replace(controller, velocity_gain_N_s_per_m=20.0 * controller.velocity_gain_N_s_per_m)
    nominal = dataclasses.replace(nominal, plant=dataclasses.replace(nominal.drive, controller=stiff))
    with pytest.raises(SpecError, match="unstable at a sampling time of 1 ms"):
        prepared(nominal, fitted)
    fast = dataclasses.replace(nominal, simulation=Simulation(substeps=10, loops=8))
    assert prepared(fast, fitted)[0] is fast


def test_a_drive_without_controller_is_not_simulated_on_its_command() -> None:
    drive = unknown(Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))).drive
    motion, duration_s = axis_lab.protocol(1.0)["fast"]
    timing = Timing(sampling_time_s=1e-3, duration_s=duration_s, substeps=10)
    with pytest.raises(SpecError, match="only fdbench diagnose"):
        drive.system(Setup(timing=timing, motion=motion))  # type: ignore[arg-type]


# ---- the diagnosis ----


@pytest.mark.parametrize("name", ["cogging", "load_dependent_friction"])
def test_the_effect_is_named_first_without_the_controller(name: str, tmp_path: Path) -> None:
    found = diagnose(*blind((effects.get(name).typical(),), seed=1))
    first = found.answer.causes[0]
    assert name == first.effect or name in first.indistinguishable_from
    assert first.probability > 0.5
    assert found.answer.shrinkage.total > 0.5
    assert "The model has no controller" in found.answer.warnings[0]
    assert "The model has no controller" in summary(found.answer)
    path = tmp_path / "repaired.toml"
    path.write_text(model_text(found), encoding="utf-8")
    assert load_nominal(path) == as_nominal(found.final)
    assert isinstance(load_nominal(path).drive.controller, Following)


def test_nothing_is_named_without_the_controller_where_nothing_is_hidden() -> None:
    answer = diagnose(*blind((), seed=2)).answer
    assert answer.no_gap_probability + answer.unknown_probability > 0.9
    assert not [cause for cause in answer.causes if cause.probability > 0.5]


def test_records_without_command_are_followed_although_the_controller_is_known() -> None:
    nominal, fitted, judged = axis_lab.case((), seed=1)
    _, runs, (warning,) = prepared(nominal, [*fitted, *kept(judged, "motor_position_m", "motor_torque_Nm")])
    assert all(run.motion is not None for run in runs)
    assert "no column reference_position_m" in warning
    assert prepared(nominal, fitted)[0] is nominal


def regression_apart(record: Record, fitted: slice, judged: slice) -> tuple[float, float]:
    """Return the asymmetry (N s/m) of the force below 40 Hz that the published model leaves, and what it removes of it.

    By least squares on what is fitted, without a simulation; of the mean square of what is judged.
    """
    low = scipy.signal.butter(4, 40.0 / 500.0)
    position, force = (scipy.signal.filtfilt(*low, record[name]) for name in ("motor_position_m", "motor_force_N"))
    velocity = np.gradient(position, 1e-3)
    sign = np.tanh(velocity / 1e-3)
    left = force - (95.1089 * np.gradient(velocity, 1e-3) + 203.5034 * velocity + 20.3935 * sign - 3.1648)
    columns = np.column_stack((velocity * sign, sign**2))
    found = np.linalg.lstsq(columns[fitted], left[fitted], rcond=None)[0]
    after = left - columns @ found
    return float(found[0]), float(1.0 - np.mean(after[judged] ** 2) / np.mean(left[judged] ** 2))


def test_the_documented_cause_of_emps_comes_first_without_the_controller() -> None:
    """It is as large as a regression of the force has it on the same lap, -34 N s/m, and removes as much."""
    folder = shared_file("data", "emps", "DATA_EMPS.mat").parent
    columns = read_record(EXAMPLE / "emps.toml", folder)
    record = kept([columns.slice(0, 12500)], "motor_position_m", "motor_force_N")[0]
    answer = diagnose(unknown(load_nominal(EXAMPLE / "model.toml")), [record]).answer
    json.dumps(answer.as_json(), allow_nan=False)
    first = answer.causes[0]
    assert first.effect == "direction_dependent_friction"
    asymmetry, share = regression_apart(record, slice(200, 6250), slice(6250, 12450))
    assert first.parameters["viscous_asymmetry_N_s_per_m"].value == pytest.approx(asymmetry, abs=3.0)
    force, reductions = answer.gap.channels["motor_force_N"], answer.shrinkage.steps[0].channels
    # Of the nominal gap beyond the noise: re-calibration has taken the error of the friction's form out before.
    beyond_noise = force.before**2 - force.noise_floor**2
    closed = reductions["motor_force_N"] * force.recalibrated**2
    assert closed / beyond_noise == pytest.approx(share, abs=0.04)


# ---- one mass, one position ----


def one_mass(mass_kg: float, coulomb_force_N: float) -> FeedDrive:
    """Return a rigid axis with linear motor and acceleration feed-forward."""
    return FeedDrive(
        motor=LinearMotor(mass_kg=mass_kg, viscous_friction_N_s_per_m=200.0),
        controller=Cascade(
            position_gain_per_s=60.0,
            velocity_gain_N_s_per_m=1.2e4,
            integral_gain_N_per_m=2e5,
            velocity_feedforward=1.0,
            acceleration_feedforward_kg=60.0,
            force_limit_N=3000.0,
            feedback="motor",
            difference_span=1,
        ),
        travel_m=1.0,
        velocity_limit_m_per_s=3.0,
        effects=(effects.get("coulomb_friction").typical(coulomb_force_N=coulomb_force_N),),
    )


@pytest.mark.parametrize("name", ["current_loop_lag", "torque_ripple"])
def test_the_effect_is_named_first_on_one_mass(name: str) -> None:
    axis, extra = one_mass(61.0, 118.0), (effects.get(name).typical(),)
    groups = []
    for factor, repeats in ((1.0, 2), (1.3, 1)):
        motions = axis_lab.protocol(factor).values()
        records = [axis_lab.record(axis, extra, *motion, seed=n) for motion in motions for n in range(repeats)]
        groups.append(
            kept(records, "reference_position_m", "reference_velocity_m_per_s", "position_m", "motor_force_N")
        )
    answer = diagnose(Nominal(plant=one_mass(60.0, 120.0), simulation=Simulation(substeps=10)), *groups).answer
    first = answer.causes[0]
    assert name == first.effect or name in first.indistinguishable_from
    assert first.probability > 0.5
    assert set(answer.gap.channels) == {"motor_force_N", "position_m"}
