"""Unedited logs of many controllers: what is proposed reads back as the record that was written."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import shared_file
from proposal import log_writers
from typer.testing import CliRunner, Result

from fdbench import cli
from fdbench.api import diagnose
from fdbench.diagnosis.model.nominal import load_nominal
from fdbench.errors import FdbenchError, RecordError
from fdbench.reading import read_record
from fdbench.reading.formats import formats
from fdbench.record import Record
from fdbench.scenario import load_scenario

RESOLUTION_M, RESOLUTION_NM = 6e-10, 6e-7  # half of the sixth digit behind the point, in mm and N m


@pytest.fixture(scope="module")
def record() -> Record:
    return load_scenario("BallScrewAxis-v1").record(3).slice(0, 2400)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.app, ["import", *map(str, arguments)])


def refused(words: str, *arguments: object) -> None:
    """The command ends with 2 and one line that names the file and says what is wrong."""
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert re.search(words, result.output), result.output
    assert result.output.count("\n") == 1
    assert any(str(argument) in result.output for argument in arguments) or ".toml: " in result.output


@pytest.mark.parametrize("name", log_writers.WRITERS)
def test_what_is_proposed_reads_back_as_written(name: str, record: Record, tmp_path: Path) -> None:
    file, write = log_writers.WRITERS[name]
    log = tmp_path / file
    write(record, log)
    before = log.read_bytes()
    result = run(log, "-o", tmp_path)
    assert result.exit_code == 0, result.output
    read = read_record(tmp_path / f"{log.stem}.toml")
    assert log.read_bytes() == before
    assert read.n_samples == record.n_samples
    assert read.sampling_time_s == pytest.approx(record.sampling_time_s, rel=1e-6)
    np.testing.assert_allclose(read["position_m"], record["position_m"], rtol=0.0, atol=RESOLUTION_M)
    np.testing.assert_allclose(
        read["reference_position_m"], record["reference_position_m"], rtol=0.0, atol=RESOLUTION_M
    )
    np.testing.assert_allclose(read["motor_force_N"], record["motor_torque_Nm"], rtol=0.0, atol=RESOLUTION_NM)
    model = load_nominal(tmp_path / "model.toml")
    assert model.axis == "linear"
    assert model.drive.mass_kg > 0.0
    assert "CHECK motor_force_N: " in result.output  # torques of a screw whose lead is not in the log
    assert f"fdbench diagnose --model {tmp_path / 'model.toml'} {tmp_path / log.stem}.toml" in result.output


def test_a_trace_on_two_clocks_is_read_at_the_slower_one(record: Record, tmp_path: Path) -> None:
    log = tmp_path / "trace.xml"
    log_writers.sinumerik(record, log)
    result = run(log)
    assert result.exit_code == 0, result.output
    assert "2 clocks (time 1 ms, time 2 ms) are read at the slowest, so that no value is invented" in result.output
    read = read_record(tmp_path / "trace.toml")
    assert read.sampling_time_s == pytest.approx(2e-3, rel=1e-9)
    for ours, written in (("table_position_m", "position_m"), ("reference_position_m", "reference_position_m")):
        np.testing.assert_allclose(read[ours], record[written][1::2], rtol=0.0, atol=RESOLUTION_M)
    np.testing.assert_allclose(read["motor_force_N"], record["motor_torque_Nm"][1::2], rtol=0.0, atol=RESOLUTION_NM)
    text = (tmp_path / "trace.toml").read_text().replace('"time 2 ms"', '"time 1 ms"')
    (tmp_path / "fast.toml").write_text(text)
    fast = read_record(tmp_path / "fast.toml")
    np.testing.assert_array_equal(fast["table_position_m"][::2], read["table_position_m"])
    np.testing.assert_array_equal(fast["table_position_m"][1::2], read["table_position_m"][:-1])  # held


@pytest.mark.parametrize("tag", [False, True])
def test_an_overrun_is_a_gap(tag: bool, record: Record, tmp_path: Path) -> None:
    log = tmp_path / "hal.txt"
    log_writers.halsampler(record, log, tag=tag, lost=7)
    result = run(log)
    assert result.exit_code == 0, result.output
    assert "samples: 480 to 2399 of 2400, the longest part without lost samples" in result.output
    np.testing.assert_allclose(
        read_record(tmp_path / "hal.toml")["position_m"], record["position_m"][480:], rtol=0.0, atol=RESOLUTION_M
    )
    text = (tmp_path / "hal.toml").read_text()
    (tmp_path / "all.toml").write_text(text.replace("samples = [480, 2400]", ""))
    with pytest.raises(RecordError, match=r"samples were lost before sample 480 \(line 482\).*samples = \[0, 480\]"):
        read_record(tmp_path / "all.toml")
    (tmp_path / "wrong.toml").write_text(text.replace("samples = [480, 2400]", "samples = [480, 2401]"))
    with pytest.raises(FdbenchError, match=r"samples is \[480, 2401\]; allowed"):
        read_record(tmp_path / "wrong.toml")


def test_a_log_of_linuxcnc_itself(tmp_path: Path) -> None:
    """By halsampler 2.9.0~pre1: limit3, pid and two integ as an axis, its buffer of 200 rows full after 197.

    Pins: command, position, output of pid, velocity. The integrators make force the acceleration: a mass of 1.
    """
    result = run(Path(__file__).with_name("linuxcnc.log"), "-o", tmp_path)
    assert result.exit_code == 0, result.output
    assert "'pin.1' jumps at sample 197 (1 in all): samples were lost there" in result.output
    rows = np.loadtxt(Path(__file__).with_name("linuxcnc.log"), comments="overrun")[197:]
    read = read_record(tmp_path / "linuxcnc.toml")
    for name, column, factor in (("reference_position_m", 0, 1e-3), ("position_m", 1, 1e-3), ("motor_force_N", 2, 1.0)):
        np.testing.assert_allclose(read[name], factor * rows[:, column], rtol=1e-14)
    assert load_nominal(tmp_path / "model.toml").drive.mass_kg == pytest.approx(1e3, rel=0.1)  # as 1 mm/s^2 needs 1


def test_turns_make_a_rotary_axis(record: Record, tmp_path: Path) -> None:
    log_writers.odrive_csv(record, tmp_path / "odrive.csv")
    result = run(tmp_path / "odrive.csv")
    assert result.exit_code == 0, result.output
    assert "in rev: ODrive counts so" in result.output
    read = read_record(tmp_path / "odrive.toml")
    np.testing.assert_allclose(read["position_rad"], 200.0 * np.pi * record["position_m"], rtol=0.0, atol=4e-9)
    np.testing.assert_allclose(read["motor_torque_Nm"], record["motor_torque_Nm"] / 0.5, rtol=0.0, atol=1e-8)
    assert load_nominal(tmp_path / "model.toml").axis == "rotary"


def test_the_sign_of_the_output_and_the_unit_of_speeds_are_seen(record: Record, tmp_path: Path) -> None:
    mirrored = Record({**record, "motor_torque_Nm": -record["motor_torque_Nm"]})
    log_writers.bracket_csv(mirrored, tmp_path / "a.csv")
    result = run(tmp_path / "a.csv")
    assert "only with gain = -1.0 does mass resist acceleration" in result.output
    assert "velocity_m_per_s is 'Actual velocity': its name says velocity" in result.output
    assert re.search(r"in mm/min: it is (60|59\.9\d|60\.0\d) times the derivative of 'Actual position", result.output)
    read = read_record(tmp_path / "a.toml")
    np.testing.assert_allclose(read["motor_force_N"], record["motor_torque_Nm"], rtol=0.0, atol=RESOLUTION_NM)


def test_what_is_missing_is_said(record: Record, tmp_path: Path) -> None:
    log_writers.klipper(record, tmp_path / "accel.csv")
    result = run(tmp_path / "accel.csv")
    assert result.exit_code == 1
    assert "NOT FOUND: the position." in result.output
    assert "NOT FOUND: the controller's output" in result.output
    assert "diagnose" not in result.output
    assert not (tmp_path / "model.toml").exists()
    lines = ["q\tF", *(f"{a}\t{b}" for a, b in zip(record["position_m"], record["motor_torque_Nm"], strict=True))]
    (tmp_path / "b.tsv").write_text("\n".join(lines))
    refused("no column of times. Give the sampling time: --sampling-time", tmp_path / "b.tsv")
    result = run(tmp_path / "b.tsv", "--sampling-time", "0.001")
    assert result.exit_code == 0, result.output
    assert "NOT FOUND: the commanded position." in result.output
    assert "CHECK the unit of the positions: m is a guess." in result.output
    assert read_record(tmp_path / "b.toml").sampling_time_s == pytest.approx(1e-3)


def test_several_logs_share_a_model_and_nothing_is_overwritten(record: Record, tmp_path: Path) -> None:
    files = [tmp_path / "one.csv", tmp_path / "two.csv"]
    for file in files:
        log_writers.bracket_csv(record, file)
    assert run(*files).exit_code == 0
    assert "one.csv, two.csv" in (tmp_path / "model.toml").read_text()
    refused("one.toml: exists already", files[0])
    turned = tmp_path / "turned"
    turned.mkdir()
    log_writers.bracket_csv(Record({**record, "motor_torque_Nm": -record["motor_torque_Nm"]}), tmp_path / "three.csv")
    result = run(files[0], tmp_path / "three.csv", "-o", turned)
    assert (
        f"CHECK the columns of {turned / 'three.toml'}: they are not those of {turned / 'one.toml'}." in result.output
    )
    log_writers.bracket_csv(record, tmp_path / "one.txt")
    (tmp_path / "new").mkdir()
    refused("two files would have this name", files[0], tmp_path / "one.txt", "-o", tmp_path / "new")


def test_a_corrected_mapping_gives_a_model_anew(record: Record, tmp_path: Path) -> None:
    log_writers.bracket_csv(record, tmp_path / "a.csv")
    assert run(tmp_path / "a.csv").exit_code == 0
    first = load_nominal(tmp_path / "model.toml").drive
    mapping = tmp_path / "a.toml"
    corrected = mapping.read_text().replace("gain = 1.0", "gain = 628.3185")
    mapping.write_text(corrected)
    refused("model.toml: exists already", mapping)
    (tmp_path / "model.toml").unlink()
    assert run(mapping).exit_code == 0
    assert mapping.read_text() == corrected
    second = load_nominal(tmp_path / "model.toml").drive
    assert second.mass_kg == pytest.approx(628.3185 * first.mass_kg, rel=1e-3)
    assert second.mass_kg == pytest.approx(load_scenario("BallScrewAxis-v1").plant.mass_kg, rel=0.15)  # the data sheet
    (tmp_path / "model.toml").unlink()
    mapping.write_text(corrected.replace("motor_force_N", "motor_torque_Nm").replace("gain = 628.3185", "gain = 1.0"))
    refused("no column motor_force_N, of which a first model is made", mapping)


@pytest.mark.parametrize(
    ("above", "names", "end"),
    [("", "# t q_cmd q F", ""), ("# made by hand\n# 3 runs\n", "# t q_cmd q F", ""), ("x,y\n", "t q_cmd q F", ",")],
    ids=["names in a comment", "below other comments", "a mark at the end of each line"],
)
def test_headers_of_tables(above: str, names: str, end: str, record: Record, tmp_path: Path) -> None:
    keys = ("time_s", "reference_position_m", "position_m", "motor_torque_Nm")
    rows = [",".join(map(repr, map(float, row))) + end for row in zip(*(record[key] for key in keys), strict=True)]
    (tmp_path / "a.csv").write_text(above + "\n".join([names.replace(" ", ",").replace("#,", "# ") + end, *rows]))
    result = run(tmp_path / "a.csv")
    assert result.exit_code == 0, result.output
    read = read_record(tmp_path / "a.toml")
    np.testing.assert_array_equal(read["position_m"], record["position_m"])
    np.testing.assert_array_equal(read["reference_position_m"], record["reference_position_m"])


# What stands above columns between blanks, at the edge of each line, and for a decimal point.
SPACED = {
    "numpy.savetxt": ("# t q_cmd q torque\n", "", "."),
    "units behind names": ("logger 2.1\nrun 7, 12 C\n\n  t [s]   q_cmd [m]  q [m]   torque (Nm)\n", "  ", "."),
    "units below names": ("run 7 12\n  t   q_cmd  q   torque\n  s  m m Nm\n", "  ", "."),
    "names in quotes": ('t "q  cmd" "q" "torque"\n', "", "."),
    "decimal commas": ("run 7,5\n t q_cmd q torque\n", "   ", ","),
}


@pytest.mark.parametrize("case", SPACED)
def test_columns_between_blanks(case: str, record: Record, tmp_path: Path) -> None:
    above, edge, point = SPACED[case]
    keys = ("time_s", "reference_position_m", "position_m", "motor_torque_Nm")
    rows = ["   ".join(f"{value:13.9f}" for value in row) for row in zip(*(record[key] for key in keys), strict=True)]
    text = above + "".join(f"{edge}{row}{edge}\n" for row in rows).replace(".", point)
    (tmp_path / "a.txt").write_text(text)
    result = run(tmp_path / "a.txt")
    assert result.exit_code == 0, result.output
    read = read_record(tmp_path / "a.toml")
    assert read.n_samples == record.n_samples
    for ours, written in (*zip(keys[:3], keys[:3], strict=True), ("motor_force_N", "motor_torque_Nm")):
        np.testing.assert_allclose(read[ours], record[written], rtol=0.0, atol=6e-10)
    damaged = text.splitlines()
    damaged[200] = damaged[200].split()[0]
    (tmp_path / "a.txt").write_text("\n".join(damaged))
    with pytest.raises(RecordError, match=r"line 201 has 1 cells, the header has 4"):
        read_record(tmp_path / "a.toml")


def table(file: Path, **columns: object) -> None:
    """Write columns as CSV; names have their blanks and brackets as underscores."""
    rows = zip(*columns.values(), strict=True)  # type: ignore[arg-type]
    file.write_text("\n".join([",".join(columns), *(",".join(map(repr, map(float, row))) for row in rows)]))


def test_two_encoders_and_stamps_that_are_late(record: Record, tmp_path: Path) -> None:
    late = record["time_s"] + 2e-4 * np.random.default_rng(1).random(record.n_samples)
    names = ("motor_position_m", "table_position_m", "reference_position_m")
    table(
        tmp_path / "a.csv",
        timestamp=late,
        **{"encoder 1 position [m]": record[names[0]], "encoder 2 position [m]": record[names[1]]},
        **{"setpoint [m]": record[names[2]], "torque [Nm]": record["motor_torque_Nm"], "speed [furlong]": late},
    )
    result = run(tmp_path / "a.csv")
    assert result.exit_code == 0, result.output
    read = read_record(tmp_path / "a.toml")
    for name in names:
        np.testing.assert_array_equal(read[name], record[name])
    np.testing.assert_array_equal(read["position_m"], record["table_position_m"])
    assert "CHECK position_m: the scale of the table closes the loop is a guess." in result.output
    assert "CHECK the clock: times in 'timestamp' are uneven by up to" in result.output
    assert "left out 'speed [furlong]': another velocity, not needed" in result.output
    assert read.sampling_time_s == pytest.approx(1e-3, rel=1e-3)


# The line of names, what 1 s, 1 m and 1 N m are in the file, its encoding, and the column that can only be guessed.
ABROAD = {
    "French": ("Temps (s);Consigne de position (mm);Position mesurée (mm);Couple (N·m)", 1, 1e3, 1, "cp1252", ""),
    "Italian": ("Tempo [s];Posizione comandata [mm];Posizione reale [mm];Coppia [Nm]", 1, 1e3, 1, "utf-8", ""),
    "Spanish": ("Tiempo (ms);Posición de consigna (mm);Posición real (mm);Par (Nm)", 1e3, 1e3, 1, "utf-8", ""),
    "Chinese": ("时间[ms];指令位置[mm];实际位置[mm];转矩[%]", 1e3, 1e3, 30, "utf-8-sig", ""),
    "Shift JIS": ("時間[ms];指令位置[mm];実位置[mm];トルク[Nm]", 1e3, 1e3, 1, "shift_jis", "reference_position_m"),
    "inches": ("Time (s);Commanded position (in);Actual position (in);Torque (oz-in)", 1, 1 / 0.0254, 142, "utf-8", ""),
    "units behind commas": ("Time, s;Setpoint, mm;Position, mm;Torque, Nm", 1, 1e3, 1, "utf-8", ""),
    "units as last words": ("Time ms;Set Position mm;Act Position mm;Motor Torque Nm", 1e3, 1e3, 1, "utf-8", ""),
    "a name of no meaning": ("stamp;w;pos [mm];torque", 1, 1e3, 1, "utf-8", "reference_position_m"),
    "a force without a name": ("t;x_set [mm];x [mm];antrieb", 1, 1e3, 1, "utf-8", "motor_force_N"),
    "positions of no side": ("t;Position A [mm];Position B [mm];torque", 1, 1e3, 1, "utf-8", "reference_position_m"),
}


@pytest.mark.parametrize("case", ABROAD)
def test_logs_from_abroad(case: str, record: Record, tmp_path: Path) -> None:
    head, seconds, metres, newton_metres, encoding, guessed = ABROAD[case]
    names = ("time_s", "reference_position_m", "position_m", "motor_torque_Nm")
    columns = [
        factor * record[name] for name, factor in zip(names, (seconds, metres, metres, newton_metres), strict=True)
    ]
    rows = [";".join(f"{value:.9f}" for value in row) for row in zip(*columns, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join([head, *rows, ""]), encoding)
    result = run(tmp_path / "a.csv")
    assert result.exit_code == 0, result.output
    read = read_record(tmp_path / "a.toml")
    assert read.sampling_time_s == pytest.approx(1e-3)
    np.testing.assert_allclose(read["reference_position_m"], record["reference_position_m"], atol=1e-9)
    np.testing.assert_allclose(read["position_m"], record["position_m"], atol=1e-9)
    np.testing.assert_allclose(read["motor_force_N"], newton_metres * record["motor_torque_Nm"], atol=1e-9)
    assert re.findall(r"CHECK (reference_position_m|motor_force_N): .* a guess", result.output) == guessed.split()


def test_a_unit_that_is_unknown_is_said(record: Record, tmp_path: Path) -> None:
    steps = {name: np.round(1e7 * record[name]) for name in ("reference_position_m", "position_m")}
    columns = (record["time_s"], *steps.values(), record["motor_torque_Nm"])
    rows = [",".join(f"{value:.6f}" for value in row) for row in zip(*columns, strict=True)]
    head = "time [s],set position [counts],position [counts],torque [lbf-in]"
    (tmp_path / "a.csv").write_text("\n".join([head, *rows, ""]))
    result = run(tmp_path / "a.csv")
    assert result.exit_code == 0, result.output
    assert "in um: GUESS: by its range of 1.1e+06; 'counts' is not known here" in result.output
    assert "CHECK motor_force_N: its unit 'lbf-in' is not known here" in result.output
    assert "Counts of an encoder: write gain, what 1 is in m, in place of unit." in result.output
    mapping = tmp_path / "a.toml"
    mapping.write_text(mapping.read_text().replace('unit = "um"', "gain = 1e-7"))
    np.testing.assert_allclose(read_record(mapping)["position_m"], record["position_m"], atol=6e-8)


def test_times_as_text_are_named(record: Record, tmp_path: Path) -> None:
    rows = [f"5 h 6 min 7.{place:03},{place:.3f},{place**2:.3f}" for place in range(20)]
    (tmp_path / "a.csv").write_text("\n".join(["timestamp,position [mm],torque [Nm]", *rows, ""]))
    refused("the times in 'timestamp' are no numbers. Give the sampling time", tmp_path / "a.csv")


def test_what_is_proposed_can_be_typed(record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for folder, name in (("a folder (1)", "é.csv"), ("-b", "x;y.csv")):
        Path(folder).mkdir()
        log_writers.bracket_csv(record, Path(folder) / name)
        result = run("-o", folder, "--", Path(folder) / name)
        assert result.exit_code == 0, result.output
        *_, command = result.output.splitlines()
        program, sub, option, *files = shlex.split(command.removeprefix("Then: "))
        assert [program, sub, option] == ["fdbench", "diagnose", "--model"]
        assert all(Path(file).is_file() and not file.startswith("-") for file in files)


def test_values_that_are_no_numbers_are_gaps(record: Record, tmp_path: Path) -> None:
    position = np.array(record["position_m"])
    position[[900, 905]] = np.nan
    table(tmp_path / "a.csv", t=record["time_s"], q=position, F=record["motor_torque_Nm"])
    assert run(tmp_path / "a.csv").exit_code == 0
    np.testing.assert_array_equal(read_record(tmp_path / "a.toml")["position_m"], record["position_m"][906:])


def test_a_measured_axis_in_two_commands(tmp_path: Path) -> None:
    """EMPS (Janot, Gautier, Brunot 2019): names that say nothing, volts; mass 95.1 kg, asymmetry -36.9 N s/m known."""
    result = run(shared_file("data", "emps", "DATA_EMPS.mat"), "-o", tmp_path)
    assert result.exit_code == 0, result.output
    read = (tmp_path / "DATA_EMPS.toml").read_text()
    assert all(line in read for line in ('position_m = { from = "qm"', 'reference_position_m = { from = "qg"'))
    assert 'motor_force_N = { from = "vir", gain = 1.0 }' in read
    newtons_per_volt = 35.15065
    assert load_nominal(tmp_path / "model.toml").drive.mass_kg * newtons_per_volt == pytest.approx(95.1, rel=0.03)
    (tmp_path / "half.toml").write_text(read.replace("[record]", "[record]\nsamples = [0, 12400]"))  # quicker
    answer = diagnose(tmp_path / "model.toml", [tmp_path / "half.toml"]).answer
    first = max(answer.causes, key=lambda cause: cause.share)
    assert first.effect == "direction_dependent_friction"
    assert first.probability > 0.5
    asymmetry = first.parameters["viscous_asymmetry_N_s_per_m"].value * newtons_per_volt
    assert asymmetry == pytest.approx(-36.9, rel=0.25)


# ---- bad files ----

CUTS = {
    "trace.xml": (log_writers.sinumerik, "not valid XML.*The file was cut there"),
    "scope.csv": (log_writers.twincat, "The file was cut"),
    "trace.csv": (log_writers.codesys_trace, "The file was cut there: remove the line"),
    "hal.txt": (log_writers.halsampler, "The file was cut there: remove the line|numbers, the first row"),
    "a.mf4": (log_writers.mdf, "not an MDF file, or a damaged one"),
    "a.mcap": (log_writers.mcap_json, "not an MCAP file, or a damaged one"),
    "bag/bag.db3": (log_writers.ros2_bag, "not a ROS 2 bag, or a damaged one"),
}


@pytest.mark.parametrize("name", CUTS)
def test_cut_files_are_said_to_be(name: str, record: Record, tmp_path: Path) -> None:
    write, words = CUTS[name]
    log = tmp_path / name
    write(record.slice(0, 400), log)
    content = log.read_bytes()
    log.write_bytes(content[: len(content) * 3 // 5])
    refused(words, log)
    assert not [*log.parent.glob("*.toml")]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.xml", b"", "the file is empty"),
        ("a.xml", b"<other/>", "records are not read from '.xml' files"),
        ("a.xml", b"<traceSession>" + b"<a>" * 100_000, "not valid XML"),
        ("a.xml", b"<!DOCTYPE x [<!ENTITY a 'b'>]><traceSession/>", "a document type"),
        ("a.xml", b"<traceSession></traceSession>", "without values"),
        ("a.xml", b"<traceSession><rec time='0' f1='2'/></traceSession>", "has no or an unknown f1"),
        ("a.csv", b"Name\tx\nFile\ty\nName\tch\nSampleTime[ms]\t1\n\n0\tx\n", "line 6: 'x' is not a number"),
        ("a.csv", b"[key]; [value]\nFlags; 16\n0.Variable; x\n0.Data; \n", "a trace without samples"),
        ("a.csv", b"[key]; [value]\nFlags; 16\n; 2; 1.5\n", "line 3: '; 2; 1.5' is no sample"),
        ("a.csv", b"[key]; [value]\nFlags; 16\n0.Data; \n; x; 1.5\n", "line 4: '; x; 1.5' is no sample"),
        ("a.csv", b"[key]; [value]\nFlags; 4\n0.Data; \n; 2; 1.5\n", "Flags is '4', which says neither"),
        (
            "a.csv",
            b"[key]; [value]\nFlags; " + b"9" * 5000 + b"\n0.Data; \n; 2; 1\n",
            "Flags is '99999999999999999999', w",
        ),
        ("a.csv", b"Name,x\nFile,y\nName,ch\nSampleTime[ms],1\n", "cells between ','"),
        ("a.txt", b"1.0 2.0 \n1.0 2.0 \n1.0 2.0 \n1.0 x \n", "line 1 holds 2 numbers, but no line above it as many n"),
        (
            "a.txt",
            b"run 7 12\nelapsed time x\n" + b"0.1 2.0\n" * 3,
            "Between blanks a name is one word, or one in quotes",
        ),
        ("a.csv", b"some words\n", "no table of samples"),
        ("a.csv", b"1,2\n3,4\n", "no line above it as many names"),
        ("a.mcap", b"\x89MCAP0\r\nxx", "not an MCAP file"),
        ("a.db3", b"SQLite format 3\x00", "no metadata.yaml beside it"),
        ("a.mf4", b"MDF     4.10", "not an MDF file"),
        ("a.bin", b"\x00\x01", "records are not read from '.bin' files"),
    ],
)
def test_bad_files_get_one_message(name: str, content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    refused(words, tmp_path / name)


def test_a_missing_package_is_named_with_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "a.mf4").write_bytes(b"MDF     4.10")
    with pytest.raises(RecordError, match=r"package asammdf, which is not installed.* pip install 'fdbench\[logs\]'"):
        formats.get("mdf")().read(tmp_path / "a.mf4", {"x"})


def test_logs_need_a_mapping(record: Record, tmp_path: Path) -> None:
    log_writers.halsampler(record, tmp_path / "hal.txt")
    with pytest.raises(
        RecordError, match=r"format halsampler need a mapping file; `fdbench import hal.txt` writes one"
    ):
        read_record(tmp_path / "hal.txt")
