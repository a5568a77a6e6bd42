"""Read records from CSV, Parquet and MAT files, as they are or through a TOML mapping."""

from fdbench.reading._mapping import measured_file, read_mapped, read_record

__all__ = ["measured_file", "read_mapped", "read_record"]
