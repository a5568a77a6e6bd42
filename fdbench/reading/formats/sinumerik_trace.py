"""SINUMERIK traces: XML with a value of a signal only where it changes, and signals on several clocks."""

from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from fdbench.documents import MOST_VALUES
from fdbench.errors import RecordError
from fdbench.reading.formats._cells import number_in
from fdbench.reading.formats._format import Log, Raw, unique
from fdbench.reading.formats._xml import parse_xml, xml_parser

# What the kinds of signals are measured in; positions and speeds are in mm or degrees, which the file does not say.
UNITS = {"current": "A", "torque": "Nm", "force": "N"}

# Values from here on are the bit pattern of an invalid number, written as an integer.
INVALID = 9.2e18
SHORTEST_S, LONGEST_S = 1e-7, 1e6  # of intervals and times
CLOCK_DIGITS = 6  # of the times in the file, s


def _within(text: str, low: float, high: float) -> float:
    number = number_in(text)
    if not low <= number <= high:
        raise ValueError(f"{text} is outside {low:g} to {high:g}")
    return number


class _Signal:
    """A signal as the file has it: when it was stored, and what."""

    def __init__(self, attributes: dict[str, str]) -> None:
        self.name = attributes["name"]
        self.label = attributes.get("description", "")
        self.unit = UNITS.get(attributes.get("unitsType", ""), "")
        self.interval_s = float(f"{_within(attributes['interval'], SHORTEST_S, LONGEST_S):.6g}")
        self.times: list[float] = []
        self.values: list[float] = []


@final
class SinumerikTrace(Log):
    """What SINUMERIK Operate saves of a trace (Diagnostics, Trace): ``traceSession`` with one ``dataFrame``.

    A ``dataSignal`` has an ``interval``, the cycle it was taken in, and an ``id`` by which a ``rec`` gives its value.
    Signals of the servo cycle are stored where they change, and hold in between; those of the interpolation cycle run
    on a slower clock, which may be shifted. Each interval is a clock here, with a column such as ``time 2 ms``. Samples
    before each signal of a clock has had a value are left out.

    Siemens does not publish the layout. It is taken from a trace of SINUMERIK Operate (trace version 01.00.03.02,
    hailongchenn/sinumerik-trace-viewer at 13406a1) and the readers there and in eliasrhoden/Trace-Tools. The samples in
    the tests are written after that trace, not by a SINUMERIK.
    """

    suffixes = ()
    largest_bytes = 2**28
    usual_position_unit = "mm"

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the element that all traces are in begins here."""
        return b"<traceSession" in head

    def read_all(self, file: Path) -> Raw:
        """Return all signals on their clocks."""
        signals, end_s = _parsed(file)
        names = unique([signal.name for signal in signals])
        columns: dict[str, NDArray[Any]] = {}
        clocks: dict[str, str] = {}
        total = 0
        for interval in sorted({signal.interval_s for signal in signals}):
            group = [(name, one) for name, one in zip(names, signals, strict=True) if one.interval_s == interval]
            start = max(one.times[0] for _, one in group)
            clock = f"time {1e3 * interval:g} ms"
            count = int((end_s - start) / interval + 1e-3) + 1
            total += count * (len(group) + 1)
            if total > MOST_VALUES:
                raise RecordError(f"{file}: more than {MOST_VALUES} values at intervals of {interval:g} s and others.")
            columns[clock] = np.round(start + interval * np.arange(count), CLOCK_DIGITS)
            for name, one in group:
                stored = np.searchsorted(np.array(one.times), columns[clock] + 1e-3 * interval, side="right") - 1
                columns[name] = np.array(one.values)[stored]
                clocks[name] = clock
        return Raw(
            columns=columns,
            units={name: one.unit for name, one in zip(names, signals, strict=True) if one.unit}
            | dict.fromkeys(clocks.values(), "s"),
            labels={name: one.label for name, one in zip(names, signals, strict=True)},
            clocks=clocks,
            notes=["values are stored where they change, and held until the next one"],
        )


def _parsed(file: Path) -> tuple[list[_Signal], float]:
    """Return the signals that have values, and the time of the last sample."""
    signals: dict[str, _Signal] = {}
    end = [0.0]
    frames = [0]

    def start(tag: str, attributes: dict[str, str]) -> None:
        where = f"{file}: line {parser.CurrentLineNumber}"
        try:
            if tag == "dataFrame":
                frames[0] += 1
            elif tag == "frameHeader":
                end[0] = _within(attributes.get("stopInc", "0"), 0.0, LONGEST_S)
            elif tag == "dataSignal":
                signals[attributes["id"]] = _Signal(attributes)
            elif tag == "rec":
                time = _within(attributes.pop("time"), -LONGEST_S, LONGEST_S)
                for key, value in attributes.items():
                    number = number_in(value)
                    if signals[key].times and time < signals[key].times[-1]:
                        raise ValueError(f"its time {time:g} s is before the one above")
                    signals[key].times.append(time)
                    signals[key].values.append(number if abs(number) < INVALID else np.nan)
                end[0] = max(end[0], time)
        except KeyError as error:
            raise RecordError(f"{where}: <{tag}> has no or an unknown {error.args[0]}.") from error
        except ValueError as error:
            raise RecordError(f"{where}: <{tag}>: {error}.") from error

    parser = xml_parser(file)
    parser.StartElementHandler = start
    parse_xml(parser, file)
    if frames[0] > 1:
        raise RecordError(f"{file}: {frames[0]} recordings (dataFrame) in one file. Save them one by one.")
    found = [signal for signal in signals.values() if signal.times]
    if not found:
        raise RecordError(f"{file}: a SINUMERIK trace without values: only its settings were saved.")
    return found, end[0]
