"""Cases measured in turns on one thread, fdbench first, and the table of what came out.

A burst is one run of a racer; a round is one burst of every racer. The time is CPU time of the whole process, so that a
peer's own threads count too; machines with other work on them then give nearly the same figures as idle ones. Ratios
are those of medians; a bar is for the best burst, as other work on the machine only ever adds.
"""

import math
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from fdbench.benchmark.provenance import machine

# For peers on JAX, which is imported later.
os.environ |= {"JAX_PLATFORMS": "cpu", "JAX_ENABLE_X64": "1", "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}

Burst = Callable[[], Any]  # runs, and returns what is compared
Compare = Callable[[Any, Any], float]


@dataclass(frozen=True, kw_only=True)
class Racer:
    """What is measured: ``start`` imports and prepares, and returns the burst, which does ``units`` of work.

    ``peer`` is the distribution that has to be there and ``install`` how to get it, ``rounds`` fewer rounds than the
    others do, ``bar`` the longest time of the best burst that is good enough.
    """

    name: str
    start: Callable[[], Burst]
    units: int = 1
    peer: str = ""
    install: str = "pip install 'fdbench[peers]'"
    rounds: int | None = None
    bar: float = math.inf
    note: str = ""

    @property
    def label(self) -> str:
        return f"{self.peer} {version(self.peer)}, {self.name}" if self.peer else self.name


def difference(found: Any, expected: Any) -> float:
    """Return the largest difference, of what both hold, relative to the largest expected value in its column."""
    n = min(len(found), len(expected))
    expected = np.asarray(expected)[:n]
    size = np.abs(expected).max(axis=0)
    return float(np.max(np.abs(np.asarray(found)[:n] - expected) / np.where(size > 0.0, size, 1.0)))


def race(
    title: str,
    racers: Sequence[Racer],
    *,
    scale: float = 1.0,
    rounds: int = 15,
    compare: Compare | None = difference,
    heading: str = "differs by",
) -> dict[str, float]:
    """Print a table, with times of a unit multiplied by ``scale``; return the medians by the names of the racers.

    The ratio is that of the medians to the first racer. What the bursts of a round return is compared with what the
    first racer's burst returned; the first round, which also compiles, is compared but not timed.
    """
    width = 54
    heading = heading if compare is not None else ""
    print(f"\n{title}\n{'':{width}} {'median':>9} {'best':>9} {'ratio':>7} {heading:>11}".rstrip())
    bursts: dict[Racer, Burst] = {}
    absent: dict[Racer, str | None] = {}
    for racer in racers:
        try:
            bursts[racer] = racer.start()
        except ModuleNotFoundError as error:
            if not racer.peer:
                raise
            absent[racer] = error.name
    times: dict[Racer, list[float]] = {racer: [] for racer in bursts}
    worst: dict[Racer, float] = {}
    with threadpool_limits(1):
        for number in range(rounds + 1):
            expected = None
            for racer, burst in bursts.items():
                if number > (rounds if racer.rounds is None else racer.rounds):
                    continue
                start = process_time()
                found = burst()
                seconds = process_time() - start
                if number > 0:
                    times[racer].append(scale * seconds / racer.units)
                if racer is racers[0]:
                    expected = found
                if compare is not None and found is not None and (found is not expected or compare is not difference):
                    worst[racer] = float(np.maximum(worst.get(racer, 0.0), compare(found, expected)))  # nan stays
    reference = median(times[racers[0]])
    for racer in racers:
        if racer in absent:
            name = f"{racer.peer}, {racer.name}"
            print(f"{name:{width}} not installed (no module {absent[racer]!r}): {racer.install}")
            continue
        middle = median(times[racer])
        off = f"{worst[racer]:.0e}" if racer in worst else ""
        note = racer.note
        if racer.bar < math.inf:
            note += f" bar {racer.bar:g}: {'met' if min(times[racer]) <= racer.bar else 'MISSED'}"
        row = f"{digits(middle):>9} {digits(min(times[racer])):>9} {digits(middle / reference):>7} {off:>11}"
        print(f"{racer.label:{width}} {row}  {note.strip()}".rstrip())
    return {racer.name: median(values) for racer, values in times.items()}


def digits(value: float) -> str:
    """Return three significant digits without an exponent.

    >>> digits(0.0123), digits(5.0), digits(12345.0)
    ('0.0123', '5.00', '12345')
    """
    return f"{value:.{max(0, 2 - math.floor(math.log10(value)))}f}"


def describe_machine() -> None:
    """Print what the figures below were measured on."""
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    numba = f"NumPy {np.__version__}, SciPy {version('scipy')}, Numba {version('numba')}"
    print(
        f"{machine()}, {os.cpu_count()} cores{load}; Python {platform.python_version()}, {numba}; one thread, CPU time"
    )
