"""Long series, thinned to what a screen can show."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fdbench.regression import FloatArray

# Points of a series, fewer on a page of many estimates so that it stays below 2 MB.
MOST_POINTS = 3000
FEWEST_POINTS = 60
POINTS_OF_ALL_ESTIMATES = 32_000
# Beyond so many estimates a page has periods of the disturbance from the best ones alone.
CROWDED = 200

UNSEEN_GAP = 1e-3  # of the time that is drawn, about 1 px

# Points of a series for one of each bound of a band, which are smooth.
POINTS_FOR_A_BOUND = 3

# Share of values that may lie outside the range that an axis opens with, half of it on each side.
OUTSIDE_PERCENT = 0.5
# It does so only where all values take this many times the room.
SQUEEZE = 4.0


def points_of_a_series(n_estimates: int) -> int:
    """Return how many points a series has on a page of so many estimates.

    >>> points_of_a_series(10), points_of_a_series(100), points_of_a_series(1000)
    (3000, 320, 60)
    """
    return min(MOST_POINTS, max(FEWEST_POINTS, POINTS_OF_ALL_ESTIMATES // max(n_estimates, 1)))


def opening_range(series: Sequence[FloatArray]) -> tuple[float, float] | None:
    """Return the range of nearly all values, or None, for all, where those outside do not squeeze the rest.

    >>> opening_range([np.linspace(-1.0, 1.0, 1001)])
    >>> opening_range([np.linspace(-1.0, 1.0, 1001), np.array([900.0])])
    (-1.5, 1.5)
    """
    values = np.concatenate([np.empty(0), *series])
    if len(values) == 0:
        return None
    low, high = np.percentile(values, [0.5 * OUTSIDE_PERCENT, 100.0 - 0.5 * OUTSIDE_PERCENT])
    margin = 0.25 * (high - low)
    squeezed = np.ptp(values) > SQUEEZE * (high - low) > 0.0
    return (float(low - margin), float(high + margin)) if squeezed else None


def peak(series: Sequence[FloatArray]) -> float:
    """Return the absolute value that nearly all stay below, 0 if there are none.

    >>> peak([np.array([-2.0, 1.0]), np.full(10, 2.0)]), peak([])
    (2.0, 0.0)
    """
    values = np.abs(np.concatenate([np.empty(0), *series]))
    return float(np.percentile(values, 100.0 - OUTSIDE_PERCENT)) if len(values) else 0.0


def gaps(time_s: FloatArray) -> NDArray[np.intp]:
    """Return the rows that follow a gap in time or a step back, where another series begins.

    >>> gaps(np.array([0.0, 0.1, 0.2, 0.9, 1.0, 0.0, 0.1]))
    array([3, 5])
    """
    steps = np.diff(time_s)
    return (
        np.flatnonzero((steps > 1.5 * np.median(steps)) | (steps <= 0.0)) + 1
        if len(steps)
        else np.empty(0, dtype=np.intp)
    )


def thinned(time_s: FloatArray, values: FloatArray, n_points: int) -> tuple[FloatArray, FloatArray]:
    """Return at most about ``n_points``: of each group of rows the least and the greatest value, in their order.

    A gap in time becomes a row of NaN.

    >>> thinned(np.arange(8.0), np.array([0.0, 5.0, 1.0, 2.0, 9.0, 1.0, 3.0, 3.0]), 4)
    (array([0., 2., 4., 6.]), array([0., 5., 9., 1.]))
    """
    pairs = [_pairs(*block) for block in _blocks(time_s, values, n_points)]
    return _joined(pairs)


def envelope(
    time_s: FloatArray, lower: FloatArray, upper: FloatArray, n_points: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, least lower and greatest upper bound of each group of rows, as `thinned` groups them."""
    low = [(t, y.min(axis=1)) for t, y in (_grouped(*block) for block in _blocks(time_s, lower, n_points // 2))]
    high = [(t, y.max(axis=1)) for t, y in (_grouped(*block) for block in _blocks(time_s, upper, n_points // 2))]
    times, least = _joined(low)
    return times, least, _joined(high)[1]


def _blocks(time_s: FloatArray, values: FloatArray, n_points: int) -> list[tuple[FloatArray, FloatArray, int]]:
    """Return the blocks between gaps that can be seen, each with the number of points that it is given."""
    cuts = gaps(time_s)
    steps = time_s[cuts] - time_s[cuts - 1]
    cuts = cuts[(steps <= 0.0) | (steps > UNSEEN_GAP * np.ptp(time_s))]
    return [
        (t, y, max(2, round(n_points * len(t) / len(time_s))))
        for t, y in zip(np.split(time_s, cuts), np.split(values, cuts), strict=True)
    ]


def _grouped(time_s: FloatArray, values: FloatArray, n_groups: int) -> tuple[FloatArray, FloatArray]:
    """Return the time of each group and its rows, (n_groups, n); the last one is filled with the last row."""
    size = -(-len(values) // n_groups)
    missing = -len(values) % size
    return time_s[::size], np.pad(values, (0, missing), mode="edge").reshape(-1, size)


def _pairs(time_s: FloatArray, values: FloatArray, n_points: int) -> tuple[FloatArray, FloatArray]:
    if len(values) <= n_points:
        return time_s, values
    times, groups = _grouped(time_s, values, n_points // 2)
    step = np.median(np.diff(times)) if len(times) > 1 else 0.0
    least, greatest = groups.min(axis=1), groups.max(axis=1)
    rising = groups.argmin(axis=1) < groups.argmax(axis=1)
    ordered = np.stack([np.where(rising, least, greatest), np.where(rising, greatest, least)], axis=1)
    return np.stack([times, times + 0.5 * step], axis=1).ravel(), ordered.ravel()


def _joined(blocks: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    gap = np.array([np.nan])
    times = [part for t, _ in blocks for part in (t, t[-1:])][:-1]
    values = [part for _, y in blocks for part in (y, gap)][:-1]
    return np.concatenate(times), np.concatenate(values)
