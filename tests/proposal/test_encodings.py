"""Text in the encodings that loggers write is read as the same numbers and units, or refused by one message."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from proposal import log_writers
from typer.testing import CliRunner

from fdbench import cli
from fdbench.errors import RecordError
from fdbench.reading import format_of, read_record
from fdbench.reading.formats.twincat_scope import TwincatScope
from fdbench.record import Record
from fdbench.report._measured_response import read_response

MARKED = {"utf-8-sig": "", "utf-16-le": "\ufeff", "utf-16-be": "\ufeff"}
LOGS: dict[str, tuple[str, Callable[[Record, Path], None]]] = {
    **{name: log_writers.WRITERS[name] for name in ("csv, German", "csv, units in names", "halsampler", "twincat")},
    "sinumerik": ("a.xml", log_writers.sinumerik),
}


@pytest.fixture(scope="module")
def record() -> Record:
    time_s = 1e-3 * np.arange(400)
    command = 0.05 * (1.0 - np.cos(2.0 * np.pi * time_s / 0.4))
    position = np.concatenate((np.zeros(4), command[:-4]))
    torque = 3.0 * np.gradient(np.gradient(command, 1e-3), 1e-3) + 0.2 * np.sign(np.gradient(command))
    return Record(
        {"time_s": time_s, "reference_position_m": command, "position_m": position, "motor_torque_Nm": torque}
    )


def plain_text(file: Path) -> str:
    content = file.read_bytes()
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252")


def columns(file: Path) -> dict[str, np.ndarray]:
    return dict(format_of(file).survey(file)[1].columns)


@pytest.mark.parametrize("encoding", MARKED)
@pytest.mark.parametrize("name", LOGS)
def test_a_log_with_a_byte_order_mark_is_read_as_the_same_numbers(
    name: str, encoding: str, record: Record, tmp_path: Path
) -> None:
    file, write = LOGS[name]
    (tmp_path / "plain").mkdir()
    (tmp_path / "marked").mkdir()
    write(record, tmp_path / "plain" / file)
    text = plain_text(tmp_path / "plain" / file)
    (tmp_path / "marked" / file).write_bytes((MARKED[encoding] + text).encode(encoding))
    plain, marked = columns(tmp_path / "plain" / file), columns(tmp_path / "marked" / file)
    assert list(marked) == list(plain) != []
    for column in plain:
        np.testing.assert_array_equal(marked[column], plain[column])


def test_our_names_in_utf_16_need_no_mapping(record: Record, tmp_path: Path) -> None:
    record.save(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_bytes((tmp_path / "a.csv").read_text().encode("utf-16"))
    np.testing.assert_array_equal(read_record(tmp_path / "b.csv")["position_m"], record["position_m"])


def test_a_fault_is_found_in_the_same_line_of_utf_16(tmp_path: Path) -> None:
    text = "time_s,position_m\n0.0,0.1\n0.001,x\n0.002,0.1\n"
    (tmp_path / "a.csv").write_bytes(text.encode("utf-16"))
    with pytest.raises(RecordError, match=r"line 3, column position_m: 'x' is not a number"):
        read_record(tmp_path / "a.csv")


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8"])
@pytest.mark.parametrize("unit", ["µm", "°"])
def test_units_beyond_ascii_of_twincat(unit: str, encoding: str, record: Record, tmp_path: Path) -> None:
    log_writers.twincat(record, tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text("utf-8").replace("mm (Length)", unit)
    (tmp_path / "a.csv").write_text(text, encoding)
    assert format_of(tmp_path / "a.csv") is TwincatScope
    assert TwincatScope().read_all(tmp_path / "a.csv").units["ActPos"] == unit


def test_micrometres_and_degrees_of_a_table_in_windows_1252(record: Record, tmp_path: Path) -> None:
    rows = [
        f"{time:.6f};{1e6 * place:.6f};{35.5:.1f}"
        for time, place in zip(*(record[name] for name in ("time_s", "position_m")), strict=True)
    ]
    text = "\n".join(["Zeit [s];Lageistwert [µm];Temperatur [°C]", *rows]) + "\n"
    (tmp_path / "a.csv").write_text(text, "cp1252")
    CliRunner().invoke(cli.app, ["import", str(tmp_path / "a.csv")])
    mapping = (tmp_path / "a.toml").read_text("utf-8")
    assert 'encoding = "cp1252"' in mapping
    assert 'from = "Lageistwert [µm]", unit = "um"' in mapping


def test_a_frequency_response_in_utf_16(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes("frequency_Hz,magnitude,phase_deg\n1,2,3\n2,1,4\n".encode("utf-16"))
    np.testing.assert_array_equal(read_response(tmp_path / "a.csv").magnitude, [2.0, 1.0])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("time_s,position_m\n0.0,0.1\n".encode("utf-16-le"), "UTF-16 without a byte order mark"),
        ("time_s,position_m\n0.0,0.1\n".encode("utf-16-be"), "UTF-16 without a byte order mark"),
        ("time_s,position_m\n0.0,0.1\n".encode("utf-16")[:-1], "begins as UTF-16, but is none, or was cut"),
        (b"\xff\xfe\x00\xd8\x00\xd8", "begins as UTF-16, but is none, or was cut"),
        ("time_s,position_m\n0.0,0.1\n".encode("utf-32"), "control characters"),
    ],
)
def test_what_is_not_read_is_said(content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(RecordError, match=words):
        read_record(tmp_path / "a.csv")


def test_a_mapping_cannot_contradict_the_mark(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes("t,x\n0,1\n1,2\n2,3\n".encode("utf-16"))
    (tmp_path / "a.toml").write_text(
        '[record]\nfile = "a.csv"\nencoding = "cp1252"\n'
        '[columns]\ntime_s = { from = "t" }\nposition_m = { from = "x" }\n'
    )
    with pytest.raises(RecordError, match=r"its byte order mark says utf-16-le\. Leave out encoding"):
        read_record(tmp_path / "a.toml")
