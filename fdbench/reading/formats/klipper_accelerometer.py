"""Klipper's accelerometer files: time and three accelerations."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import final

from fdbench.reading.formats._format import Format, Raw
from fdbench.reading.formats._text import open_text
from fdbench.reading.formats.csv import Csv

UNITS = {"time": "s", "accel_x": "mm/s^2", "accel_y": "mm/s^2", "accel_z": "mm/s^2"}


@final
class KlipperAccelerometer(Format):
    """What ``ACCELEROMETER_MEASURE`` and ``TEST_RESONANCES OUTPUT=raw_data`` write: no positions, and no forces.

    Layout and units from Klipper's ``klippy/extras/adxl345.py``, which prints the names behind ``#``, perhaps below a
    line of statistics behind ``##``, and all values by ``%.6f``, and from its document ``Measuring_Resonances.md``. The
    samples in the tests are written after these, not by Klipper.
    """

    suffixes = ()
    is_text = True

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the names are those that Klipper writes."""
        lines = [line for line in head.splitlines()[:2] if not line.startswith(b"##")]
        return bool(lines) and lines[0].strip() == b"#time,accel_x,accel_y,accel_z"

    def read(self, file: Path, wanted: Collection[str] | None) -> Raw:
        """Return columns; see `Format.read`."""
        with open_text(file) as lines:
            above = int(lines.readline().startswith(b"##"))
        return replace(Csv(skip_lines=above).read(file, wanted), units=UNITS)
