"""Read records from files of many formats, as they are or through a TOML mapping."""

from fdbench.reading._mapping import format_of, measured_file, read_mapped, read_record

__all__ = ["format_of", "measured_file", "read_mapped", "read_record"]
