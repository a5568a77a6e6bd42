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
from fdbench.reading.formats._text import GZIP, in_utf_8, open_text, open_unpacked

__all__ = ["EVERYTHING", "GZIP", "Format", "Log", "Raw"]
__all__ += ["choose", "formats", "in_utf_8", "library", "on_clock", "open_text", "open_unpacked", "origin", "unique"]
