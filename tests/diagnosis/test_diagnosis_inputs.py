"""Whatever is wrong with the files given to `fdbench diagnose` is said in one sentence, with exit code 2."""

import dataclasses
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY

from fdbench import cli
from fdbench.catalogue import scenario_folder
from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.model.candidates import candidates
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import load_nominal
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.model.virtual_controller import prepared
from fdbench.diagnosis.records.plausibility import check_record, clock_warnings
from fdbench.diagnosis.records.runs import prepare, rate
from fdbench.errors import FdbenchError, RecordError
from fdbench.plants.feed_drive import FeedDrive, Following, LinearMotor, RotaryMotor
from fdbench.record import Record

MODEL = REPOSITORY / "examples" / "emps" / "model.toml"
PERIOD_S = 1e-3
Columns = dict[str, np.ndarray]


def stroke() -> Columns:
    """Return 3 s of strokes at three speeds, with the force that the nominal model needs for them."""
    parts, place = [], 0.0
    for target, duration_s in ((0.1, 1.0), (0.04, 0.6), (0.08, 0.6), (0.0, 0.8)):
        s = np.arange(round(duration_s / PERIOD_S)) * PERIOD_S / duration_s
        parts += [place + (target - place) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)]
        place = target
    x = np.concatenate(parts)
    v = np.gradient(x, PERIOD_S)
    force = 95.1 * np.gradient(v, PERIOD_S) + 203.5 * v + 20.4 * np.tanh(v / 1e-3) - 3.2
    noise = np.random.default_rng(1).standard_normal((2, len(x)))
    return {
        "time_s": np.arange(len(x)) * PERIOD_S,
        "reference_position_m": x,
        "position_m": x + 5e-8 * noise[0],
        "motor_force_N": force + 1.0 * noise[1],
    }


def without(columns: Columns, *names: str, **others: np.ndarray) -> Columns:
    return {name: values for name, values in columns.items() if name not in names} | others


def spoiled(values: np.ndarray, value: float) -> np.ndarray:
    return np.concatenate((values[:500], [value], values[501:]))


def no_command(columns: Columns) -> Columns:
    return without(columns, "reference_position_m")


def still(columns: Columns) -> Columns:
    at_rest = columns["position_m"] - columns["reference_position_m"]
    return columns | {"position_m": at_rest, "reference_position_m": np.zeros(len(at_rest))}


def blamed(argv: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """Return what the command line writes on stderr when it stops with 2."""
    monkeypatch.setattr(sys, "argv", ["fdbench", "diagnose", *argv])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    told = capsys.readouterr().err
    assert stop.value.code == 2, told
    assert "Traceback" not in told
    return " ".join(told.split())


FLAWS: Mapping[str, tuple[Callable[[Columns], Columns], str]] = {
    "no force": (lambda c: without(c, "motor_force_N"), "no column motor_force_N or motor_current_A; log the"),
    "a current": (
        lambda c: without(c, "motor_force_N", motor_current_A=c["motor_force_N"]),
        r"\[plant.motor\] has no force_constant_N_per_A. Add it, or map the column to motor_force_N",
    ),
    "a torque": (
        lambda c: without(c, "motor_force_N", motor_torque_Nm=c["motor_force_N"]),
        "motor is linear. Map the column to motor_force_N",
    ),
    "no position": (lambda c: without(c, "position_m"), "no column position_m or motor_position_m. Map the position"),
    "nothing moves": (still, "stands still throughout.* Record strokes both ways"),
    "nothing moves, no command": (lambda c: no_command(still(c)), "stands still throughout.* Record strokes both ways"),
    "a command that stands still": (
        lambda c: c | {"reference_position_m": 0.0 * c["position_m"]},
        "reference_position_m never changes, but position_m moves by 0.1 m. Check which column",
    ),
    "a position that stands still": (lambda c: c | {"position_m": 0.0 * c["position_m"]}, "position_m does not follow"),
    "a force that never changes": (
        lambda c: c | {"motor_force_N": 0.0 * c["motor_force_N"] + 3.0},
        "motor_force_N never changes. Log the controller's output",
    ),
    "1e300 N": (
        lambda c: c | {"motor_force_N": spoiled(c["motor_force_N"], 1e300)},
        r"motor_force_N is 1e\+300 at sample 500. A damaged sample",
    ),
    "-1e300 m": (
        lambda c: no_command(c) | {"position_m": spoiled(c["position_m"], -1e300)},
        r"position_m is -1e\+300 at sample 500. A damaged sample",
    ),
    "one sample of 1e5 N": (
        lambda c: c | {"motor_force_N": spoiled(c["motor_force_N"], 1e5)},
        r"motor_force_N reaches 1e\+05 N at sample 500.* cut it out",
    ),
    "one sample of 60 mm": (
        lambda c: no_command(c) | {"position_m": spoiled(c["position_m"], -0.06)},
        "position_m jumps by 0.* m after sample .* two recordings in one",
    ),
    "three samples": (lambda c: {name: values[:3] for name, values in c.items()}, "3 samples, 3 ms; needed: 256"),
    "a swapped force": (lambda c: c | {"motor_force_N": -c["motor_force_N"]}, "sign of the force is.* swapped"),
    "a swapped force, no command": (
        lambda c: no_command(c) | {"motor_force_N": -c["motor_force_N"]},
        "sign of the force is.* swapped; a negative gain",
    ),
    "millimetres": (lambda c: c | {"position_m": 1e3 * c["position_m"]}, "about a thousand: millimetres"),
    "millimetres, no command": (
        lambda c: no_command(c) | {"position_m": 1e3 * c["position_m"]},
        'motion spans 100 m, the model\'s travel_m is 0.3.* unit = "mm"',
    ),
    "kilonewtons, no command": (
        lambda c: no_command(c) | {"motor_force_N": 1e-3 * c["motor_force_N"]},
        "about a thousand: .*kilonewtons.* gain",
    ),
    "milliseconds, no command": (lambda c: no_command(c) | {"time_s": 1e3 * c["time_s"]}, "time_s"),
    "kiloseconds": (lambda c: c | {"time_s": 1e-3 * c["time_s"]}, "is time_s in another unit"),
}


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_flawed_record_is_refused_in_words(
    flaw: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, words = FLAWS[flaw]
    path = tmp_path / "axis.csv"
    Record(spoil(stroke())).save(path)
    assert re.search(words, blamed(["--model", str(MODEL), str(path)], monkeypatch, capsys))


def test_a_command_may_span_the_travel_to_both_sides() -> None:
    drive = dataclasses.replace(load_nominal(MODEL).drive, travel_m=0.06)
    record = Record(stroke())
    assert np.ptp(record["reference_position_m"]) == pytest.approx(0.1, rel=0.01)
    check_record(prepare(record, drive), drive)
    with pytest.raises(RecordError, match=r"the command spans 0\.1 m, the model's travel_m is 0\.02"):
        check_record(prepare(record, drive), dataclasses.replace(drive, travel_m=0.02))


def test_records_of_two_clocks_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = stroke()
    for name, factor in (("a.csv", 1.0), ("b.csv", 2.0)):
        Record(no_command(columns) | {"time_s": factor * columns["time_s"]}).save(tmp_path / name)
    told = blamed(["--model", str(MODEL), str(tmp_path / "a.csv"), str(tmp_path / "b.csv")], monkeypatch, capsys)
    assert "sampled every 0.002 s" in told
    assert "one clock" in told


def edited(pattern: str, text: str, source: Path = MODEL) -> str:
    original = source.read_text("utf-8")
    changed = re.sub(pattern, text, original, count=1, flags=re.DOTALL)
    assert changed != original
    return changed


SCENARIO = scenario_folder() / "BallScrewAxis-v0.toml"
MODELS: Mapping[str, tuple[Callable[[], str], str]] = {
    "empty": (lambda: "", "missing key of nominal|plant: missing"),
    "garbage": (lambda: "][", "not valid TOML"),
    "unknown table": (lambda: MODEL.read_text("utf-8") + "\n[wibble]\na = 1\n", "wibble: unknown key"),
    "unknown key": (lambda: edited("mass_kg", "mas_kg"), r"mas_kg: unknown key .*Did you mean mass_kg"),
    "unknown controller": (lambda: edited('"cascade"', '"casade"'), "unknown kind 'casade'. Did you mean cascade"),
    "plant = 5": (lambda: "plant = 5\n[simulation]\nsubsteps = 10\n", "plant: a table is expected, found 5"),
    "no kind": (lambda: edited('kind = "feed_drive"', ""), "plant.kind: missing key"),
    "no simulation": (lambda: edited(r"\[simulation\].*", ""), "simulation: missing key"),
    "timing = 5": (
        lambda: "timing = 5\n" + edited(r"\[timing\].*?\n\n", "", SCENARIO),
        "model.timing: a table is expected, found 5",
    ),
    "substeps of text": (lambda: edited(r"substeps = \d+", 'substeps = "ten"', SCENARIO), "substeps: a whole number"),
}


@pytest.mark.parametrize("flaw", MODELS)
def test_a_flawed_model_is_refused_in_words(flaw: str, tmp_path: Path) -> None:
    text, words = MODELS[flaw]
    path = tmp_path / "axis.toml"
    path.write_text(text(), encoding="utf-8")
    with pytest.raises(FdbenchError, match=words) as told:
        load_nominal(path)
    assert "axis.toml" in str(told.value)


def test_missing_and_unreadable_models_are_said(tmp_path: Path) -> None:
    with pytest.raises(FdbenchError, match="no such file"):
        load_nominal(tmp_path / "axis.toml")
    (tmp_path / "axis.toml").write_bytes(bytes(range(256)))
    with pytest.raises(FdbenchError, match="not valid TOML"):
        load_nominal(tmp_path / "axis.toml")
    with pytest.raises(FdbenchError, match="cannot be read"):
        load_nominal(tmp_path)


@pytest.mark.parametrize("name", ["SpindleStep-v0", "ServoSpiral-v0", "SlotMilling-v0", "SensorNetwork-v0"])
def test_a_scenario_of_another_plant_is_no_model(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    model = scenario_folder() / f"{name}.toml"
    path = tmp_path / "axis.csv"
    Record(stroke()).save(path)
    told = blamed(["--model", str(model), str(path)], monkeypatch, capsys)
    assert "only a feed_drive can be diagnosed" in told


# ---- what is accepted ----


def with_motor(motor: LinearMotor | RotaryMotor) -> FeedDrive:
    drive = load_nominal(MODEL).drive
    return FeedDrive(
        motor=motor,
        controller=drive.controller,
        travel_m=drive.travel_m,
        velocity_limit_m_per_s=drive.velocity_limit_m_per_s,
    )


def test_force_torque_and_current_are_one() -> None:
    columns = stroke()
    force = columns["motor_force_N"]
    linear = LinearMotor(mass_kg=95.0, viscous_friction_N_s_per_m=200.0, force_constant_N_per_A=40.0)
    rotary = RotaryMotor(
        inertia_kg_m2=3e-4, lead_m=0.01, viscous_friction_N_s_per_m=200.0, torque_constant_Nm_per_A=0.5
    )
    per_Nm = 2.0 * np.pi / 0.01
    for motor, name, unit_N in (
        (linear, "motor_force_N", 1.0),
        (linear, "motor_current_A", 40.0),
        (rotary, "motor_force_N", 1.0),
        (rotary, "motor_torque_Nm", per_Nm),
        (rotary, "motor_current_A", 0.5 * per_Nm),
    ):
        record = Record(without(columns, "motor_force_N", **{name: force / unit_N}))
        np.testing.assert_allclose(prepare(record, with_motor(motor)).channels["motor_force_N"], force, rtol=1e-12)


def test_a_current_without_its_constant_names_it() -> None:
    motor = RotaryMotor(inertia_kg_m2=3e-4, lead_m=0.01, viscous_friction_N_s_per_m=200.0)
    columns = stroke()
    record = Record(without(columns, "motor_force_N", motor_current_A=columns["motor_force_N"]))
    with pytest.raises(RecordError, match="torque_constant_Nm_per_A"):
        prepare(record, with_motor(motor))


@pytest.mark.parametrize("name", ["motor_position_m", "table_position_m"])
def test_either_position_serves_a_rigid_axis(name: str) -> None:
    columns = stroke()
    record = Record(without(columns, "position_m", **{name: columns["position_m"]}))
    run = prepare(record, load_nominal(MODEL).drive)
    np.testing.assert_array_equal(run.channels["position_m"], columns["position_m"])


def test_a_position_on_the_other_side_of_a_screw_is_refused() -> None:
    columns = stroke()
    record = Record(without(columns, "position_m", table_position_m=columns["position_m"]))
    with pytest.raises(RecordError, match="It has table_position_m, but the controller's feedback is the other side"):
        prepare(record, load_nominal(SCENARIO).drive)


def test_a_late_force_without_command_is_warned_of() -> None:
    columns = stroke()
    late = np.concatenate((np.full(12, columns["motor_force_N"][0]), columns["motor_force_N"][:-12]))
    nominal, (run,), (said,) = prepared(load_nominal(MODEL), [Record(no_command(columns) | {"motor_force_N": late})])
    check_record(run, nominal.drive)
    replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
    as_nominal = replay.simulate(run, [start(nominal).variant])
    warnings = clock_warnings(run, {name: values[0] for name, values in as_nominal.items()})
    assert "no column reference_position_m" in said
    (delay,) = [float(found) for text in warnings for found in re.findall(r"motor_force_N: ([\d.]+) samples", text)]
    assert delay == pytest.approx(12.0, abs=4.0)


def test_a_command_that_bends_has_sharp_rates() -> None:
    """Of a velocity in straight pieces the acceleration is exact; a smooth one has it to second order."""
    t = np.arange(400) * PERIOD_S
    acceleration = np.where(t < 0.1, 0.0, np.where(t < 0.25, 2.0, -1.0))
    velocity = np.concatenate(([0.0], np.cumsum(acceleration[:-1]) * PERIOD_S))
    np.testing.assert_allclose(rate(velocity, PERIOD_S)[1:-2], acceleration[1:-2], atol=1e-9)
    np.testing.assert_allclose(rate(np.sin(20.0 * t), PERIOD_S)[2:-2], 20.0 * np.cos(20.0 * t)[2:-2], atol=4e-3)


def test_copies_of_a_record_tell_nothing_of_noise() -> None:
    nominal = load_nominal(MODEL)
    first, again = (Record(stroke(), {}, source) for source in ("a.csv", "b.csv"))
    found = aligned(nominal, [first, again], [first])
    alone = aligned(nominal, [first], [])
    assert [line for line in found.warnings if line not in alone.warnings] == [
        "b.csv: a copy of a.csv. It tells nothing of noise and is left out.",
        "a.csv: a copy of a.csv. It tells nothing of noise and is left out.",
    ]
    assert [run.name for run in found.runs] == ["a.csv"]
    assert not any(floor.measured for floor in found.split.noise_models.values())
    assert found.split.noise_models["position_m"].rms == alone.split.noise_models["position_m"].rms


def test_a_command_of_constant_speed_is_no_wrong_unit() -> None:
    drive = load_nominal(MODEL).drive
    time_s = np.arange(2000) * PERIOD_S
    noise = np.random.default_rng(3).standard_normal((2, 2000))
    columns = {
        "time_s": time_s,
        "reference_position_m": 0.05 * time_s,
        "reference_velocity_m_per_s": np.full(2000, 0.05),
        "position_m": 0.05 * time_s + 1e-7 * noise[0],
        "motor_force_N": 30.0 + noise[1],
    }
    check_record(prepare(Record(columns), drive), drive)
    wrong = columns | {"reference_velocity_m_per_s": np.full(2000, 50.0)}
    with pytest.raises(RecordError, match=r"is 1000 times the change.*about a thousand"):
        check_record(prepare(Record(wrong), drive), drive)


def test_a_bandwidth_that_is_not_kept_is_said() -> None:
    nominal = load_nominal(MODEL)
    fast = Following(bandwidth_Hz=900.0)
    blind = dataclasses.replace(nominal, plant=dataclasses.replace(nominal.drive, controller=fast))
    found, _, (_, lowered) = prepared(blind, [Record(no_command(stroke()))])
    assert isinstance(found.drive.controller, Following)
    assert found.drive.controller.bandwidth_Hz < 900.0
    assert "asked for 900 Hz and has" in lowered


def test_no_mode_above_what_the_samples_show_is_a_candidate() -> None:
    base = start(load_nominal(MODEL))
    modes = {
        period_s: [
            item.members[0].natural_frequency_Hz
            for item in candidates(base, None, period_s)
            if item.name == "structural_mode"
        ]
        for period_s in (1e-3, 5e-3, 0.1)
    }
    assert max(modes[1e-3]) == 170.0
    assert modes[5e-3] == [10.0, 14.0, 20.0, 30.0, 42.0, 60.0]
    assert modes[0.1] == []


def test_what_overflows_is_no_warning_amid_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def overflow(*_: object) -> None:
        raise RecordError(str(np.array([1e300]) * 1e300))

    monkeypatch.setattr("fdbench.diagnosis.diagnose.aligned", overflow)
    with pytest.raises(RecordError, match="inf"):
        diagnose(load_nominal(MODEL), [Record(stroke())])


def test_exclude_of_a_scenario_file_counts(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('exclude = ["backlash"]\n' + SCENARIO.read_text("utf-8"), encoding="utf-8")
    assert load_nominal(path).exclude == ("backlash",)
