"""What the data say: which column is the derivative of another, what force a motion needs, where a record is whole."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.record import FloatArray

SMOOTHED_S = 0.03  # over which positions are smoothed before they are differentiated
JUMP = 4.0  # times what is usual
TOLD = 0.5  # share of a difference that speed or acceleration explain
FEWEST_LEVELS = 10  # below, a column is a switch or a mode


class Balance(NamedTuple):
    """F = m a + d v + c sign(v) + f, least squares with m, d, c of at least 0; and how much of F it explains."""

    mass: float
    viscous: float
    coulomb: float
    offset: float
    explained: float
    fastest: float


def derivative(values: FloatArray, step_s: float, order: int = 1) -> FloatArray:
    """Return the smoothed derivative of samples."""
    from scipy.signal import savgol_filter

    width = min(2 * max(2, round(0.5 * SMOOTHED_S / step_s)) + 1, 2 * ((len(values) - 1) // 2) + 1)
    return np.asarray(savgol_filter(values, width, min(3, width - 1), order, step_s))


def slope(of: FloatArray, over: FloatArray) -> tuple[float, float]:
    """Return the slope of one column over another, and the share of its squares that the line explains.

    >>> slope(np.array([0.0, 2.0, 4.0]), np.array([1.0, 2.0, 3.0]))
    (2.0, 1.0)
    """
    y, x = of - of.mean(), over - over.mean()
    squares, total = float(x @ x), float(y @ y)
    if squares == 0.0 or total == 0.0:
        return 0.0, 0.0
    return float(x @ y) / squares, float(x @ y) ** 2 / (squares * total)


def balance(force: FloatArray, position: FloatArray, step_s: float) -> Balance:
    """Return what the force is made of, while the axis moves."""
    from scipy.optimize import lsq_linear

    speed, acceleration = derivative(position, step_s), derivative(position, step_s, 2)
    smooth = derivative(force, step_s, 0)
    fastest = float(np.abs(speed).max())
    moves = np.abs(speed) > 0.02 * fastest
    if fastest == 0.0 or moves.sum() < 8:
        return Balance(0.0, 0.0, 0.0, 0.0, 0.0, fastest)
    terms = np.column_stack((acceleration, speed, np.sign(speed), np.ones_like(speed)))[moves]
    sizes = np.maximum(np.abs(terms).max(axis=0), np.finfo(float).tiny)
    found = lsq_linear(terms / sizes, smooth[moves], bounds=([0.0, 0.0, 0.0, -np.inf], np.inf))
    left = smooth[moves] - terms @ (found.x / sizes)
    spread = smooth[moves] - smooth[moves].mean()
    explained = 1.0 - float(left @ left) / max(float(spread @ spread), np.finfo(float).tiny)
    mass, viscous, coulomb, offset = (float(value) for value in found.x / sizes)
    return Balance(mass, viscous, coulomb, offset, explained, fastest)


def roughness(values: FloatArray) -> float:
    """Return how much a column jumps from sample to sample; a command is smoother than what follows it."""
    return float(np.sqrt(np.mean(np.diff(values, 3) ** 2)))


def jumps(values: FloatArray) -> list[int]:
    """Return the samples at which a column jumps alone: far more than usual, and than right before and after.

    >>> jumps(np.array([0.0, 1.0, 2.0, 3.0, 30.0, 31.0, 32.0, 33.0]))
    [4]
    """
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0.0]
    if not len(moving):
        return []
    beside = np.concatenate(([0.0], steps, [0.0]))
    around = np.maximum(beside[:-2], beside[2:])
    usual = float(np.percentile(moving, 90.0, method="lower"))
    return [int(place) + 1 for place in np.flatnonzero((steps > JUMP * usual) & (steps > JUMP * around))]


def leads(one: FloatArray, other: FloatArray, step_s: float) -> tuple[bool, str]:
    """Return whether one of two nearly equal columns is the command of the other, and by what it is told.

    What follows lags behind while it moves, or else while it accelerates; else it is the rougher one, by noise.
    """
    ahead = one - other
    for order, words in ((1, "it is ahead in speed"), (2, "it is ahead in acceleration")):
        moving = derivative(0.5 * (one + other), step_s, order)
        factor, share = slope(derivative(ahead, step_s, 0), moving)
        if share > TOLD:
            return factor > 0.0, words
    return roughness(one) < roughness(other), "it is smoother"


def levels(values: FloatArray) -> int:
    """Return how many different values a column has, or 0 where some are no numbers."""
    return len(np.unique(values)) if np.isfinite(values).all() else 0


def is_signal(values: FloatArray) -> bool:
    """Return whether a column is more than a constant, a switch or a counter."""
    is_counter = bool((np.diff(values) == 1.0).all())
    return levels(values) > FEWEST_LEVELS and not is_counter


def is_copy(one: FloatArray, other: FloatArray) -> bool:
    """Return whether two columns differ, but for gain and offset, by no more than the steps of the coarser one.

    >>> place = np.sin(np.arange(100.0))
    >>> is_copy(np.round(place, 2), 3.0 * place), is_copy(place + 0.1 * np.sign(np.cos(np.arange(100.0))), place)
    (True, False)
    """
    factor, _ = slope(one, other)
    apart = one - one.mean() - factor * (other - other.mean())
    steps = np.diff(np.unique(one)).min(), abs(factor) * np.diff(np.unique(other)).min()
    return float(np.std(apart)) <= float(max(steps))


def longest_whole(columns: Sequence[NDArray[np.float64]], times: FloatArray | None, gaps: Sequence[int]) -> range:
    """Return the longest stretch without lost samples, jumps of the clock and values that are no numbers.

    >>> longest_whole([np.array([1.0, np.nan, 2.0, 3.0, 4.0])], None, [4])
    range(2, 4)
    """
    good = np.logical_and.reduce([np.isfinite(column) for column in columns])
    starts = np.zeros(len(good), dtype=np.bool_)
    starts[list(gaps)] = True
    if times is not None and len(times) > 1:
        steps = np.diff(times)
        starts[1:] |= (steps <= 0.0) | (steps > 1.5 * np.median(steps))
    edges = np.flatnonzero(~good | starts)
    bounds = [0, *(int(edge) for edge in edges), len(good)]
    stretches = [range(a if good[a] else a + 1, b) for a, b in pairwise(bounds) if a < len(good)]
    return max(stretches, key=len, default=range(0))
