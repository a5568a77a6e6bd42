"""MATLAB's MAT files up to version 7: variables of shape (n, 1) or (1, n), and the fields of structs that are such."""

import math
import statistics
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from fdbench.documents import MOST_VALUES
from fdbench.errors import RecordError
from fdbench.reading.formats._format import EVERYTHING, Format, Raw, choose, origin

HEAD_BYTES, TAG_BYTES = 128, 8
MATRIX, COMPRESSED = 14, 15
NUMERIC = frozenset((*range(1, 8), 9, 12, 13, 16, 17, 18))
KINDS = NUMERIC | {MATRIX, COMPRESSED}
ARRAYS_OF_NUMBERS = range(4, 16)
DEEPEST = 16
LARGEST_UNPACKED = 8 * MOST_VALUES


@final
class Mat(Format):
    """Variables, read by scipy; a field of a struct is called as in MATLAB, ``data.time``.

    Tests read what scipy writes, and a file that MATLAB wrote (EMPS).
    """

    suffixes = (".mat",)
    has_our_names = True

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file begins with the text that MATLAB puts there."""
        return head.startswith(b"MATLAB ")

    def read(self, file: Path, wanted: Collection[str] | None) -> Raw:
        """Return columns; see `Format.read`. Without a mapping, scalars are provenance."""
        from scipy.io import loadmat, whosmat

        with file.open("rb") as stream:
            head = stream.read(19)
        if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
            raise RecordError(
                f"{file}: a MAT file of version 7.3 (HDF5). In MATLAB: save(file, '-v7'), or write CSV or Parquet."
            )
        _check_elements(file)
        try:
            sizes = [math.prod(shape) for _, shape, _ in whosmat(file)]
            content = loadmat(file) if sum(sizes) <= MOST_VALUES else {}
        except Exception as error:  # scipy has no common base for what damaged files raise
            raise RecordError(f"{file}: not a MAT file, or a damaged one: {error}") from error
        if sum(sizes) > MOST_VALUES:
            raise RecordError(f"{file}: it holds {sum(sizes)} values; at most {MOST_VALUES} are read.")
        variables = {name: np.asarray(array) for name, array in content.items() if not name.startswith("__")}
        arrays = dict(field for name, array in variables.items() for field in _fields(name, array))
        if wanted is None and len(arrays) > len(variables):
            name = next(name for name in variables if name not in arrays)
            raise RecordError(
                f"{file}: variable {name} is a struct, whose fields are columns only by a mapping file; "
                f"`fdbench import {file.name}` writes one."
            )
        scalars = {name for name, array in arrays.items() if array.size == 1 and array.dtype.kind in "biuf"}
        chosen = choose([name for name in arrays if wanted is not None or name not in scalars], wanted, file)
        if wanted is EVERYTHING:
            chosen = _columns(arrays, scalars, file)
        for name in chosen:
            if fault := _fault(arrays[name]):
                raise RecordError(f"{file}: variable {name} {fault}.")
        columns: dict[str, NDArray[Any]] = {name: arrays[name].ravel() for name in chosen}
        left_out = [name for name in arrays if name not in chosen]
        if wanted is not None or not scalars:
            return Raw(columns=columns, left_out=left_out)
        kept = {name: float(arrays[name].item()) for name in sorted(scalars)}
        return Raw(columns=columns, provenance={**origin(file), "scalars": kept})


def _fields(name: str, array: NDArray[Any], depth: int = 0) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield name and content of a variable, or of each field of a struct."""
    if array.dtype.names is None or array.size != 1 or depth > DEEPEST:
        yield name, array
        return
    for field in array.dtype.names:
        yield from _fields(f"{name}.{field}", np.asarray(array[field].item()), depth + 1)


def _columns(arrays: dict[str, NDArray[Any]], scalars: Collection[str], file: Path) -> list[str]:
    """Return the names of what may be a column, of the length that most of them have."""
    faults = {name: _fault(array) for name, array in arrays.items() if name not in scalars}
    names = [name for name, fault in faults.items() if not fault]
    if not names:
        listed = "; ".join(f"{name} {fault}" for name, fault in faults.items()) or "it holds single numbers only"
        raise RecordError(
            f"{file}: no columns: {listed}. In MATLAB: give each column a name, such as t = data(:, 1), and save them."
        )
    length = statistics.mode(arrays[name].size for name in names)
    return [name for name in names if arrays[name].size == length]


def _check_elements(file: Path) -> None:
    """Raise a RecordError where an element is of no kind that there is: scipy looks such up in memory that it has not.

    A file is a row of elements: their kind, their size, their content. See MathWorks, MAT-File Format (R2023b), tables
    1-1 to 1-3.
    """
    content = file.read_bytes()
    if 0 in content[:4]:  # version 4, which has none
        return
    order = "<" if content[126:128] == b"IM" else ">"
    fault = _element_fault(memoryview(content)[HEAD_BYTES:], order, KINDS, 0)
    if fault:
        raise RecordError(f"{file}: not a MAT file, or a damaged one: {fault}.")


def _element_fault(data: memoryview, order: str, allowed: Collection[int], depth: int) -> str:
    """Return what is wrong with the elements in data, or an empty text."""
    place = 0
    while place + TAG_BYTES <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        is_small = bool(kind >> 16)
        kind, size = (kind & 0xFFFF, kind >> 16) if is_small else (kind, size)
        start = place + (TAG_BYTES // 2 if is_small else TAG_BYTES)
        if kind not in allowed or start + size > len(data) or (is_small and size > TAG_BYTES // 2):
            return f"an element of kind {kind} and {size} bytes"
        inner, within = data[start : start + size], KINDS
        if kind == COMPRESSED:
            try:
                inner = memoryview(zlib.decompressobj().decompress(inner, LARGEST_UNPACKED))
            except zlib.error as error:
                return str(error)
        elif kind == MATRIX and size >= 2 * TAG_BYTES:
            array = struct.unpack_from(f"{order}I", inner, TAG_BYTES)[0] & 0xFF
            within = NUMERIC if array in ARRAYS_OF_NUMBERS else KINDS
        if kind in (COMPRESSED, MATRIX):
            fault = (
                "elements within one another" if depth > DEEPEST else _element_fault(inner, order, within, depth + 1)
            )
            if fault:
                return fault
        padded = size if kind == COMPRESSED else -(-size // TAG_BYTES) * TAG_BYTES
        place += TAG_BYTES if is_small else TAG_BYTES + padded
    return ""


def _fault(array: NDArray[Any]) -> str:
    """Return why a variable is no column, or an empty text."""
    if array.dtype.kind not in "biuf":
        words = {"c": "complex numbers", "U": "text", "V": "a struct"}
        what = words.get(array.dtype.kind, "cells, objects or a sparse matrix")
        return f"holds {what}; a column holds real numbers"
    shape = " x ".join(map(str, array.shape))
    return "" if max(array.shape) == array.size else f"is a matrix of {shape} without names; a column is n x 1 or 1 x n"
