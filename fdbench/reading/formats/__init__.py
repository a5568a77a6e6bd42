"""File formats of records and logs: one format, one file."""

from fdbench.reading.formats._format import (
    EVERYTHING,
    Format,
    Log,
    Raw,
    choose,
    formats,
    library,
    on_clock,
    origin,
    unique,
)

__all__ = ["EVERYTHING", "Format", "Log", "Raw", "choose", "formats", "library", "on_clock", "origin", "unique"]
