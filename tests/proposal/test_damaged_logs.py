"""Logs with dates for times, doubled rows, holes and footers, in structs and compressed: read, or refused by line."""

import gzip
import re
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pandas
import pytest
from scipy.io import savemat
from typer.testing import CliRunner, Result

from fdbench import cli
from fdbench.errors import RecordError, SpecError
from fdbench.reading import read_mapped, read_record
from fdbench.record import Record
from fdbench.scenario import load_scenario

NAMES = "reference_position_m", "position_m", "motor_torque_Nm"
HEAD = "setpoint [m],position [m],torque [Nm]"
NOON, LATE = datetime(2026, 3, 12, 12), datetime(2026, 3, 12, 23, 59, 59, 500_000)


@pytest.fixture(scope="module")
def record() -> Record:
    return load_scenario("BallScrewAxis-v1").record(3).slice(0, 1500)


def rows_of(record: Record, times: Sequence[str]) -> list[str]:
    columns = [record[name] for name in NAMES]
    return [",".join([time, *(f"{value:.9f}" for value in row)]) for time, *row in zip(times, *columns, strict=True)]


def seconds(record: Record) -> list[str]:
    return [f"{time:.6f}" for time in record["time_s"]]


def write(file: Path, rows: Sequence[str], name: str = "time") -> None:
    file.write_text("\n".join([f"{name},{HEAD}", *rows, ""]))


def imported(file: Path) -> Result:
    result = CliRunner().invoke(cli.app, ["import", str(file)])
    assert result.exit_code == 0, result.output
    return result


def dated(start: datetime, write_stamp: Callable[[datetime], str], record: Record) -> list[str]:
    return [write_stamp(start + timedelta(microseconds=round(1e6 * time))) for time in record["time_s"]]


def in_milliseconds(pattern: str) -> Callable[[datetime], str]:
    return lambda stamp: stamp.strftime(pattern)[:-3]


STAMPS: dict[str, tuple[datetime, Callable[[datetime], str]]] = {
    "ISO in UTC": (LATE, lambda stamp: f"{stamp.isoformat(timespec='milliseconds')}Z"),
    "ISO with an offset": (NOON, lambda stamp: f"{stamp.isoformat()}+01:00"),
    "a blank between": (LATE, in_milliseconds("%Y-%m-%d %H:%M:%S.%f")),
    "German": (LATE, lambda stamp: f'"{in_milliseconds("%d.%m.%Y %H:%M:%S,%f")(stamp)}"'),
    "slashes": (NOON, in_milliseconds("%m/%d/%Y %H:%M:%S.%f")),
    "a time of day over midnight": (LATE, in_milliseconds("%H:%M:%S.%f")),
    "a colon before milliseconds": (NOON, in_milliseconds("%H:%M:%S:%f")),
}


@pytest.mark.parametrize("case", STAMPS)
def test_dates_and_times_of_day_are_seconds_from_the_first(case: str, record: Record, tmp_path: Path) -> None:
    start, write_stamp = STAMPS[case]
    write(tmp_path / "a.csv", rows_of(record, dated(start, write_stamp, record)), "timestamp")
    assert "'timestamp' holds times of day, taken as seconds from" in imported(tmp_path / "a.csv").output
    read = read_record(tmp_path / "a.toml")
    np.testing.assert_allclose(read["time_s"], record["time_s"] - record["time_s"][0], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(read["position_m"], record["position_m"], rtol=0.0, atol=6e-10)


def test_times_of_parquet_are_seconds_from_the_first(record: Record, tmp_path: Path) -> None:
    table = pandas.DataFrame({name: record[name] for name in NAMES})
    table["time"] = pandas.Series(dated(LATE, datetime.isoformat, record)).astype("datetime64[us]")
    table.to_parquet(tmp_path / "a.parquet")
    assert "'time' holds times of day" in imported(tmp_path / "a.parquet").output
    read = read_record(tmp_path / "a.toml")
    np.testing.assert_allclose(read["time_s"], record["time_s"] - record["time_s"][0], rtol=0.0, atol=1e-9)
    table["time"] = table["time"].dt.time
    table.to_parquet(tmp_path / "a.parquet")
    np.testing.assert_allclose(read_record(tmp_path / "a.toml")["time_s"], read["time_s"], rtol=0.0, atol=1e-9)


def mapped(folder: Path, **time: object) -> Record:
    columns = {"time_s": {"from": "time", **time}, "position_m": {"from": "position [m]"}}
    return read_mapped({"record": {"file": "a.csv"}, "columns": columns}, folder, "map")


def test_what_is_wrong_with_times_of_day_is_said(record: Record, tmp_path: Path) -> None:
    times = dated(NOON, in_milliseconds("%Y-%m-%d %H:%M:%S.%f"), record)
    write(tmp_path / "a.csv", rows_of(record, times))
    assert mapped(tmp_path, unit="s").sampling_time_s == pytest.approx(1e-3)
    with pytest.raises(SpecError, match=r"time_s: 'time' holds times of day.*leave out unit and gain"):
        mapped(tmp_path, unit="ms")
    columns = {"position_m": {"from": "time"}}
    with pytest.raises(RecordError, match=r"column time holds times of day; only time_s may hold such, not position_m"):
        read_mapped({"record": {"file": "a.csv", "sampling_time_s": 1e-3}, "columns": columns}, tmp_path, "map")
    times[700] = "2026-13-12 12:00:00.700"
    write(tmp_path / "a.csv", rows_of(record, times))
    with pytest.raises(RecordError, match=r"line 702, column time: '2026-13-12 12:00:00.700' is no time such as"):
        mapped(tmp_path)
    write(tmp_path / "a.csv", rows_of(record, dated(LATE, in_milliseconds("%d/%m/%Y %H:%M:%S.%f"), record)))
    assert mapped(tmp_path).sampling_time_s == pytest.approx(1e-3)  # the 13th is no month
    early = LATE - timedelta(days=2)
    write(tmp_path / "a.csv", rows_of(record, dated(early, in_milliseconds("%d/%m/%Y %H:%M:%S.%f"), record)))
    with pytest.raises(RecordError, match="whether the day or the month comes first cannot be told"):
        mapped(tmp_path)


def test_a_doubled_row_is_left_out_and_named(record: Record, tmp_path: Path) -> None:
    rows = rows_of(record, seconds(record))
    write(tmp_path / "a.csv", [*rows[:600], rows[599], *rows[600:]])
    said = imported(tmp_path / "a.csv").output
    assert "sample 600 (line 602) repeats the one before it, 1 in all: left out" in said
    assert "a.csv: csv, 1500 samples" in said
    read = read_record(tmp_path / "a.toml")
    assert read.provenance["repeated_rows_left_out"] == 1
    np.testing.assert_allclose(read["position_m"], record["position_m"], rtol=0.0, atol=6e-10)
    rows[900] = rows[900].rpartition(",")[0] + ",nan"
    write(tmp_path / "a.csv", [*rows[:600], rows[599], *rows[600:]])
    with pytest.raises(RecordError, match=r"\(line 903\)"):  # lines are those of the file
        read_record(tmp_path / "a.toml")


def test_rows_that_differ_at_one_time_stay(record: Record, tmp_path: Path) -> None:
    coarse = [f"{time:.2f}" for time in record["time_s"]]
    write(tmp_path / "a.csv", rows_of(record, coarse))
    with pytest.raises(RecordError, match="time_s does not increase at sample"):
        mapped(tmp_path)


def test_a_hole_is_said_by_line_and_column(record: Record, tmp_path: Path) -> None:
    rows = rows_of(record, seconds(record))
    rows[300] = rows[300].rpartition(",")[0] + ","
    write(tmp_path / "a.csv", rows)
    said = imported(tmp_path / "a.csv").output
    assert "'torque [Nm]' has no number at sample 300 (line 302), 1 in all: correct the log there" in said
    assert "samples: 301 to 1499 of 1500" in said
    assert read_record(tmp_path / "a.toml").n_samples == 1199
    (tmp_path / "b.toml").write_text(re.sub("samples = .*", "", (tmp_path / "a.toml").read_text()))
    with pytest.raises(RecordError, match=r"column torque \[Nm\] is nan at sample 300 \(line 302\)"):
        read_record(tmp_path / "b.toml")


@pytest.mark.parametrize("end", ["\n# end of recording\n", "% 1500 rows\n\n# end"])
@pytest.mark.parametrize("delimiter", [",", " "])
def test_comments_below_a_table_are_left_out(end: str, delimiter: str, record: Record, tmp_path: Path) -> None:
    rows = [row.replace(",", delimiter) for row in rows_of(record, seconds(record))]
    head = "t q_cmd q torque".replace(" ", delimiter)
    (tmp_path / "a.txt").write_text("\n".join([head, *rows, end]))
    lines = len([line for line in end.splitlines() if line])
    assert f"lines of comments below the table: {lines}, left out" in imported(tmp_path / "a.txt").output
    assert read_record(tmp_path / "a.toml").n_samples == record.n_samples
    (tmp_path / "a.txt").write_text("\n".join([head, *rows[:700], end, *rows[700:], ""]))
    with pytest.raises(RecordError, match=r"line 70[23]"):
        read_record(tmp_path / "a.toml")


def test_structs_of_matlab_are_columns(record: Record, tmp_path: Path) -> None:
    fields = {"time": record["time_s"], "pos": {"set": record[NAMES[0]], "act": record[NAMES[1]]}}
    savemat(tmp_path / "a.mat", {"log": {**fields, "torque": record[NAMES[2]], "Ts": 1e-3}, "other": np.arange(7.0)})
    imported(tmp_path / "a.mat")
    read = read_record(tmp_path / "a.toml")
    assert read.provenance["mapping"]["position_m"]["from"] == "log.pos.act"
    np.testing.assert_array_equal(read["position_m"], record["position_m"])
    with pytest.raises(RecordError, match=r"variable log is a struct.*`fdbench import a.mat` writes one"):
        read_record(tmp_path / "a.mat")


def test_a_matrix_of_matlab_has_no_names(record: Record, tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"data": np.column_stack([record[name] for name in NAMES]), "note": "run 7"})
    said = CliRunner().invoke(cli.app, ["import", str(tmp_path / "a.mat")]).output
    assert "no columns: data is a matrix of 1500 x 3 without names; a column is n x 1 or 1 x n; note holds text" in said
    assert "give each column a name, such as t = data(:, 1)" in said


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_text_compressed_by_gzip_is_unpacked(encoding: str, record: Record, tmp_path: Path) -> None:
    text = "\n".join([f"time,{HEAD}", *rows_of(record, seconds(record)), ""])
    packed = gzip.compress(text.encode(encoding))
    (tmp_path / "a.csv.gz").write_bytes(packed)
    imported(tmp_path / "a.csv.gz")
    read = read_record(tmp_path / "a.csv.toml")
    np.testing.assert_allclose(read["position_m"], record["position_m"], rtol=0.0, atol=6e-10)
    (tmp_path / "a.csv.gz").write_bytes(packed[: len(packed) // 2])
    with pytest.raises(RecordError, match="compressed by gzip, but damaged or cut"):
        read_record(tmp_path / "a.csv.toml")


def test_compressed_text_has_a_bound(record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fdbench.reading.formats._text.LARGEST_UNPACKED", 1000)
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"time_s,position_m\n" + b"0,0\n" * 1000))
    with pytest.raises(RecordError, match="unpacked at most 1000 bytes are read"):
        read_record(tmp_path / "a.csv.gz")
