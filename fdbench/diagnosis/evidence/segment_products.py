"""Products of the gap and of responses of one run, summed over its segments, in units of the noise.

Readings of many hypotheses are far larger than the processor's cache, and are gone through once: what is counted from
another reading, scaled and multiplied is a piece that fits. Changes from run to run are whitened in the sums.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

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
    return segment_samples(run.period_s)


def segment_samples(period_s: float) -> int:
    """Return the samples of a segment at a sampling time."""
    return max(8, round(EVIDENCE.segment_s / period_s))


def segment_counts(run: RecordedRun) -> FloatArray:
    """Return the samples of each segment, (n_segments,); the last one may be shorter."""
    starts = np.arange(0, run.n_samples, segment_length(run))
    return np.diff(starts, append=run.n_samples).astype(np.float64)


def segment_products(
    split: Split,
    number: int,
    readings: Mapping[str, FloatArray],
    counted_from: Sequence[int],
    products: FloatArray,
    band: FloatArray,
) -> NDArray[np.bool_]:
    r"""Fill in the products of the gap of a run and of responses, for each channel and segment; return which diverge.

    Parameters
    ----------
    split : Split
    number : int
        Of the run in it.
    readings : mapping of str to array
        Each channel as the base and variants read it, (at least n_columns, n_samples).
    counted_from : sequence of int
        Row of the readings from which the response of each variant is counted; one that diverges has none.
    products : (n_channels, n_segments, n_common, n_columns) array, written
        Of the first columns, the gap among them, with all.
    band : (n_channels, n_segments, n_neighbours, n_columns - n_common) array of zeros, written
        Of each other column with itself and with those that follow it, as far as there are such.

    Notes
    -----
    With the gap and the responses :math:`y` (n_columns, n_samples) in units of the noise, and the directions U and
    shrinkage b of a `Change`, signals are whitened by :math:`y - A U^T` with :math:`A = y U \operatorname{diag}(b)`
    over all channels, and the products of a segment are

    .. math:: y y^T - A (U^T y^T) - (y U) A^T + A (U^T U) A^T.
    """
    run, change = split.runs[number], split.changes[number] if split.changes else None
    n_common, n_columns = products.shape[2:]
    n_directions = len(change.directions) if change else 0
    # Directions stand beside the columns until these are whitened by them.
    rows, columns = n_common + n_directions, n_columns + n_directions
    found = np.empty((*products.shape[:2], rows, columns)) if change else products
    for place, (name, measured) in enumerate(run.channels.items()):
        directions = change.directions[:, place] if change else np.empty((0, run.n_samples))
        per_unit = split.per_unit(number, name)
        _fill(
            found[place], band[place], readings[name], measured, counted_from, per_unit, directions, segment_length(run)
        )
    squares = diagonal(found[:, :, :n_common, :n_columns], band).sum(axis=1)
    lost = ~(squares < HUGE**2).all(axis=0)
    if lost.any():
        found[:, :, :n_common][:, :, lost[:n_common]] = 0.0
        found[:, :, :, :n_columns][:, :, :, lost] = 0.0
        for after in range(band.shape[2]):
            either = lost[n_common : n_columns - after] | lost[n_common + after :]
            band[:, :, after, np.flatnonzero(either)] = 0.0
    if change:
        _whiten(found, band, n_common, n_columns, change)
        products[:] = found[:, :, :n_common, :n_columns]
    if lost[0]:
        products[:, :, 0, 0] = DIVERGED**2 * segment_counts(run)
    return np.asarray(lost)


def diagonal(products: FloatArray, band: FloatArray) -> FloatArray:
    """Return the products of each column with itself, (..., n_columns)."""
    return np.concatenate((np.diagonal(products, axis1=-2, axis2=-1), band[..., 0, :]), axis=-1)


def _fill(
    products: FloatArray,
    band: FloatArray,
    readings: FloatArray,
    measured: FloatArray,
    counted_from: Sequence[int],
    per_unit: float,
    directions: FloatArray,
    length: int,
) -> None:
    """Fill in the products of a channel's gap, responses and directions: those of a run, see `segment_products`."""
    n_columns, n_samples = 1 + len(counted_from), len(measured)
    n_rows, n_common = n_columns + len(directions), len(products[0]) - len(directions)
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
        _multiply(stacked, n_common, n_columns, products[segment : segment + whole], band[segment : segment + whole])
        if n > whole * length:
            _multiply(signals[None, :, whole * length :], n_common, n_columns, products[-1:], band[-1:])


def _multiply(signals: FloatArray, n_common: int, n_columns: int, products: FloatArray, band: FloatArray) -> None:
    """Fill in the products of some segments' signals, (n_segments, n_rows, length)."""
    turned = signals.transpose(0, 2, 1)
    if n_common == n_columns:
        np.matmul(signals, turned, out=products)
        return
    np.matmul(signals[:, :n_common], turned, out=products[:, :n_common])
    np.matmul(signals[:, n_columns:], turned, out=products[:, n_common:])
    for after in range(band.shape[1]):
        one, other = signals[:, n_common : n_columns - after], signals[:, n_common + after : n_columns]
        band[:, after, : one.shape[1]] = np.einsum("sit,sit->si", one, other)


def _whiten(found: FloatArray, band: FloatArray, n_common: int, n_columns: int, change: Change) -> None:
    """Whiten the products of columns, in place."""
    along = found[:, :, n_common:, :n_columns].sum(axis=(0, 1)).T * change.shrinkage
    for own, beside in zip(found, band, strict=True):
        across = own[:, n_common:, :n_columns] - 0.5 * own[:, n_common:, n_columns:] @ along.T
        own[:, :n_common, :n_columns] -= along[:n_common] @ across
        own[:, :n_common, :n_columns] -= (along @ across[:, :, :n_common]).transpose(0, 2, 1)
        for after in range(beside.shape[1]):
            one, other = slice(n_common, n_columns - after), slice(n_common + after, n_columns)
            half = np.einsum("id,sdi->si", along[one], across[:, :, other])
            half += np.einsum("id,sdi->si", along[other], across[:, :, one])
            beside[:, after, : half.shape[1]] -= half
