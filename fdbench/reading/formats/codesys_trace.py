"""CODESYS's trace as CSV: a head of keys, then the samples of one variable after the other, each with its own times."""

import re
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._cells import number_in
from fdbench.reading.formats._format import Log, Raw, unique
from fdbench.reading.formats._text import whole_lines_of
from fdbench.record import FloatArray

HEAD = "[key]; [value]"
TICKS_S = {16: 1e-3, 32: 1e-6}  # by the bits of Flags
TRUTHS = {"TRUE": 1.0, "FALSE": 0.0}
SCATTER = 0.5  # of a cycle, by which its time may be off and still be that cycle's
_TIME = re.compile("-?[0-9]{1,18}")
_FLAGS = re.compile("[0-9]{1,9}")


@final
class CodesysTrace(Log):
    """What the trace editor of CODESYS 3 saves as CSV, and of the controllers that are programmed by it.

    A line of the head is ``key; value``, a sample ``; time; value`` below the ``N.Data`` of its variable. Each variable
    has times of its own, here those of a column ``time of NAME``, in ms or us by the bits of ``Flags``. They are of the
    start of each cycle of the task, which scatters: where each is nearer to a cycle of one length than half of it, it
    is the time of that cycle here. Variables that are no numbers are left out, ``TRUE`` is 1.

    CODESYS does not publish the layout. It is taken from a trace of a ctrlX CORE (version 0x03050000, ms) in the tests
    of AragakiCH/ctrlx_sysid, and, for times in us, from tests of another reader, which quote one. The samples in the
    tests are written after these, not by CODESYS.
    """

    suffixes = ()
    is_text = True
    largest_bytes = 2**28

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the first line is that of all traces."""
        return head.split(b"\n", 1)[0].strip() == HEAD.encode()

    def read_all(self, file: Path) -> Raw:
        """Return all variables on their clocks."""
        head, samples = _parts(file)
        tick_s = _tick_s(head.get("Flags", ""), file)
        columns: dict[str, NDArray[Any]] = {}
        clocks: dict[str, str] = {}
        left_out: list[str] = []
        notes: list[str] = []
        names = unique([head.get(f"{number}.Variable", f"variable {number}") for number in samples])
        for name, rows in zip(names, samples.values(), strict=True):
            try:
                values = [_value(text) for _, text in rows]
            except ValueError:
                left_out.append(name)
                continue
            clock = f"time of {name}"
            times = tick_s * np.array([time for time, _ in rows], dtype=np.float64)
            columns[clock], scatter_s = _of_cycles(times, tick_s)
            if scatter_s > 0.0 and not notes:
                notes.append(
                    f"times scatter by up to {1e6 * scatter_s:.3g} us about the cycles of the task; those count"
                )
            columns[name], clocks[name] = np.array(values), clock
        units = dict.fromkeys(clocks.values(), "s")
        return Raw(columns=columns, clocks=clocks, units=units, left_out=left_out, notes=notes)


def _parts(file: Path) -> tuple[dict[str, str], dict[str, list[tuple[int, str]]]]:
    """Return the keys of the head, and the times and texts of the samples of each variable, by its number."""
    head: dict[str, str] = {}
    samples: dict[str, list[tuple[int, str]]] = {}
    rows: list[tuple[int, str]] | None = None
    for number, line in enumerate(whole_lines_of(file)[1:], 2):
        key, _, rest = line.partition(";")
        if not line.strip():
            continue
        if key.strip():
            head[key.strip()] = rest.strip()
            variable, _, last = key.strip().partition(".")
            rows = samples.setdefault(variable, []) if last == "Data" and variable.isdigit() else None
            continue
        time, _, value = rest.partition(";")
        if rows is None or not _TIME.fullmatch(time.strip()):
            raise RecordError(f"{file}: line {number}: {line[:60]!r} is no sample '; time; value' of a variable.")
        rows.append((int(time), value.strip()))
    filled = {variable: own for variable, own in samples.items() if own}
    if not filled:
        raise RecordError(f"{file}: a trace without samples. Save it after the recording.")
    return head, filled


def _tick_s(flags: str, file: Path) -> float:
    """Return the unit of the times."""
    bits = int(flags) if _FLAGS.fullmatch(flags) else 0
    found = [tick_s for bit, tick_s in TICKS_S.items() if bits & bit]
    if len(found) != 1:
        raise RecordError(
            f"{file}: Flags is {flags[:20]!r}, which says neither that times are in ms (16) nor in us (32): write one "
            "of both there."
        )
    return found[0]


def _value(text: str) -> float:
    return TRUTHS[text] if text in TRUTHS else number_in(text)


def _of_cycles(times: FloatArray, tick_s: float) -> tuple[FloatArray, float]:
    """Return times of even cycles in place of times that scatter about them, and by how much they do.

    They are as they were, with 0, where they are even already, or too far from such cycles.
    """
    steps = np.diff(times)
    if len(steps) == 0 or (steps <= 0.0).any() or np.ptp(steps) <= 1.5 * tick_s:
        return times, 0.0
    cycles = np.rint(steps / np.median(steps))
    if (cycles == 0.0).any():
        return times, 0.0
    numbers = np.concatenate(([0.0], np.cumsum(cycles)))
    period_s, first_s = np.polyfit(numbers, times, 1)
    even = first_s + period_s * numbers
    scatter_s = float(np.abs(times - even).max())
    return (even, scatter_s) if scatter_s < SCATTER * period_s else (times, 0.0)
