"""TOML, JSON and Parquet as they are read: bounded before they are parsed, so that no text takes long or has no end.

Whatever is wrong with a text is a ValueError that says what in a few words; who reads it says where.
"""

import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

from fdbench.files import is_utf_8

LARGEST_TOML = 2**20  # bytes
LARGEST_JSON = 2**26
MOST_VALUES = 2 * 10**8  # of a table, unpacked
DEEPEST = 64  # tables and lists within one another
MOST_PARTS = 16  # of a dotted key; the parser takes their square
LONGEST_WORD = 300  # digits of a number, or letters of a plain key

# Strings and comments of TOML; what is not closed goes on to the end, so that one pass is enough: no part can fail
# after a repetition, and nothing is tried twice. Possessive ones, which say so, match wrongly in Python before 3.11.5.
_QUOTED = re.compile(
    r'"""(?:[^"\\]+|\\(?:.|\Z)|"(?!""))*(?:"{3,5}|\Z)'
    r"|'''(?:[^']+|'(?!''))*(?:'{3,5}|\Z)"
    r'|"(?:[^"\\\n]+|\\[^\n])*"?'
    r"|'[^'\n]*'?"
    r"|#[^\n]*",
    re.DOTALL,
)
_WORD = re.compile(rf"[\w+-]{{{LONGEST_WORD + 1}}}")
_BRACKETS = re.compile(r"[\[\]{}]")
_BETWEEN_KEYS = re.compile(r"[=,{}\[\]\n]")
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def read_file(path: str | Path, largest: int) -> bytes:
    """Return the bytes of a file.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is larger, or a pipe or a device.
    """
    check_is_file(path)
    with open(path, "rb") as stream:
        content = stream.read(largest + 1)
    if len(content) > largest:
        raise ValueError(f"larger than {largest} bytes")
    return content


def check_is_file(path: str | Path) -> None:
    """Raise a ValueError for what is no file: a pipe could keep its reader waiting, a device has no end."""
    file = Path(path)
    if not is_utf_8(file):
        raise ValueError("its name is not UTF-8; rename it")
    if file.exists() and not file.is_file() and not file.is_dir():
        raise ValueError("a pipe or a device, not a file")


def toml_tables(content: bytes | str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    >>> toml_tables("a.b = 1")
    {'a': {'b': 1}}
    >>> toml_tables("a." * 20 + "b = 1")
    Traceback (most recent call last):
    ValueError: a key of 21 parts; at most 16 are allowed
    """
    if len(content) > LARGEST_TOML:
        raise ValueError(f"larger than {LARGEST_TOML} bytes")
    text = content.decode("utf-8-sig") if isinstance(content, bytes) else content
    plain = _QUOTED.sub('"', text)
    if _WORD.search(plain):
        raise ValueError(f"a number or a key of more than {LONGEST_WORD} characters")
    depth = deepest = 0
    for bracket in _BRACKETS.findall(plain):
        depth += 1 if bracket in "[{" else -1
        deepest = max(deepest, depth)
    parts = 1 + max(between.count(".") for between in _BETWEEN_KEYS.split(plain))
    if parts > MOST_PARTS:
        raise ValueError(f"a key of {parts} parts; at most {MOST_PARTS} are allowed")
    if deepest > DEEPEST:
        raise ValueError(_TOO_DEEP)
    tables = tomllib.loads(text)
    _check_depth(tables)
    return tables


def json_value(content: bytes | str, *, is_finite: bool = True) -> Any:
    """Return what a JSON text says; with ``is_finite`` NaN and Infinity, which JSON lacks, are refused.

    >>> json_value('{"a": [1, 2.5]}')
    {'a': [1, 2.5]}
    >>> json_value("[NaN]")
    Traceback (most recent call last):
    ValueError: NaN is not JSON
    """
    if len(content) > LARGEST_JSON:
        raise ValueError(f"larger than {LARGEST_JSON} bytes")
    text = content.decode("utf-8") if isinstance(content, bytes) else content
    try:
        value = json.loads(
            text,
            parse_int=_whole_number,
            parse_float=_finite_number if is_finite else None,
            parse_constant=_no_constant if is_finite else None,
        )
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _check_depth(value)
    if _SURROGATE.search(text):
        json.dumps(value, ensure_ascii=False).encode()
    return value


_TOO_DEEP = f"nested more than {DEEPEST} deep"


def _whole_number(digits: str) -> int:
    if len(digits) > LONGEST_WORD:
        raise ValueError(f"a number of {len(digits)} digits")
    return int(digits)


def _finite_number(digits: str) -> float:
    number = float(digits)
    if math.isinf(number):
        raise ValueError(f"{digits} is too large")
    return number


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(DEEPEST + 1):
        within = [item for item in level if isinstance(item, dict | list)]
        level = [below for item in within for below in (item.values() if isinstance(item, Mapping) else item)]
        if not within:
            return
    raise ValueError(_TOO_DEEP)


def parquet_table(path: str | Path, choose: Callable[[list[str]], list[str]] | None = None) -> Any:
    """Return the table (of pyarrow) in a Parquet file, after a look at its checksums and at its size when unpacked.

    Parameters
    ----------
    path : path
    choose : callable, optional
        Told the names of the columns, returns those to read, in this order.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is damaged, no Parquet file, or holds more than `MOST_VALUES`.
    """
    import pyarrow
    from pyarrow import parquet

    check_is_file(path)
    try:
        content = parquet.ParquetFile(path, page_checksum_verification=True)
        n_values = content.metadata.num_rows * content.metadata.num_columns
        if n_values > MOST_VALUES:
            raise ValueError(f"it holds {n_values} values; at most {MOST_VALUES} are read")
        names = list(content.schema_arrow.names) if choose is None else choose(list(content.schema_arrow.names))
        return content.read(columns=names).select(names)
    except (pyarrow.ArrowException, UnicodeDecodeError) as error:
        raise ValueError(str(error)) from error
