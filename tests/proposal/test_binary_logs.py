"""Binary logs: the head of TwinCAT's export is believed where the file bears it out; others are named."""

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
from proposal import log_writers

from fdbench.errors import RecordError
from fdbench.reading import format_of
from fdbench.reading.formats.ros1_bag import Ros1Bag
from fdbench.reading.formats.twincat_svb import TwincatSvb
from fdbench.record import Record


@pytest.fixture(scope="module")
def record() -> Record:
    time_s = 1e-3 * np.arange(50)
    columns = {"reference_position_m": 0.1 * time_s, "position_m": 0.09 * time_s, "motor_torque_Nm": time_s - 0.02}
    return Record({"time_s": time_s, **columns})


def test_a_clock_of_32_bits_that_runs_over_goes_on(record: Record, tmp_path: Path) -> None:
    log_writers.twincat_svb(record, tmp_path / "a.svb", start_ticks=2**32 - 200_000)
    raw = TwincatSvb().read_all(tmp_path / "a.svb")
    np.testing.assert_allclose(np.diff(raw.columns["time of ActPos"]), 1e-3, rtol=1e-9)
    np.testing.assert_array_equal(raw.columns["ActPos"], 1e3 * record["position_m"])


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda content: content[:-1], r"channel 'SetTorque' ends behind the end of the file. The file was cut"),
        (lambda content: content.replace(b"REAL64", b"REALxx"), "holds 8 bytes of REALxx; read are REAL64"),
        (lambda content: content.replace(b"REAL64", b"INT32\x00"), "holds 8 bytes of INT32"),
        (lambda content: struct.pack("<q", 99) + content[8:], "a head of .* bytes that says it has 99"),
        (lambda content: content[:60], "not a binary export of TwinCAT Scope, or a damaged one"),
        (lambda content: content.replace(struct.pack("<q", 50), struct.pack("<q", 51)), "has 51 values in 600 bytes"),
        (lambda content: content.replace(b"\x06\x00\x00\x00ActPos", b"\xff\xff\xff\xffActPos"), "a text of -1 bytes"),
    ],
)
def test_a_damaged_binary_export_is_refused(damage: object, words: str, record: Record, tmp_path: Path) -> None:
    log_writers.twincat_svb(record, tmp_path / "a.svb")
    (tmp_path / "a.svb").write_bytes(damage((tmp_path / "a.svb").read_bytes()))  # type: ignore[operator]
    with pytest.raises(RecordError, match=words):
        TwincatSvb().read_all(tmp_path / "a.svb")


def test_a_damaged_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(range(200)))
    assert format_of(tmp_path / "a.bag") is Ros1Bag
    with pytest.raises(RecordError, match="not a ROS 1 bag, or a damaged one"):
        Ros1Bag().read_all(tmp_path / "a.bag")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.svdx", b"x", "a recording of TwinCAT Scope. Export it in TwinCAT Scope as CSV or svb"),
        ("a.tcscopex", b"<xml/>", "a project of TwinCAT Scope"),
        ("a.tdms", b"TDSm\x0e\x00", "TDMS of National Instruments"),
        ("a.csv", b"TDSm\x0e\x00", "TDMS of National Instruments"),
        ("a.xlsx", b"PK\x03\x04", "a ZIP archive or an Excel workbook"),
        ("a.csv", b"PK\x03\x04", "Unpack it, or save its sheet as CSV"),
        ("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an Excel workbook"),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "HDF5"),
        ("a.mat", b"\x89HDF\r\n\x1a\n", "HDF5.*save\\(file, '-v7'\\)"),
        ("a.csv.gz", b"\x1f\x8b\x08", "compressed by gzip, but damaged or cut"),
        ("a.mat.gz", gzip.compress(b"MATLAB 5.0", mtime=0), "compressed by gzip. Unpack it first"),
        ("a.feather", b"ARROW1\x00\x00", "pandas.read_feather"),
        ("a.blf", b"LOGG", "a CAN log of Vector"),
    ],
)
def test_what_is_not_read_is_named_with_what_to_do(name: str, content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordError, match=words):
        format_of(tmp_path / name)
