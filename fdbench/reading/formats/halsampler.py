"""LinuxCNC's halsampler: rows of numbers without names, ``overrun`` where samples were lost."""

import re
from pathlib import Path
from typing import final

import numpy as np

from fdbench.errors import RecordError
from fdbench.reading.formats._cells import number_in
from fdbench.reading.formats._format import Log, Raw
from fdbench.reading.formats._text import whole_lines_of

_ROW = re.compile(rb"overrun|[-+\d.naif]+( [-+\d.naif]+)* ?")
FEWEST_ROWS = 3


@final
class Halsampler(Log):
    """What ``halsampler`` prints of the pins that the realtime component ``sampler`` takes in, in their order.

    Column ``pin.M`` is the pin ``sampler.N.pin.M``. With the option ``-t`` each row begins with the number of its
    sample, column ``sample`` here. The file has no times: a row is written each cycle of the thread that ``sampler``
    runs in, usually the servo thread of 1 ms. Floats have six digits behind the point.

    Layout from the manual page halsampler(1) and LinuxCNC's ``src/hal/components/sampler_usr.c`` (version 2.9), which
    prints ``%f`` and a blank for each float. One sample in the tests is by LinuxCNC 2.9.0~pre1, the others are written
    after these. That version writes ``overrun`` where rows before its start were lost, but where its buffer ran full
    later, rows are missing without a mark and without a gap in their numbers: only the values jump.
    """

    suffixes = ()
    is_text = True
    largest_bytes = 2**28
    usual_sampling_time_s = 1e-3
    usual_position_unit = "mm"

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether all whole lines are numbers between blanks, at least two of them, or ``overrun``."""
        lines = [line.rstrip(b"\r") for line in head.split(b"\n")[:-1]]
        rows = [line for line in lines if line != b"overrun"]
        return (
            len(rows) >= FEWEST_ROWS
            and all(_ROW.fullmatch(line) for line in lines)
            and all(b" " in row.rstrip() for row in rows)
        )

    def read_all(self, file: Path) -> Raw:
        """Return the pins, and the number of each sample where the rows begin with it."""
        rows: list[list[float]] = []
        lines: list[int] = []
        gaps: list[int] = []
        for number, line in enumerate(whole_lines_of(file), 1):
            if line.strip() == "overrun":
                gaps.append(len(rows))
                continue
            try:
                row = [number_in(cell) for cell in line.split()]
            except ValueError as error:
                raise RecordError(f"{file}: line {number}: {error}. halsampler writes numbers or 'overrun'.") from error
            if not row:
                continue
            if rows and len(row) != len(rows[0]):
                raise RecordError(f"{file}: line {number} has {len(row)} numbers, the first row {len(rows[0])}.")
            rows.append(row)
            lines.append(number)
        if not rows:
            raise RecordError(f"{file}: no row of numbers.")
        values = np.array(rows)
        steps = np.diff(values[:, 0])
        within = np.delete(steps, [gap - 1 for gap in gaps if gap > 0]) if len(rows) > 1 else steps
        is_tagged = len(within) > 0 and bool((within == 1.0).all())
        names = ["sample"] * is_tagged + [f"pin.{place}" for place in range(values.shape[1] - is_tagged)]
        return Raw(
            columns={name: values[:, place] for place, name in enumerate(names)},
            place=lambda sample: f"sample {sample} (line {lines[sample]})",
            gaps=[gap for gap in gaps if 0 < gap < len(rows)],
        )
