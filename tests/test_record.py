import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from conftest import REPOSITORY, shared_file
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from fdbench.errors import FdbenchError, MissingData, RecordError, SpecError, UnknownName
from fdbench.reading import measured_file, read_mapped, read_record
from fdbench.record import COLUMNS, Record, held_samples

TIME = [0.0, 0.001, 0.002, 0.003]


def build(columns: dict[str, Any], provenance: dict[str, Any] | None = None, source: str = "test") -> Record:
    return Record(columns, provenance or {}, source)


def record(**columns: Any) -> Record:
    return build({"time_s": TIME, "position_m": [1.0, 2.0, 3.0, 5.0], **columns}, {"seed": 1}, "test")


def bits(array: NDArray[np.float64]) -> list[int]:
    return [int(word) for word in array.view(np.int64)]


def message(error: type[Exception], call: Any, *arguments: Any) -> str:
    with pytest.raises(error) as caught:
        call(*arguments)
    return str(caught.value)


# ---- the class ----


def test_columns_are_read_only_copies() -> None:
    values = np.array([1.0, 2.0, 3.0, 4.0])
    kept = record(motor_force_N=values)
    values[0] = 9.0
    assert kept["motor_force_N"][0] == 1.0
    for one in (kept, pickle.loads(pickle.dumps(kept))):
        assert one == kept
        with pytest.raises(ValueError, match="read-only"):
            one["position_m"][0] = 0.0
        with pytest.raises(ValueError, match="WRITEABLE"):
            one["position_m"].flags.writeable = True
        with pytest.raises(TypeError, match="item assignment"):
            one.columns["position_m"] = values  # type: ignore[index]
        assert np.shares_memory(one["position_m"], one.columns["position_m"])


def test_is_a_mapping() -> None:
    one = record()
    assert list(one) == ["time_s", "position_m"]
    assert len(one) == 2
    assert "velocity_m_per_s" not in one
    assert one.get("velocity_m_per_s") is None
    assert "Did you mean position_m?" in message(UnknownName, lambda: one["positon_m"])
    assert one != record(position_m=[1.0, 2.0, 3.0, 4.0])
    assert one != record(force_N=[1.0, 2.0, 3.0, 4.0])


def test_slice_keeps_names_and_provenance() -> None:
    part = record().slice(1, 4)
    assert list(part) == ["time_s", "position_m"]
    assert part["position_m"].tolist() == [2.0, 3.0, 5.0]
    assert part.provenance == {"seed": 1}
    assert part.sampling_time_s == pytest.approx(1e-3, rel=1e-12)
    assert "0 <= start < stop <= 4" in message(RecordError, record().slice, 1, 5)
    assert "at least 3" in message(RecordError, record().slice, 1, 3)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"position_m": [1.0, 2.0]}, ["position_m", "shape (2,)", "(4,)"]),
        ({"position_m": [[1.0]] * 4}, ["shape (4, 1)"]),
        ({"position_m": ["1", "2", "3", "4"]}, ["position_m", "not real numbers"]),
        ({"position_m": [1j, 2.0, 3.0, 4.0]}, ["complex", "not real numbers"]),
        ({"position_m": [1.0, 2.0, np.nan, 4.0]}, ["position_m is nan at sample 2", "1 of 4"]),
        ({"position_m": [1.0, -np.inf, 3.0, np.inf]}, ["position_m is -inf at sample 1", "2 of 4"]),
    ],
)
def test_faulty_columns(columns: dict[str, Any], words: list[str]) -> None:
    text = message(RecordError, lambda: record(**columns))
    assert all(word in text for word in ["test", *words]), text


def test_time_is_needed() -> None:
    assert "Did you mean time_s?" not in message(RecordError, Record, {"position_m": TIME})
    assert "time_s is missing" in message(RecordError, Record, {"position_m": TIME})
    assert "sampling_time_s" in message(RecordError, Record, {"position_m": TIME})


# ---- names ----


def test_known_columns_are_accepted_with_and_without_an_axis() -> None:
    for name in COLUMNS:
        values = TIME if name == "time_s" else [0.0, 1.0, 0.0, 1.0]
        assert name in build({"time_s": TIME, name: values})
        if name != "time_s":
            assert f"x_{name}" in record(**{f"x_{name}": values, f"y_{name}": values})


@pytest.mark.parametrize(
    "name",
    [
        *("z_position_m", "tool_position_m", "motor2_position_m", "rotor_torque_Nm", "oil_pressure_Pa"),
        *("housing_acceleration_m_per_s2", "velocity_command_m_per_s", "y_probe_displacement_m"),
    ],
)
def test_extra_columns_with_a_unit_are_kept(name: str) -> None:
    assert name in record(**{name: [0.0, 1.0, 2.0, 3.0]})


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("velocity_mm_per_s", "velocity_m_per_s"),
        ("velocty_m_per_s", "velocity_m_per_s"),
        ("x_velocty_m_per_s", "x_velocity_m_per_s"),
        ("tabel_position_m", "table_position_m"),
        ("Position_m", "position_m"),
        ("position", "position_m"),
        ("position_mm", "position_m"),
        ("motor_torque_nm", "motor_torque_Nm"),
        ("motor_torque_N", "motor_torque_Nm"),
        ("y_motor_torque_N", "y_motor_torque_Nm"),
        ("velocity_m", "velocity_m_per_s"),
        ("V", "allowed"),
        ("spindle speed", "spindle_speed_rad_per_s"),
        ("tooth_count", "held_sample"),
    ],
)
def test_other_names_are_errors(name: str, nearest: str) -> None:
    text = message(RecordError, lambda: record(**{name: [0.0, 1.0, 2.0, 3.0]}))
    assert "test" in text
    assert f"'{name}'" in text
    assert nearest in text or nearest == "allowed"
    assert f'mapping file can rename and convert it: [columns] name = {{ from = "{name}"' in text


# ---- the clock ----


@pytest.mark.parametrize(
    "time",
    [
        np.round(np.arange(2000) / 333.0, 6),
        np.round(np.arange(2000) / 3000.0, 6),
        1.7e9 + np.arange(2000) / 8000.0,
        (np.arange(20000) * 1e-3).astype(np.float32),
        np.cumsum(1e-3 * (1.0 + 5e-4 * np.sin(np.arange(5000) / 100.0))),
        np.arange(2000) * 1e-3 + np.random.default_rng(1).uniform(-2e-7, 2e-7, 2000),
    ],
    ids=["rounded", "rounded coarsely", "seconds since 1970", "single precision", "slow drift", "jitter"],
)
def test_clocks_that_pass(time: NDArray[np.float64]) -> None:
    assert Record({"time_s": time}).n_samples == len(time)


@pytest.mark.parametrize(
    ("time", "words"),
    [
        ([0.0, 1.0], ["2 samples", "at least 3"]),
        ([], ["0 samples"]),
        ([0.0, 1.0, 1.0, 2.0], ["does not increase at sample 2", "from 1.0 s to 1.0 s"]),
        ([0.0, 1.0, 2.0, 0.0, 1.0], ["does not increase at sample 3", "joined"]),
        ([0.0, 1.0, 2.0, 6.0, 7.0, 9.0, 10.0, 11.0], ["jumps at sample 3", "3 samples of 1 s", "2 jumps in all"]),
        (
            [0.0, 1.0, 2.0, 3.011, 4.0, 5.0],
            ["not uniform at sample 3", "0.011 of the sampling time", "sampling_time_s"],
        ),
        (np.arange(2000) * 1e-3 + np.random.default_rng(1).uniform(-1e-5, 1e-5, 2000), ["not uniform"]),
        (np.round(np.arange(2000) / 333.0, 3), ["not uniform"]),
        (np.cumsum(np.r_[np.full(50, 1e-3), np.full(50, 1.01e-3)]), ["not uniform at sample"]),
    ],
)
def test_clocks_that_fail(time: Any, words: list[str]) -> None:
    text = message(RecordError, Record, {"time_s": time}, {}, "clock")
    assert all(word in text for word in ["clock", "time_s" if len(time) > 2 else "samples", *words]), text


# ---- held samples ----


def test_held_samples() -> None:
    columns = {"time_s": TIME, "reference_position_m": TIME, "position_m": [0.0, 0.0, 1.0, 1.0]}
    both = build({**columns, "motor_force_N": [5.0, 5.0, 6.0, 7.0]})
    assert held_samples(both).tolist() == [False, True, False, False]
    assert held_samples(build(columns)).tolist() == [False, True, False, True]
    assert held_samples(build({**columns, "held_sample": [0.0, 0.0, 0.0, 1.0]})).tolist() == [False] * 3 + [True]
    assert not held_samples(build({"time_s": TIME, "x_reference_position_m": [1.0] * 4})).any()


# ---- round trips ----

FLOATS = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=True)
NAMES = st.sampled_from([*sorted(set(COLUMNS) - {"time_s", "held_sample"}), "y_force_N", "oil_pressure_Pa"])
JSON = st.recursive(st.none() | st.booleans() | st.integers() | FLOATS | st.text(), lambda x: st.lists(x), max_leaves=4)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), n=st.integers(3, 12), suffix=st.sampled_from([".csv", ".parquet"]))
def test_round_trip_is_exact(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, n: int, suffix: str
) -> None:
    names = data.draw(st.lists(NAMES, unique=True, max_size=4))
    columns = {name: np.array(data.draw(st.lists(FLOATS, min_size=n, max_size=n))) for name in names}
    step = data.draw(st.floats(1e-5, 1.0))
    provenance = data.draw(st.dictionaries(st.text(), JSON, max_size=3))
    before = build({"time_s": step * np.arange(n), **columns}, provenance)
    path = tmp_path_factory.mktemp("round_trip") / f"record{suffix}"
    before.save(path)
    after = read_record(path)
    assert list(after) == list(before)
    assert all(bits(after[name]) == bits(before[name]) for name in before)
    if provenance:
        assert after.provenance == provenance
    else:
        assert after.provenance["file"] == path.name


@pytest.mark.parametrize("value", [-0.0, 5e-324, -2.2250738585072009e-308, 1.7976931348623157e308, 0.1, 1e22, 1 / 3])
def test_numbers_that_are_easily_lost(tmp_path: Path, value: float) -> None:
    for suffix in (".csv", ".parquet"):
        record(force_N=[value] * 4).save(tmp_path / f"a{suffix}")
        assert bits(read_record(tmp_path / f"a{suffix}")["force_N"]) == bits(np.array([value] * 4))


def test_other_tools_read_our_files(tmp_path: Path) -> None:
    record(force_N=[0.1, 0.2, 0.3, -0.4]).to_csv(tmp_path / "a.csv")
    record().to_parquet(tmp_path / "a.parquet")
    assert (tmp_path / "a.csv").read_text().startswith('# fdbench {"seed": 1}\ntime_s,position_m,force_N\n0,1,0.1\n')
    table = pandas.read_csv(tmp_path / "a.csv", comment="#")
    assert table.columns.tolist() == ["time_s", "position_m", "force_N"]
    assert table["force_N"].tolist() == [0.1, 0.2, 0.3, -0.4]
    assert pandas.read_parquet(tmp_path / "a.parquet")["position_m"].tolist() == [1.0, 2.0, 3.0, 5.0]


def test_writing_faults(tmp_path: Path) -> None:
    assert "Did you mean .parquet" in message(RecordError, record().save, tmp_path / "a.paruet")
    assert "no_folder" in message(RecordError, record().save, tmp_path / "no_folder" / "a.csv")
    assert "no_folder" in message(RecordError, record().save, tmp_path / "no_folder" / "a.parquet")
    odd = build({"time_s": TIME}, {"seed": object()})
    assert "provenance cannot be written" in message(RecordError, odd.save, tmp_path / "a.csv")
    assert not (tmp_path / "a.csv").exists()


# ---- CSV ----


@pytest.mark.parametrize(
    "text",
    [
        "time_s,position_m\n0,1\n1,2\n2,4\n",
        "# a comment\r\n\r\ntime_s, position_m \r\n0,1\r\n\r\n1, +2.0e0\r\n2,4",
        '\ufeff"time_s","position_m"\n"0","1"\n1,2\n2,4\n\n',
    ],
    ids=["plain", "comment, blank lines, CRLF", "byte order mark, quotes"],
)
def test_csv_dialects(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_bytes(text.encode())
    read = read_record(tmp_path / "a.csv")
    assert read["position_m"].tolist() == [1.0, 2.0, 4.0]
    assert read.provenance["file"] == "a.csv"
    assert len(read.provenance["sha256"]) == 64


HEADER = "time_s,position_m\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["empty"]),
        ("# fdbench {}\n\n", ["empty"]),
        (HEADER, ["0 samples", "at least 3"]),
        (HEADER + "0,1\n1,2\n", ["2 samples", "at least 3"]),
        (HEADER + "0,1\n\n1,\n2,4\n", ["line 4", "position_m", "empty"]),
        (HEADER + '0,1\n1,""\n2,4\n', ["line 3", "position_m", "empty"]),
        (HEADER + "0,1\n\n1,nan\n2,4\n", ["position_m is nan at sample 1 (line 4)"]),
        (HEADER + "0,1\n1,2\n2,-Inf\n", ["position_m is -inf at sample 2 (line 4)"]),
        (HEADER + "0,1\n1,2\n2,1e999\n", ["position_m is inf at sample 2 (line 4)"]),
        (HEADER + "0,1\n1,off\n2,4\n", ["line 3", "position_m", "'off' is not a number"]),
        (HEADER + "0,1\n1,N/A\n2,4\n", ["line 3", "position_m", "'N/A' is not a number"]),
        (HEADER + "s,mm\n0,1\n1,2\n2,4\n", ["line 2", "time_s", "'s' is not a number", "line of units"]),
        (HEADER + '0,"1,5"\n1,2\n2,4\n', ["line 2", "'1,5'", 'decimal = ","']),
        (HEADER + "0,1\n1,2\n" + HEADER + "0,1\n", ["line 4 repeats the names"]),
        (HEADER + "0,1\n1\n2,4\n", ["line 3 has 1 cells, the header has 2"]),
        (HEADER + "0,0,1,5\n1,0,2,5\n", ["line 2 has 4 cells, the header has 2", "decimal commas"]),
        (HEADER + "0,1\n1,2\n1,3\n2,4\n", ["does not increase at sample 2 (line 4)", "from 1.0 s to 1.0 s"]),
        (HEADER + "0,1\n1,2\n2,3\n7,4\n", ["jumps at sample 3 (line 5)", "4 samples"]),
        ("time_s;position_m\n0;1,5\n", ["line 1", "';'", 'delimiter = ";"', 'decimal = ","']),
        ("time_s\tposition_m\n0\t1\n", ['delimiter = "\\t"']),
        ("time_s  position_m\n 0.0  1.0\n", ["line 1", 'delimiter = " "']),
        ("time_s,position_m,position_m\n0,1,1\n", ["two columns are named 'position_m'"]),
        ("time_s,velocity_mm_per_s\n0,1\n", ["'velocity_mm_per_s'", "Did you mean velocity_m_per_s", "mapping"]),
        ("time_s,velocty_m_per_s\n0,1\n", ["'velocty_m_per_s'", "Did you mean velocity_m_per_s", "mapping"]),
        (",time_s\n0,0\n", ["no name", "pandas", "index=False"]),
        ("0,1\n1,2\n2,4\n", ["line 1 holds numbers", "names"]),
        ("position_m,force_N\n1,1\n2,2\n4,4\n", ["time_s is missing", "sampling_time_s"]),
        ("# fdbench {seed\n" + HEADER, ["provenance", "damaged"]),
        ("# fdbench 3\n" + HEADER, ["provenance"]),
        ("PK\x03\x04\x14\x00,\x1b[2J\n" + HEADER, ["a ZIP archive or an Excel workbook"]),
        ("\x02\x03\x04\x14\x00,\x1b[2J\n" + HEADER, ["line 1 holds control characters: a binary file"]),
        ("time_s,\x9bposition_m\n", ["line 1 holds control characters"]),
        (HEADER + "0,\x1b[2J\n", ["line 2", r"'\x1b[2J' is not a number"]),
        (HEADER + "0," + "x" * 1000 + "\n", ["line 2", "'" + "x" * 60 + "...' is not a number"]),
        ("x" * 1000 + "\n", ["line 1 holds 1000 characters where the name"]),
        ("x" * 200_000 + "\n", ["no CSV file: field larger than field limit"]),
    ],
)
def test_csv_faults(tmp_path: Path, text: str, words: list[str]) -> None:
    (tmp_path / "run.csv").write_text(text)
    caught = message(RecordError, read_record, tmp_path / "run.csv")
    assert all(word in caught for word in ["run.csv", *words]), caught
    assert caught.isprintable()
    assert len(caught) < 1000


def test_other_encodings_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s,Temperatur °C\n0,1\n", encoding="latin-1")
    assert "line 1 is not UTF-8" in message(RecordError, read_record, tmp_path / "a.csv")
    (tmp_path / "b.csv").write_bytes((HEADER + "0,1\n").encode("utf-16-le"))
    assert "UTF-16 without a byte order mark" in message(RecordError, read_record, tmp_path / "b.csv")


# ---- files ----


def test_file_faults(tmp_path: Path) -> None:
    (tmp_path / "run_17.csv").write_text("")
    assert "Nearest in that folder: run_17.csv" in message(RecordError, read_record, tmp_path / "run_71.csv")
    assert "Nearest in that folder: run_17.csv" in message(RecordError, read_record, tmp_path / "axis.toml")
    assert "folder" in message(RecordError, read_record, tmp_path / "no" / "run.csv")
    (tmp_path / "a.csv").mkdir()
    assert "a folder, not a file" in message(RecordError, read_record, tmp_path / "a.csv")
    (tmp_path / "a.unknown").write_text("x")
    assert "Allowed: .bag, .csv, " in message(RecordError, read_record, tmp_path / "a.unknown")
    assert "mapping files" in message(RecordError, read_record, tmp_path / "run_17.csv", tmp_path)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"position_m": [1.0, None, 3.0]}, ["position_m has 1 empty cells", "sample 1"]),
        ({"position_m": ["1", "two", "3"]}, ["position_m holds", "not numbers", "'two'"]),
        ({"position_m": [True, False, True]}, []),
        ({"position_m": [1, 2, 4]}, []),
        ({"position_m": np.array([1, 2, 4], dtype=np.float32)}, []),
        ({"positon_m": [1.0, 2.0, 3.0]}, ["Did you mean position_m"]),
        ({"load_position_rad": [1.0, 2.0, 3.0]}, ["Did you mean table_position_rad"]),
        ({"scale_position_m": [1.0, 2.0, 3.0]}, ["Did you mean table_position_m"]),
        ({"position_m": pandas.to_datetime(["2020-01-01"] * 3)}, ["position_m holds times of day", "only time_s"]),
    ],
)
def test_parquet_of_others(tmp_path: Path, columns: dict[str, Any], words: list[str]) -> None:
    path = tmp_path / "run.parquet"
    pandas.DataFrame({"time_s": [0.0, 1.0, 2.0], **columns}).to_parquet(path)
    if words:
        caught = message(RecordError, read_record, path)
        assert all(word in caught for word in ["run.parquet", *words]), caught
    else:
        assert read_record(path)["position_m"].tolist() == [float(value) for value in columns["position_m"]]


def test_damaged_parquet(tmp_path: Path) -> None:
    (tmp_path / "a.parquet").write_text("no such thing")
    assert "not a Parquet file" in message(RecordError, read_record, tmp_path / "a.parquet")


def test_mat_as_it_is(tmp_path: Path) -> None:
    savemat(
        tmp_path / "a.mat",
        {"time_s": np.arange(3.0)[:, None], "force_N": np.array([4, 5, 6], dtype=np.int16), "gain": 2.5},
    )
    read = read_record(tmp_path / "a.mat")
    assert list(read) == ["time_s", "force_N"]
    assert read["force_N"].tolist() == [4.0, 5.0, 6.0]
    assert read.provenance["scalars"] == {"gain": 2.5}
    assert read.provenance["file"] == "a.mat"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"q": np.arange(3.0)}, ["no column 'qm'", "The file has: t, q. Did you mean q?"]),
        ({"qm_1": np.arange(3.0)}, ["no column 'qm'", "Did you mean qm_1?"]),
        ({"qm": np.arange(3.0) * 1j}, ["qm", "complex numbers"]),
        ({"qm": np.ones((3, 2))}, ["qm is a matrix of 3 x 2 without names"]),
        ({"qm": "text"}, ["qm", "text"]),
        ({"qm": {"a": 1.0}}, ["no column 'qm'", "Did you mean qm.a?"]),
        ({"qm": np.array([1, "a"], dtype=object)}, ["qm", "cells"]),
        ({"qm": np.arange(2.0)}, ["position_m has shape (2,)"]),
        ({"qm": np.array([0.0, np.nan, 1.0])}, ["qm is nan at sample 1"]),
    ],
)
def test_mat_faults(tmp_path: Path, content: dict[str, Any], words: list[str]) -> None:
    savemat(tmp_path / "a.mat", {"t": np.arange(3.0), **content})
    columns = {"time_s": {"from": "t"}, "position_m": {"from": "qm"}}
    caught = message(RecordError, read_mapped, {"record": {"file": "a.mat"}, "columns": columns}, tmp_path, "test")
    assert all(word in caught for word in ["a.mat", *words]), caught


def test_foreign_mat_files(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(500))
    assert "version 7.3" in message(RecordError, read_record, tmp_path / "a.mat")
    (tmp_path / "b.mat").write_bytes(b"x" * 500)
    assert "not a MAT file" in message(RecordError, read_record, tmp_path / "b.mat")
    savemat(tmp_path / "c.mat", {"t": np.arange(3.0)})
    assert "unknown column 't'" in message(RecordError, read_record, tmp_path / "c.mat")


# ---- mappings ----

GERMAN = "Zeit [ms];Weg [mm];Strom [mA];Modus\n0,0;1,5;100;an\n0,5;2,5;200;aus\n1,0;-3,5;400;an\n"
MAPPING: dict[str, dict[str, Any]] = {
    "record": {"file": "run.csv", "delimiter": ";", "decimal": ","},
    "columns": {
        "time_s": {"from": "Zeit [ms]", "unit": "ms"},
        "position_m": {"from": "Weg [mm]", "unit": "mm"},
        "table_position_m": {"from": "Weg [mm]", "unit": "mm", "gain": -1.0, "offset": 1.0},
        "motor_force_N": {"from": "Strom [mA]", "unit": "mA", "gain": 50.0},
    },
}


def changed(table: str, **entries: Any) -> dict[str, Any]:
    """Return ``MAPPING`` with other entries in a table; None takes one out."""
    merged = {**MAPPING[table], **entries}
    return {**MAPPING, table: {key: value for key, value in merged.items() if value is not None}}


def test_mapping_of_a_foreign_csv(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text(GERMAN)
    read = read_mapped(MAPPING, tmp_path, "test")
    assert read["time_s"].tolist() == [0.0, 0.0005, 0.001]
    assert read["position_m"].tolist() == [0.0015, 0.0025, -0.0035]
    assert read["table_position_m"].tolist() == [0.9985, 0.9975, 1.0035]
    assert read["motor_force_N"].tolist() == pytest.approx([5.0, 10.0, 20.0], rel=1e-15)
    assert read.provenance["left_out"] == ["Modus"]
    assert read.provenance["mapping"] == MAPPING["columns"]
    read.save(tmp_path / "converted.csv")
    assert read_record(tmp_path / "converted.csv") == read


def test_mapping_takes_one_column_from_another(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t,set,lag,clock\n0,10,1,10:00:00\n1,12,-2,10:00:01\n2,14,4,10:00:02\n")

    def read(**keys: str) -> Record:
        columns = {"time_s": {"from": "t"}, "position_m": {"from": "set", "unit": "mm", "gain": 2.0, **keys}}
        return read_mapped({"record": {"file": "run.csv"}, "columns": columns}, tmp_path, "axis.toml")

    assert read(minus="lag")["position_m"].tolist() == pytest.approx([0.018, 0.028, 0.02], abs=1e-15)
    assert "no column 'lags'" in message(RecordError, lambda: read(minus="lags"))
    assert "holds times of day" in message(RecordError, lambda: read(minus="clock"))


def test_mapping_puts_right_what_is_read_late(tmp_path: Path) -> None:
    time = np.arange(50) * 0.002
    position = 0.1 * time**2
    record = {"time_s": time, "position_m": position, "table_position_m": 0.1 * np.maximum(time - 0.004, 0.0) ** 2}
    build({**record, "motor_force_N": np.gradient(position)}).save(tmp_path / "run.csv")

    def read(**late_s: float) -> Record:
        columns = {name: {"from": name, "late_s": late_s.get(name, 0.0)} for name in (*record, "motor_force_N")}
        return read_mapped({"record": {"file": "run.csv"}, "columns": columns}, tmp_path, "axis.toml")

    late = read(table_position_m=0.004)
    assert late["time_s"].tolist() == time[:-2].tolist()
    assert late["position_m"].tolist() == position[:-2].tolist()
    assert late["table_position_m"] == pytest.approx(position[:-2], abs=1e-15)
    between = read(table_position_m=0.003)
    assert between["table_position_m"] == pytest.approx(0.1 * np.maximum(between["time_s"] - 0.001, 0.0) ** 2, abs=2e-7)
    early = read(position_m=-0.001, motor_force_N=0.002)
    assert early["time_s"].tolist() == time[1:-1].tolist()
    assert early["position_m"] == pytest.approx(0.1 * (time[1:-1] - 0.001) ** 2, abs=1e-6)
    assert read() == read_record(tmp_path / "run.csv")
    for name, late_s, words in (
        ("position_m", 0.2, "late_s is 0.2, and the record lasts 0.1 s"),
        ("time_s", 0.1, "of"),
    ):
        assert words in message(SpecError, lambda name=name, late_s=late_s: read(**{name: late_s}))


def test_mapping_without_a_time_column(tmp_path: Path) -> None:
    (tmp_path / "run.txt").write_text("q\n1\n2\n4\n")
    (tmp_path / "axis.toml").write_text(
        '[record]\nfile = "run.txt"\nformat = "csv"\nsampling_time_s = 0.25\n[columns]\nposition_m = { from = "q" }\n'
    )
    assert read_record(tmp_path / "axis.toml")["time_s"].tolist() == [0.0, 0.25, 0.5]


def test_mapping_file_and_data_in_two_folders(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    record().save(tmp_path / "data" / "run.csv")
    (tmp_path / "axis.toml").write_text(
        '[record]\nfile = "run.csv"\n[columns]\ntime_s = { from = "time_s" }\nforce_N = { from = "position_m" }\n'
    )
    read = read_record(tmp_path / "axis.toml", data_folder=tmp_path / "data")
    assert read["force_N"].tolist() == [1.0, 2.0, 3.0, 5.0]
    assert read.provenance["seed"] == 1
    assert "no such file" in message(RecordError, read_record, tmp_path / "axis.toml")


def test_mapping_keeps_the_bits_of_what_it_does_not_convert(tmp_path: Path) -> None:
    record(force_N=[-0.0, 5e-324, 1.0, 2.0]).save(tmp_path / "run.parquet")
    columns = {"time_s": {"from": "time_s"}, "process_force_N": {"from": "force_N", "unit": "N"}}
    read = read_mapped({"record": {"file": "run.parquet"}, "columns": columns}, tmp_path, "test")
    assert bits(read["process_force_N"]) == bits(np.array([-0.0, 5e-324, 1.0, 2.0]))


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({**MAPPING, "colums": {}}, ["unknown key 'colums'", "Did you mean columns?"]),
        ({"columns": {}}, ["'record' is missing"]),
        ({"record": MAPPING["record"]}, ["'columns' is missing"]),
        ({**MAPPING, "columns": 3}, ["'columns' is 3", "a table"]),
        (changed("record", delimeter=";"), ["[record]", "unknown key 'delimeter'", "Did you mean delimiter?"]),
        (changed("record", file=None), ["[record]", "'file' is missing"]),
        (changed("record", file=3), ["'file' is 3", "a text"]),
        (changed("record", format="cvs"), ["unknown format 'cvs'", "Did you mean csv?"]),
        (changed("record", format="mat"), ["delimiter and decimal belong to CSV"]),
        (changed("record", delimiter=";;"), ["delimiter is ';;'", "one character"]),
        (changed("record", delimiter=","), ["delimiter is ','", "another one"]),
        (changed("record", decimal="'"), ["decimal"]),
        (changed("record", sampling_time_s=0.1), ["time_s", "sampling_time_s", "one of them"]),
        (changed("columns", time_s=None), ["time_s", "sampling_time_s", "one of them"]),
        ({"record": {"file": "run.csv", "sampling_time_s": 1.0}, "columns": {}}, ["one of them"]),
        (changed("columns", velocty_m_per_s={"from": "a"}), ["[columns]", "Did you mean velocity_m_per_s?"]),
        (changed("columns", velocity_mm_per_s={"from": "a"}), ["[columns]", "Did you mean velocity_m_per_s?"]),
        (changed("columns", force_N="F"), ["[columns]: 'force_N' is 'F'", "a table"]),
        (changed("columns", force_N={}), ["[columns] force_N", "'from' is missing"]),
        (changed("columns", force_N={"from": "F", "units": "N"}), ["unknown key 'units'", "Did you mean unit?"]),
        (changed("columns", force_N={"from": "F", "unit": "V"}), ["force_N", "'V' is a unit of V", "in N"]),
        (changed("columns", force_N={"from": "F", "unit": "Vt", "gain": 2}), ["unknown unit 'Vt'"]),
        (changed("columns", force_N={"from": "F", "gain": 0}), ["gain is 0"]),
        (changed("columns", force_N={"from": "F", "gain": "2"}), ["'gain' is '2'", "finite number"]),
        (changed("columns", force_N={"from": "F", "offset": True}), ["'offset' is True"]),
        (changed("columns", force_N={"from": "F", "offset": float("nan")}), ["'offset' is nan"]),
    ],
)
def test_mapping_is_read_strictly(tmp_path: Path, mapping: dict[str, Any], words: list[str]) -> None:
    (tmp_path / "run.csv").write_text(GERMAN)
    caught = message(SpecError, read_mapped, mapping, tmp_path, "axis.toml")
    assert all(word in caught for word in ["axis.toml", *words]), caught


@pytest.mark.parametrize("sampling_time_s", [0.0, -1.0])
def test_sampling_time_is_positive(tmp_path: Path, sampling_time_s: float) -> None:
    record().save(tmp_path / "run.csv")
    mapping = {
        "record": {"file": "run.csv", "sampling_time_s": sampling_time_s},
        "columns": {"position_m": {"from": "position_m"}},
    }
    assert "allowed: > 0" in message(SpecError, read_mapped, mapping, tmp_path, "axis.toml")


def test_a_byte_order_mark_is_no_part_of_a_mapping(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1,2\n2,4\n")
    text = '[record]\nfile = "a.csv"\n[columns]\ntime_s = { from = "t" }\nposition_m = { from = "x" }\n'
    (tmp_path / "a.toml").write_text(text, "utf-8-sig")
    assert read_record(tmp_path / "a.toml")["position_m"].tolist() == [1.0, 2.0, 4.0]


def test_damaged_toml(tmp_path: Path) -> None:
    (tmp_path / "axis.toml").write_text("[record\n")
    assert "not valid TOML" in message(SpecError, read_record, tmp_path / "axis.toml")


def test_mapping_faults_in_the_data(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text(GERMAN.replace("2,5", "2.5"))
    assert 'decimal = "."' in message(RecordError, read_mapped, MAPPING, tmp_path, "axis.toml")
    (tmp_path / "run.csv").write_text(GERMAN.replace("2,5", "nan"))
    assert "Weg [mm] is nan at sample 1 (line 3)" in message(RecordError, read_mapped, MAPPING, tmp_path, "axis.toml")
    (tmp_path / "run.csv").write_text(GERMAN.replace("200", "1e308"))
    mapping = changed("columns", motor_force_N={"from": "Strom [mA]", "gain": 1e10})
    assert "motor_force_N is inf at sample 1" in message(RecordError, read_mapped, mapping, tmp_path, "axis.toml")


# ---- measured data ----


def test_measured_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("named", "user/fdbench", "home/.local/share/fdbench"):
        (tmp_path / folder / "emps").mkdir(parents=True)
        (tmp_path / folder / "emps" / "a.mat").write_text("x")
    monkeypatch.setenv("FDBENCH_DATA", str(tmp_path / "named"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "user"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert measured_file("emps/a.mat", "ask.") == tmp_path / "named" / "emps" / "a.mat"
    text = message(MissingData, measured_file, "emps/b.mat", "ask the authors.")
    assert all(word in text for word in ["named/emps/b.mat", "ask the authors.", "FDBENCH_DATA", "holds emps/b.mat"])
    monkeypatch.delenv("FDBENCH_DATA")
    assert measured_file("emps/a.mat", "ask.") == tmp_path / "user" / "fdbench" / "emps" / "a.mat"
    monkeypatch.delenv("XDG_DATA_HOME")
    assert measured_file("emps/a.mat", "ask.") == tmp_path / "home" / ".local/share/fdbench" / "emps" / "a.mat"


def test_emps() -> None:
    file = shared_file("data", "emps", "DATA_EMPS.mat")
    read = read_record(REPOSITORY / "examples" / "emps" / "emps.toml", data_folder=file.parent)
    raw = loadmat(file)
    assert read.n_samples == 24841
    assert read.sampling_time_s == pytest.approx(1e-3, rel=1e-9)
    assert np.array_equal(read["motor_force_N"], raw["vir"].ravel() * 35.15065)
    assert np.array_equal(read["motor_position_m"], raw["qm"].ravel())
    assert np.array_equal(read["position_m"], read["motor_position_m"])
    assert np.array_equal(read["reference_position_m"], raw["qg"].ravel())
    assert read["position_m"].max() == pytest.approx(0.246, abs=1e-3)
    assert read.provenance["left_out"] == ["gtau", "kp", "kv"]
    assert not held_samples(read).any()
    assert json.loads(json.dumps(read.provenance)) == read.provenance


def test_lines_above_the_header_are_found_or_skipped(tmp_path: Path) -> None:
    rows = "t,x\n0.0,1.0\n0.1,2.0\n0.2,3.0\n"
    file = tmp_path / "axis.csv"
    columns = {"time_s": {"from": "t"}, "position_m": {"from": "x"}}
    for above in ("The file has: Axis1\n", "The file has: Axis1\n\nmade by, a controller, 2024\n", ""):
        file.write_text(above + rows, "utf-8")
        read = read_mapped({"record": {"file": "axis.csv"}, "columns": columns}, tmp_path, "m.toml")
        assert read["position_m"].tolist() == [1.0, 2.0, 3.0]
    # Two cells above the header are as wide as the numbers: only skip_lines tells.
    file.write_text("axis,Axis1\n" + rows, "utf-8")
    with pytest.raises(RecordError, match="no column 't'"):
        read_mapped({"record": {"file": "axis.csv"}, "columns": columns}, tmp_path, "m.toml")
    settings = {"file": "axis.csv", "skip_lines": 1}
    read = read_mapped({"record": settings, "columns": columns}, tmp_path, "m.toml")
    assert read["time_s"].tolist() == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    ("value", "words"), [(-1, "skip_lines is -1; allowed"), ("1", "skip_lines is '1'"), (9, "empty")]
)
def test_skip_lines_is_checked(tmp_path: Path, value: object, words: str) -> None:
    (tmp_path / "axis.csv").write_text("t,x\n0.0,1.0\n", "utf-8")
    columns = {"time_s": {"from": "t"}, "position_m": {"from": "x"}}
    with pytest.raises(FdbenchError, match=words):
        read_mapped({"record": {"file": "axis.csv", "skip_lines": value}, "columns": columns}, tmp_path, "m.toml")


def test_a_preamble_that_cannot_be_told_is_said(tmp_path: Path) -> None:
    (tmp_path / "axis.csv").write_text("Axis1\nt,x\nnan?,1.0\n0.1,2.0,3.0\n", "utf-8")
    with pytest.raises(RecordError, match="skip_lines"):
        read_mapped({"record": {"file": "axis.csv"}, "columns": {"time_s": {"from": "Axis1"}}}, tmp_path, "m.toml")


def test_rotary_units_of_linear_columns_get_advice(tmp_path: Path) -> None:
    (tmp_path / "axis.csv").write_text("t,x\n0.0,0.0\n0.1,0.5\n0.2,1.0\n", "utf-8")

    def read(**position: object) -> Record:
        columns = {"time_s": {"from": "t"}, "position_m": {"from": "x", **position}}
        return read_mapped({"record": {"file": "axis.csv"}, "columns": columns}, tmp_path, "m.toml")

    for unit in ("rad", "deg", "rev"):
        with pytest.raises(FdbenchError, match=r"lead_m / 6\.2832.* rotary axis: name the columns position_rad"):
            read(unit=unit)
    np.testing.assert_allclose(read(unit="rev", gain=1.0)["position_m"], [0.0, np.pi, 2.0 * np.pi])
    columns = {"time_s": {"from": "t"}, "motor_force_N": {"from": "x", "unit": "N m"}}
    with pytest.raises(FdbenchError, match="motor_torque_Nm where the model has a rotary_motor"):
        read_mapped({"record": {"file": "axis.csv"}, "columns": columns}, tmp_path, "m.toml")
