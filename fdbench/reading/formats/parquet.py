"""Apache Parquet, as fdbench, pandas and others write it."""

from collections.abc import Collection
from pathlib import Path
from typing import Any, final

from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._format import EVERYTHING, Format, Raw, choose, stored_provenance
from fdbench.record import nth_sample


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
        import pyarrow
        from pyarrow import parquet

        try:
            content = parquet.ParquetFile(file)
        except pyarrow.ArrowInvalid as error:
            raise RecordError(f"{file}: not a Parquet file, or a damaged one: {error}") from error
        schema = content.schema_arrow
        chosen = choose(schema.names, wanted, file)
        stored = (schema.metadata or {}).get(b"fdbench")
        columns: dict[str, NDArray[Any]] = {}
        for name, column in zip(chosen, content.read(columns=chosen).select(chosen).columns, strict=True):
            if column.null_count and wanted is not EVERYTHING:
                hole = column.is_null().to_pylist().index(True)
                raise RecordError(
                    f"{file}: column {name} has {column.null_count} empty cells, the first at {nth_sample(hole)}."
                )
            values = column.to_numpy()
            if values.dtype.kind not in "biuf" and wanted is not EVERYTHING:
                first = next((text for text in column.to_pylist() if not _is_number(text)), column[0])
                raise RecordError(f"{file}: column {name} holds {column.type}, not numbers, such as {str(first)!r}.")
            if values.dtype.kind in "biuf" and not column.null_count:
                columns[name] = values
        left_out = [name for name in schema.names if name not in columns]
        return Raw(columns=columns, provenance=stored_provenance(stored, file) if stored else {}, left_out=left_out)


def _is_number(cell: object) -> bool:
    try:
        float(str(cell))
    except ValueError:
        return False
    return True
