"""Units behind a name, and clocks whose stamps repeat or count from 1970."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from fdbench import cli
from fdbench.proposal._names import column
from fdbench.reading import read_record
from fdbench.record import FloatArray, Record
from fdbench.scenario import load_scenario
from fdbench.units import factor_to_si, spelt_unit


@pytest.fixture(scope="module")
def record() -> Record:
    return load_scenario("BallScrewAxis-v1").record(3).slice(0, 1500)


def imported(folder: Path, record: Record, times: FloatArray, digits: int, name: str, *more: object) -> Result:
    columns = (record[name] for name in ("reference_position_m", "position_m", "motor_torque_Nm"))
    rows = zip(times, *columns, strict=True)
    lines = [f"{time:.{digits}f},{a:.9f},{b:.9f},{c:.9f}" for time, a, b, c in rows]
    (folder / "a.csv").write_text("\n".join([f"{name},setpoint [m],position [m],torque [Nm]", *lines, ""]))
    return CliRunner().invoke(cli.app, ["import", str(folder / "a.csv"), *map(str, more)])


@pytest.mark.parametrize(
    ("name", "unit", "quantity"),
    [
        ("force_N", "N", "output"),
        ("F_N", "N", "output"),
        ("torque_Nm", "N m", "output"),
        ("i_q_A", "", "output"),
        ("iq_A", "A", "output"),
        ("motor_current_A", "A", "output"),
        ("u_V", "V", "output"),
        ("vel_mm_s", "mm/s", "velocity"),
        ("feed_mm_min", "mm/min", "velocity"),
        ("speed_rad_s", "rad/s", "velocity"),
        ("w_m_per_s", "m/s", "velocity"),
        ("speed_rpm", "rpm", "velocity"),
        ("zeit_s", "s", "time"),
        ("position_A", "", "position"),
        ("pos_m", "", "position"),
        ("time_min", "", "time"),
    ],
)
def test_units_behind_a_name(name: str, unit: str, quantity: str) -> None:
    found = column(name, np.zeros(3), "", "", "")
    assert (found.unit, found.quantity) == (unit, quantity)


def test_prefixes_of_units() -> None:
    assert factor_to_si("mNm", "motor_torque_Nm", "map") == pytest.approx(1e-3)
    assert factor_to_si("uA", "motor_current_A", "map") == pytest.approx(1e-6)
    assert factor_to_si("mrad", "position_rad", "map") == pytest.approx(1e-3)
    assert spelt_unit("mN·m") == "mN m"


@pytest.mark.parametrize(("unit", "size", "digits"), [("s", 1.0, 6), ("ms", 1e3, 0), ("us", 1e6, 0), ("ns", 1e9, 0)])
def test_times_that_count_from_1970(unit: str, size: float, digits: int, record: Record, tmp_path: Path) -> None:
    times = size * 1773310272.0 + np.round(size * record["time_s"], digits)
    result = imported(tmp_path, record, times, digits, "ts")
    assert result.exit_code == 0, result.output
    assert f"times are in {unit}: they count from 1970" in result.output
    assert read_record(tmp_path / "a.toml").sampling_time_s == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.parametrize("every", [7, 10])
def test_times_that_repeat_are_an_even_clock(every: int, record: Record, tmp_path: Path) -> None:
    times = record["time_s"].copy()
    if every == 7:
        times[1::7] = times[:-1:7][: len(times[1::7])]
    result = imported(tmp_path, record, times, 3 if every == 7 else 2, "time_s")
    assert result.exit_code == 0, result.output
    assert "sampling time 1 ms: times in 'time_s' repeat; an even clock" in result.output
    assert "CHECK sampling_time_s: 1 ms is the rate of times that repeat." in result.output
    read = read_record(tmp_path / "a.toml")
    assert read.sampling_time_s == pytest.approx(1e-3)
    assert read.n_samples == record.n_samples


def test_times_that_repeat_unevenly_are_refused(record: Record, tmp_path: Path) -> None:
    times = record["time_s"] + np.where(record["time_s"] > 0.7, 0.5, 0.0)
    result = imported(tmp_path, record, times, 2, "time_s")
    assert result.exit_code == 2
    assert "times in 'time_s' repeat, and no even clock explains them. Give the sampling time" in result.output
    result = imported(tmp_path, record, record["time_s"], 0, "time_s")  # one change in 1.5 s tells no rate
    assert result.exit_code == 2
    result = imported(tmp_path, record, times, 2, "time_s", "--sampling-time", "0.001")
    assert result.exit_code == 0, result.output
    assert "sampling time 1 ms: times in 'time_s' repeat; as given" in result.output


def test_what_hardly_changes_in_the_whole_part_is_said(record: Record, tmp_path: Path) -> None:
    times = record["time_s"] + 0.1 * (np.arange(record.n_samples) // 8)
    result = imported(tmp_path, record, times, 3, "time_s")
    assert result.exit_code == 1
    assert "left out 'position [m]': in the part that is whole, 8 samples, it hardly changes" in result.output
    assert "another position" not in result.output


def test_a_new_folder_is_made(record: Record, tmp_path: Path) -> None:
    result = imported(tmp_path, record, record["time_s"], 6, "time_s", "-o", tmp_path / "new" / "axis")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "new" / "axis" / "model.toml").exists()
    assert read_record(tmp_path / "new" / "axis" / "a.toml").n_samples == record.n_samples
    result = imported(tmp_path, record, record["time_s"], 6, "time_s", "-o", tmp_path / "a.csv")
    assert result.exit_code == 2
    assert "a file, not a folder" in result.output
