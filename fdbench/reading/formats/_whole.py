"""Rows that a log holds twice, and cells in which it holds no number."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from fdbench.reading.formats._format import Raw

MOST_HOLES = 0.01  # share of the values of a column, above which it is on a slower clock
EVEN = 1.5  # times the median step, up to which a clock has no jump


def without_repeated_rows(raw: "Raw", clock: str | None) -> "Raw":
    """Return columns without the rows that repeat the one before them, where without them the clock is even.

    Rows that differ at one time, as those of a clock with too few digits, all stay.

    Parameters
    ----------
    raw : Raw
        Columns of one clock.
    clock : str or None
        The column of times; None for any that runs evenly.
    """
    if raw.clocks or raw.gaps or len({len(values) for values in raw.columns.values()}) != 1:
        return raw
    same = np.logical_and.reduce([_repeats(values) for values in raw.columns.values()])
    kept = np.flatnonzero(~same)
    candidates = [raw.columns[clock]] if clock is not None else [*raw.columns.values()]
    if len(kept) == len(same) or not any(_is_even(values[kept]) for values in candidates):
        return raw
    first = int(np.flatnonzero(same)[0])
    note = f"{raw.place(first)} repeats the one before it, {len(same) - len(kept)} in all: left out"
    return replace(
        raw,
        columns={name: values[kept] for name, values in raw.columns.items()},
        place=lambda sample: raw.place(int(kept[sample])),
        notes=[*raw.notes, note],
    )


def surveyed(raw: "Raw") -> "Raw":
    """Return columns without repeated rows, with sentences on those in which few values are no numbers."""
    raw = without_repeated_rows(raw, None)
    notes = []
    for name, values in raw.columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if 0 < len(bad) <= MOST_HOLES * len(values):
            notes.append(
                f"'{name}' has no number at {raw.place(int(bad[0]))}, {len(bad)} in all: correct the log there, or "
                "only the longest part without is taken"
            )
    return replace(raw, notes=[*raw.notes, *notes])


def _repeats(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which values are those before them."""
    same = np.zeros(len(values), dtype=np.bool_)
    same[1:] = values[1:] == values[:-1]
    return same


def _is_even(times: NDArray[Any]) -> bool:
    steps = np.diff(times.astype(np.float64))
    return bool(len(steps) and (steps > 0.0).all() and steps.max() <= EVEN * np.median(steps))
