"""Stale commands: rows that a logger repeats as a whole, the command with what was measured."""

import numpy as np
from numpy.typing import NDArray

from fdbench.record import FloatArray


def stale_commands(command: FloatArray, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where a logger repeats a row as a whole, (n_samples,), the command with what was measured.

    There the command stands, and then catches up with what it went by before and goes by after. What stands still, or
    is coarse, does not.

    >>> held = np.array([False, False, False, True, False, False])
    >>> stale_commands(np.array([0.0, 1.0, 2.0, 2.0, 4.0, 5.0]), held).tolist()
    [False, False, False, True, False, False]
    >>> stale_commands(np.array([0.0, 1.0, 2.0, 2.0, 3.0, 4.0]), held).any()
    np.False_
    """
    found = np.zeros(len(command), dtype=np.bool_)
    fresh = np.flatnonzero(~held)
    speed = np.diff(command[fresh]) / np.diff(fresh)
    for before in (1 + np.flatnonzero(np.diff(fresh)[1:-1] > 1)).tolist():
        last, following = int(fresh[before]), int(fresh[before + 1])
        step = 0.5 * float(speed[before - 1] + speed[before + 1])
        lost = float(command[following] - command[last]) - step
        if np.ptp(command[last:following]) == 0.0:
            found[last + 1 : following] = abs(lost - (following - last - 1) * step) < 0.5 * abs(step)
    return found


def going_on(command: FloatArray, stale: NDArray[np.bool_]) -> FloatArray:
    """Return a command with what is stale replaced by a cubic spline through the rest."""
    if not stale.any():
        return command
    from scipy.interpolate import CubicSpline

    found, place = command.copy(), np.arange(len(command))
    found[stale] = CubicSpline(place[~stale], command[~stale])(place[stale])
    return found
