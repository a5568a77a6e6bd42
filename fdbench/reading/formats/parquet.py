"""Apache Parquet, as fdbench, pandas and others write it."""

from collections.abc import Collection
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from fdbench.documents import parquet_table
from fdbench.errors import RecordError
from fdbench.reading.formats._format import EVERYTHING, Format, Raw, choose, stored_provenance
from fdbench.reading.formats._stamps import over_midnight
from fdbench.record import FloatArray, nth_sample


@final
class Parquet(Format):
    """One table, read by pyarrow; its metadata hold the provenance of fdbench. Tests read what pandas writes."""

    suffixes = (".parquet",)
    has_our_names = True

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file begins as every Parquet file does."""
        return head.startswith(b"PAR1")

    def read(self, file: Path, wanted: Collection[str] | None) -> Raw:
        """Return columns; see `Format.read`."""
        from pyarrow import types

        def is_text(kind: Any) -> bool:
            return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind))

        names: list[str] = []

        def chosen(found: list[str]) -> list[str]:
            names.extend(found)
            return choose(found, wanted, file)

        try:
            table = parquet_table(file, chosen)
        except (OSError, ValueError) as error:
            raise RecordError(f"{file}: not a Parquet file, or a damaged one: {error}") from error
        stored = (table.schema.metadata or {}).get(b"fdbench")
        columns: dict[str, NDArray[Any]] = {}
        stamps: list[str] = []
        for name, column in zip(table.column_names, table.columns, strict=True):
            if (types.is_timestamp(column.type) or types.is_time(column.type)) and not column.null_count:
                columns[name] = _seconds(column)
                stamps.append(name)
                continue
            is_number = types.is_floating(column.type) or types.is_integer(column.type) or types.is_boolean(column.type)
            if not is_number and wanted is EVERYTHING:
                continue
            if not is_number:
                texts = column.drop_null().to_pylist() if is_text(column.type) else []
                hint = next((f", such as {text!r}" for text in texts if not _is_number(text)), "")
                raise RecordError(f"{file}: column {name} holds {column.type}, not numbers{hint}.")
            if column.null_count and wanted is not EVERYTHING:
                hole = column.is_null().to_pylist().index(True)
                raise RecordError(
                    f"{file}: column {name} has {column.null_count} empty cells, the first at {nth_sample(hole)}."
                )
            if not column.null_count:
                columns[name] = column.to_numpy()
        left_out = [name for name in names if name not in columns]
        return Raw(
            columns=columns,
            provenance=stored_provenance(stored, file) if stored else {},
            left_out=left_out,
            units=dict.fromkeys(stamps, "s"),
            stamps=stamps,
            notes=[f"'{name}' holds times of day, taken as seconds from the first" for name in stamps],
        )


def _seconds(column: Any) -> FloatArray:
    """Return times of any kind as seconds from the first."""
    per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[column.type.unit]
    counts = column.cast(f"int{column.type.bit_width}").to_numpy().astype(np.int64)
    seconds: FloatArray = (counts - counts[:1]) / per_second
    return over_midnight(seconds)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
