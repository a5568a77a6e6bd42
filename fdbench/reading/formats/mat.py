"""MATLAB's MAT files up to version 7: variables of shape (n, 1) or (1, n)."""

from collections.abc import Collection
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._format import EVERYTHING, Format, Raw, choose, origin


@final
class Mat(Format):
    """Variables, read by scipy. Tests read what scipy writes, and a file that MATLAB wrote (EMPS)."""

    suffixes = (".mat",)
    has_our_names = True

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file begins with the text that MATLAB puts there."""
        return head.startswith(b"MATLAB ")

    def read(self, file: Path, wanted: Collection[str] | None) -> Raw:
        """Return columns; see `Format.read`. Without a mapping, scalars are provenance."""
        from scipy.io import loadmat

        with file.open("rb") as stream:
            head = stream.read(19)
        if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
            raise RecordError(
                f"{file}: a MAT file of version 7.3 (HDF5). In MATLAB: save(file, '-v7'), or write CSV or Parquet."
            )
        try:
            content = loadmat(file)
        except Exception as error:  # scipy has no common base for what damaged files raise
            raise RecordError(f"{file}: not a MAT file, or a damaged one: {error}") from error
        arrays = {name: np.asarray(array) for name, array in content.items() if not name.startswith("__")}
        scalars = {name for name, array in arrays.items() if array.size == 1 and array.dtype.kind in "biuf"}
        chosen = choose([name for name in arrays if wanted is not None or name not in scalars], wanted, file)
        if wanted is EVERYTHING:
            chosen = [name for name in chosen if name not in scalars and not _fault(arrays[name])]
        for name in chosen:
            if fault := _fault(arrays[name]):
                raise RecordError(f"{file}: variable {name} {fault}.")
        columns: dict[str, NDArray[Any]] = {name: arrays[name].ravel() for name in chosen}
        left_out = [name for name in arrays if name not in chosen]
        if wanted is not None or not scalars:
            return Raw(columns=columns, left_out=left_out)
        kept = {name: float(arrays[name].item()) for name in sorted(scalars)}
        return Raw(columns=columns, provenance={**origin(file), "scalars": kept})


def _fault(array: NDArray[Any]) -> str:
    """Return why a variable is no column, or an empty text."""
    if array.dtype.kind not in "biuf":
        words = {"c": "complex numbers", "U": "text", "V": "a struct"}
        what = words.get(array.dtype.kind, "cells, objects or a sparse matrix")
        return f"holds {what}; a column holds real numbers"
    return "" if max(array.shape) == array.size else f"has shape {array.shape}; a column has (n, 1) or (1, n)"
