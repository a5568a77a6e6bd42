"""TOML, JSON and Parquet from others: bounded before they are parsed, and read for what they say."""

import os
import time
from pathlib import Path

import pyarrow
import pytest
from pyarrow import parquet

from fdbench.documents import LARGEST_TOML, json_value, parquet_table, read_file, toml_tables


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (".".join("a" * 50_000) + " = 1", "a key of 50000 parts"),
        ("[" + ".".join("a" * 17) + "]", "a key of 17 parts"),
        ("x = {" + ".".join("a" * 17) + " = 1}", "a key of 17 parts"),
        ("x = " + "[" * 100_000, "nested more than 64 deep"),
        ("x = " + "{a = " * 65 + "1" + "}" * 65, "nested more than 64 deep"),
        ("x = " + "9" * 100_000, "more than 300 characters"),
        ("x = 0x" + "f" * 100_000, "more than 300 characters"),
        ("#" * (LARGEST_TOML + 1), "larger than"),
        ('x = """' + '\\"""' * 100_000, "Unterminated|Expected"),
        ("x = '" * 50_000, "Expected"),
    ],
)
def test_toml_without_end_is_refused_at_once(text: str, words: str) -> None:
    start = time.perf_counter()
    with pytest.raises(ValueError, match=words):
        toml_tables(text)
    assert time.perf_counter() - start < 2.0


def test_what_only_looks_without_end_is_read() -> None:
    dots, brackets = "a." * 99, "[" * 99
    text = (
        f'# {dots} {brackets}\nx = "{dots}\\"{brackets}" # \'\ny = \'{dots}{brackets}"\'\nz = """{dots}"{brackets}""""'
    )
    assert toml_tables(text) == {"x": f'{dots}"{brackets}', "y": f'{dots}{brackets}"', "z": f'{dots}"{brackets}"'}
    assert toml_tables("[" + ".".join("a" * 16) + "]") != {}
    assert toml_tables(b"\xef\xbb\xbfx = 1") == {"x": 1}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, "nested more than 64 deep"),
        ("[" * 65 + "]" * 65, "nested more than 64 deep"),
        ("9" * 5000, "5000 digits"),
        ("[NaN]", "NaN is not JSON"),
        ('{"a": -Infinity}', "-Infinity is not JSON"),
        ("1e999", "1e999 is too large"),
        (r'{"a": "\ud800"}', "surrogates not allowed"),
        (b"\xff", "utf-8"),
        ("", "Expecting value"),
    ],
)
def test_json_without_end_or_meaning_is_refused(text: str | bytes, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        json_value(text)


def test_json_is_read() -> None:
    assert json_value(r'{"a": [1, -2.5e3, null, true, "\ud83d\ude00"]}') == {"a": [1, -2500.0, None, True, "😀"]}
    assert json_value("[" * 64 + "]" * 64) is not None
    assert json_value("[NaN]", is_finite=False)[0] != 0.0


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.toml")
    with pytest.raises(ValueError, match="a pipe or a device, not a file"):
        read_file(tmp_path / "a.toml", 100)
    (tmp_path / "b.toml").write_text("12345")
    assert read_file(tmp_path / "b.toml", 5) == b"12345"
    with pytest.raises(ValueError, match="larger than 4 bytes"):
        read_file(tmp_path / "b.toml", 4)


def test_a_table_that_unpacks_to_billions_is_refused(tmp_path: Path) -> None:
    """70 columns of one and the same three million numbers: a file of some kilobytes, 1.7 GB in memory."""
    values = pyarrow.array([0.5]).take(pyarrow.array([0] * 3_000_000))
    parquet.write_table(pyarrow.table({f"c{n}": values for n in range(70)}), tmp_path / "a.parquet")
    assert (tmp_path / "a.parquet").stat().st_size < 2**20
    with pytest.raises(ValueError, match="210000000 values"):
        parquet_table(tmp_path / "a.parquet")
