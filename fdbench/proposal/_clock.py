"""The clock of a log: its column of times, or the sampling time, and the part of the log that is whole."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.json_text import toml_value
from fdbench.proposal._data import jumps, longest_whole
from fdbench.proposal._names import LogColumn, column
from fdbench.proposal._units import Unit, time_unit
from fdbench.reading.formats import Format, Raw, on_clock
from fdbench.record import LONGEST_S, SHORTEST_S, FloatArray, check_clock
from fdbench.units import si_unit, time_text

SLOWEST_S = 0.05  # of a clock whose columns are looked at
EVEN = 1.5  # steps by which stamps of an even clock may be off
LARGEST = 1e100  # number that can be computed with
FEWEST_FINITE = 0.5  # share of the values of a column
MOST_REPEATED = 0.01  # share of the stamps of a clock, above which they have too few digits
FEWEST_CHANGES = 20  # of such stamps, by which their rate is told
EPOCH_S = 946684800.0, 4102444800.0  # from 1970 to 2000, and to 2100


def _numbers(values: NDArray[Any]) -> FloatArray:
    """Return a column, not a number where it is beyond what can be computed with."""
    column = np.asarray(values, dtype=np.float64)
    return np.where(np.abs(column) <= LARGEST, column, np.nan)


def _unit_from_1970(item: LogColumn) -> Unit | None:
    """Return the unit in which times count from 1970, if they do."""
    for name in ("s", "ms", "us", "ns"):
        if EPOCH_S[0] < item.values[0] * si_unit(name, item.name)[1] < EPOCH_S[1]:
            return Unit(name, "they count from 1970")
    return None


class Clock:
    """The times of a log, and its columns at the slowest clock of those that are of use.

    Parameters
    ----------
    raw : Raw
        The log.
    kind : type of Format
        Its format.
    sampling_time_s : float or None
        What the user says.
    file : path
        The log's file, for messages.
    """

    def __init__(self, raw: Raw, kind: type[Format], sampling_time_s: float | None, file: Path) -> None:
        self.found: list[str] = []
        self.to_do: list[str] = []
        self._raw, self._file = raw, file
        self._time, self._unit, self._coarse = "", "", ""
        self._given_s = sampling_time_s
        self._clocks = {name: self._median_step(name) for name in {*raw.clocks.values()}}
        useful = {name for name, step in self._clocks.items() if 0.0 < step <= SLOWEST_S}
        if raw.clocks and not useful:
            raise RecordError(
                f"{file}: no clock is faster than {time_text(SLOWEST_S)}; a feed drive needs milliseconds."
            )
        if raw.clocks:
            self._time, self._unit = max(useful, key=lambda name: self._clocks[name]), "s"
            kept = {name: raw.columns[name] for name in raw.columns if raw.clocks.get(name, name) in useful}
            self._at_slowest = on_clock(replace(raw, columns=kept), self._time, str(file)).columns
        else:
            self._at_slowest = raw.columns
            self._find_time(raw)
        columns = {name: _numbers(values) for name, values in self._at_slowest.items()}
        share = {name: float(np.isfinite(values).mean()) for name, values in columns.items()}
        self.left_out = [*raw.left_out, *(name for name in raw.columns if share.get(name, 0.0) < FEWEST_FINITE)]
        self.columns = {name: values for name, values in columns.items() if name not in self.left_out}
        if not self.columns:
            raise RecordError(f"{file}: no column of which at least half the values are numbers.")
        self.times = {*self._clocks} | ({self._time, self._coarse} - {""})
        seconds = self._seconds(self.columns[self._time]) if self._time else None
        found = [place for values in self.columns.values() if np.isfinite(values).all() for place in jumps(values)]
        together = [place for place, count in Counter(found).items() if count > 1]
        self.whole = longest_whole([*self.columns.values()], seconds, [*raw.gaps, *together])
        self.columns = {name: values for name, values in self.columns.items() if name not in self.times}
        if len(self.whole) < 3 or not self.columns:
            raise RecordError(f"{file}: no three samples in a row in which all columns are numbers.")
        if seconds is not None:
            self.step_s = float(np.median(np.diff(seconds[self.whole.start : self.whole.stop])))
        elif not self._coarse:
            self._assume(kind, sampling_time_s)
        if not SHORTEST_S <= self.step_s <= LONGEST_S:
            raise RecordError(
                f"{file}: a sampling time of {self.step_s:g} s; allowed: {SHORTEST_S:g} to {LONGEST_S:g} s. "
                f"{f'Check the times in {self._time!r}.' if self._time else ''}"
            )

    def samples(self, used: set[str], position: str) -> tuple[range, int]:
        """Return the longest whole part of the used columns as the mapping will read them, and how many there are.

        Where the position jumps, samples were lost.
        """
        raw = self._raw
        kept = {name: values for name, values in raw.columns.items() if name in used}
        columns = on_clock(replace(raw, columns=kept), self._time or None, str(self._file)).columns
        values = {name: _numbers(column) for name, column in columns.items()}
        lost = jumps(values[position]) if np.isfinite(values[position]).all() else []
        if lost:
            self.found.append(f"'{position}' jumps at sample {lost[0]} ({len(lost)} in all): samples were lost there")
        seconds = self._seconds(values[self._time]) if self._time in values else None
        return longest_whole([*values.values()], seconds, [*raw.gaps, *lost]), len(values[position])

    def mapped(self, used: list[LogColumn], found: list[str], to_do: list[str]) -> tuple[list[str], dict[str, object]]:
        """Return the line of time in [columns], or the key in [record], and say why."""
        if not self._time:
            return [], {"sampling_time_s": self.step_s}
        own = sorted({item.clock for item in used} - {""}, key=lambda name: self._clocks[name])
        if own:
            self._time = own[-1]
        if len(own) > 1:
            found.append(
                f"time_s: columns on {len(own)} clocks ({', '.join(own)}) are read at the slowest, so that no value is "
                "invented; faster ones lose samples"
            )
        if len(own) > 1 and self._clocks[own[-1]] > 1.5 * self._clocks[own[0]]:
            to_do.append(f"Log all columns at the clock of the controller where you can: {self._time} is slower.")
        seconds = self._seconds(np.asarray(self._raw.columns[self._time], dtype=np.float64))
        stretch = longest_whole([seconds], seconds, [])
        part = seconds[stretch.start : stretch.stop]
        step_s = float(np.median(np.diff(part)))
        try:
            check_clock(part, str(self._file))
        except RecordError:
            spread = float(np.ptp(np.diff(part)))
            to_do.append(
                f"CHECK the clock: times in '{self._time}' are uneven by up to {time_text(spread)}; taken as an "
                f"even clock of {time_text(step_s)} that was logged late."
            )
            mean_s = float((part[-1] - part[0]) / (len(part) - 1))
            return [], {"sampling_time_s": float(f"{mean_s:.9g}")}
        found.append(f"time_s is '{self._time}' in {self._unit}, a step of {time_text(step_s)}")
        return [f'time_s = {{ from = {toml_value(self._time)}, unit = "{self._unit}" }}'], {}

    def _find_time(self, raw: Raw) -> None:
        for name, values in raw.columns.items():
            item = column(
                name, np.asarray(values, dtype=np.float64), raw.units.get(name, ""), raw.labels.get(name, ""), ""
            )
            steps = np.diff(item.values)
            if item.quantity != "time" or not (steps > 0.0).any():
                continue
            is_coarse = bool((steps >= 0.0).all() and (steps == 0.0).mean() > MOST_REPEATED)
            if not is_coarse and not np.median(steps) > 0.0:
                continue
            step = float(np.ptp(item.values)) / len(steps) if is_coarse else float(np.median(steps))
            guess = _unit_from_1970(item) or time_unit(step)
            self._time, self._unit = name, item.unit or guess.name
            if not item.unit:
                self.found.append(f"times are in {guess.name}: {'GUESS ' * guess.is_guess}{guess.why}")
            if is_coarse:
                self._time, self._coarse = "", name
                self._take_rate(self._seconds(item.values))
            return

    def _take_rate(self, seconds: FloatArray) -> None:
        """Take the even clock of stamps that have too few digits, by where they change."""
        steps = np.diff(seconds)
        changes = np.flatnonzero(steps > 0.0) + 1
        first, last = int(changes[0]), int(changes[-1])
        rate_s = float(seconds[last] - seconds[first]) / max(last - first, 1)
        off = np.abs(seconds - seconds[first] - rate_s * (np.arange(len(seconds)) - first)).max()
        is_even = len(changes) >= FEWEST_CHANGES and off <= EVEN * (steps[changes - 1].min() + rate_s)
        if self._given_s is None and not is_even:
            raise RecordError(
                f"{self._file}: times in '{self._coarse}' repeat, and no even clock explains them. Give the sampling "
                "time: --sampling-time 0.001 for samples of 1 ms."
            )
        rounded_s = float(f"{rate_s:.3g}")
        told_s = rounded_s if abs(rounded_s / rate_s - 1.0) * (last - first) <= 1.0 else float(f"{rate_s:.9g}")
        self.step_s = told_s if self._given_s is None else self._given_s
        words = "as given" if self._given_s is not None else "an even clock that was written with too few digits"
        self.found.append(f"sampling time {time_text(self.step_s)}: times in '{self._coarse}' repeat; {words}")
        if self._given_s is None:
            self.to_do.append(f"CHECK sampling_time_s: {time_text(self.step_s)} is the rate of times that repeat.")

    def _assume(self, kind: type[Format], given_s: float | None) -> None:
        usual = kind.usual_sampling_time_s
        if given_s is None and usual is None:
            names = [name for name in self.left_out if column(name, np.zeros(0), "", "", "").quantity == "time"]
            what = f"the times in '{names[0]}' are no numbers" if names else "no column of times"
            raise RecordError(
                f"{self._file}: {what}. Give the sampling time: --sampling-time 0.001 for samples of 1 ms."
            )
        self.step_s = given_s if given_s is not None else usual or 0.0
        if given_s is None:
            self.found.append(f"sampling time {time_text(self.step_s)}: GUESS: usual in such logs, which have no times")
            self.to_do.append(f"CHECK sampling_time_s: {time_text(self.step_s)} is a guess (or give --sampling-time).")
        else:
            self.found.append(f"sampling time {time_text(self.step_s)}: as given; the log has no times")

    def _seconds(self, times: FloatArray) -> FloatArray:
        return np.asarray(times, dtype=np.float64) * si_unit(self._unit, self._time)[1]

    def _median_step(self, name: str) -> float:
        times = self._raw.columns[name]
        return float(np.median(np.diff(times))) if len(times) > 1 else 0.0
