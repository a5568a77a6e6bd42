"""Messages of topics as columns: each number of a message is a column, each topic a clock."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._format import Raw

LONGEST_ARRAY = 64
DEEPEST = 16
LATEST_S = 2.0**33  # beyond what 32 bits hold, signed or not


def numbers_of(message: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Yield path and value of each number in a message: nested tables, objects, and arrays of at most 64.

    Where a message names the entries of its arrays, in ``name`` or ``joint_names``, these are used.

    >>> list(numbers_of({"name": ["x", "y"], "position": [1.0, 2.0]}))
    [('position[x]', 1.0), ('position[y]', 2.0)]
    """
    if depth > DEEPEST:
        return
    if isinstance(message, bool | int | float | np.number):
        yield path, float(message)
        return
    if isinstance(message, list | tuple | np.ndarray):
        if len(message) <= LONGEST_ARRAY:
            for place, item in enumerate(message):
                yield from numbers_of(item, f"{path}[{place}]", depth + 1)
        return
    fields = message if isinstance(message, Mapping) else getattr(message, "__dict__", {})
    joints = fields.get("name", fields.get("joint_names"))
    for key, value in fields.items():
        inner = f"{path}.{key}" if path else str(key)
        is_array = isinstance(value, list | tuple | np.ndarray) and isinstance(joints, list | tuple)
        if is_array and len(value) == len(joints) and all(isinstance(joint, str) for joint in joints):
            for joint, item in zip(joints, value, strict=True):
                yield from numbers_of(item, f"{inner}[{joint}]", depth + 1)
        else:
            yield from numbers_of(value, inner, depth + 1)


class Topics:
    """Gathers messages; times are those of their headers, where they have one, else of the log."""

    def __init__(self) -> None:
        self._topics: dict[str, list[tuple[int, dict[str, float]]]] = {}

    def add(self, topic: str, log_time_ns: int, message: Any) -> None:
        """Add a message."""
        numbers = dict(numbers_of(message))
        seconds, rest = numbers.pop("header.stamp.sec", 0.0), numbers.pop("header.stamp.nanosec", 0.0)
        if not 0.0 <= seconds <= LATEST_S or not 0.0 <= rest < 1e9:
            raise RecordError(f"{topic}: the time of a header is {seconds:g} s and {rest:g} ns.")
        time_ns = int(seconds) * 10**9 + int(rest)
        self._topics.setdefault(topic, []).append((time_ns or log_time_ns, numbers))

    def raw(self, file: Path) -> Raw:
        """Return the columns that each message of their topic has."""
        columns: dict[str, NDArray[Any]] = {}
        clocks: dict[str, str] = {}
        partial = []
        start_ns = min((rows[0][0] for rows in self._topics.values()), default=0)
        for topic, rows in self._topics.items():
            clock = f"time of {topic}"
            names = [name for name in rows[0][1] if all(name in numbers for _, numbers in rows)]
            partial += [f"{topic}.{name}" for name in {key for _, numbers in rows for key in numbers} - {*names}]
            if not names:
                continue
            columns[clock] = 1e-9 * np.array([time_ns - start_ns for time_ns, _ in rows], dtype=np.float64)
            for name in names:
                columns[f"{topic}.{name}"] = np.array([numbers[name] for _, numbers in rows])
                clocks[f"{topic}.{name}"] = clock
        if not columns:
            raise RecordError(f"{file}: no message with a number in it.")
        notes = [f"not in each message, and left out: {', '.join(sorted(partial))}"] if partial else []
        return Raw(columns=columns, units=dict.fromkeys({*clocks.values()}, "s"), clocks=clocks, notes=notes)
