"""Products of the gap and of responses of one run, summed over its segments, in units of the noise.

Readings of many hypotheses are far larger than the processor's cache, and are gone through once: what is counted from
another reading, scaled and multiplied is a piece that fits. Changes from run to run are whitened in the sums.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fdbench.diagnosis.evidence.run_to_run import Change
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.replay import PIECE
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.settings import EVIDENCE
from fdbench.record import FloatArray

HUGE = 1e30  # gap or response of a simulation that diverges, while its square is still a number
DIVERGED = 1e6  # gap, in units of the floor, of a simulation that diverges


def segment_length(run: RecordedRun) -> int:
    """Return the samples of a segment."""
    return max(8, round(EVIDENCE.segment_s / run.period_s))


def segment_counts(run: RecordedRun) -> FloatArray:
    """Return the samples of each segment, (n_segments,); the last one may be shorter."""
    starts = np.arange(0, run.n_samples, segment_length(run))
    return np.diff(starts, append=run.n_samples).astype(np.float64)


def segment_products(
    split: Split, number: int, readings: Mapping[str, FloatArray], counted_from: Sequence[int], products: FloatArray
) -> None:
    r"""Fill in the products of the gap of a run and of responses, for each channel and segment.

    Parameters
    ----------
    split : Split
    number : int
        Of the run in it.
    readings : mapping of str to array
        Each channel as the base and variants read it, (at least n_columns, n_samples).
    counted_from : sequence of int
        Row of the readings from which the response of each variant is counted; one that diverges has none.
    products : (n_channels, n_segments, n_columns, n_columns) array, written

    Notes
    -----
    With the gap and the responses :math:`y` (n_columns, n_samples) in units of the noise, and the directions U and
    shrinkage b of a `Change`, signals are whitened by :math:`y - A U^T` with :math:`A = y U \operatorname{diag}(b)`
    over all channels, and the products of a segment are

    .. math:: y y^T - A (U^T y^T) - (y U) A^T + A (U^T U) A^T.
    """
    run, change = split.runs[number], split.changes[number] if split.changes else None
    n_columns = 1 + len(counted_from)
    n_rows = n_columns + len(change.directions) if change else n_columns
    # Directions stand beside the columns until these are whitened by them.
    found = np.empty((*products.shape[:2], n_rows, n_rows)) if change else products
    for place, (name, measured) in enumerate(run.channels.items()):
        directions = change.directions[:, place] if change else np.empty((0, run.n_samples))
        per_unit = split.per_unit(number, name)
        _fill(found[place], readings[name], measured, counted_from, per_unit, directions, segment_length(run))
    squares = np.diagonal(found, axis1=2, axis2=3)[:, :, :n_columns].sum(axis=1)
    lost = np.flatnonzero(~(squares < HUGE**2).all(axis=0))
    if len(lost):
        found[:, :, lost] = 0.0
        found[:, :, :, lost] = 0.0
    if change:
        _whiten(found, n_columns, change)
        products[:] = found[:, :, :n_columns, :n_columns]
    if 0 in lost:
        products[:, :, 0, 0] = DIVERGED**2 * segment_counts(run)


def _fill(
    products: FloatArray,
    readings: FloatArray,
    measured: FloatArray,
    counted_from: Sequence[int],
    per_unit: float,
    directions: FloatArray,
    length: int,
) -> None:
    """Fill in the products of a channel's gap, responses and directions, (n_segments, n_rows, n_rows)."""
    n_columns, n_samples = 1 + len(counted_from), len(measured)
    n_rows = n_columns + len(directions)
    origins = np.array(counted_from, dtype=np.intp)
    at_once = length * max(1, PIECE // length)
    buffer = np.empty((n_rows, at_once))
    for first in range(0, n_samples, at_once):
        n = min(at_once, n_samples - first)
        piece, signals = readings[:, first : first + n], buffer[:, :n]
        np.subtract(measured[first : first + n], piece[0], out=signals[0])
        np.subtract(piece[1:n_columns], piece[origins] if origins.any() else piece[0], out=signals[1:n_columns])
        signals[:n_columns] *= per_unit
        signals[n_columns:] = directions[:, first : first + n]
        whole, segment = n // length, first // length
        stacked = signals[:, : whole * length].reshape(n_rows, whole, length).transpose(1, 0, 2)
        np.matmul(stacked, stacked.transpose(0, 2, 1), out=products[segment : segment + whole])
        if n > whole * length:
            rest = signals[:, whole * length :]
            np.matmul(rest, rest.T, out=products[-1])


def _whiten(found: FloatArray, n_columns: int, change: Change) -> None:
    """Whiten the products of columns, in place."""
    along = found[:, :, :n_columns, n_columns:].sum(axis=(0, 1)) * change.shrinkage
    for own in found:
        half = along @ (own[:, n_columns:, :n_columns] - 0.5 * own[:, n_columns:, n_columns:] @ along.T)
        own[:, :n_columns, :n_columns] -= half
        own[:, :n_columns, :n_columns] -= half.transpose(0, 2, 1)
