"""Products of the gap and of responses of one run, summed over its segments, in units of the noise.

Readings of many hypotheses are far larger than the processor's cache, and are gone through once: what is counted from
another reading, scaled and multiplied is a piece that fits. Changes from run to run are whitened in the sums.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.evidence.response_columns import ResponseColumns
from fdbench.diagnosis.evidence.run_to_run import Change
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.kept_responses import Block
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.settings import EVIDENCE
from fdbench.record import FloatArray

HUGE = 1e30  # gap or response of a simulation that diverges, while its square is still a number
AT_ONCE = 2**18  # readings of all columns together, which stay in the processor's cache
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
    columns: ResponseColumns,
    new: Block,
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
        Each channel as what is asked for reads it, (n_asked, n_samples).
    columns : ResponseColumns
        Of hypotheses; one that diverges has no response.
    new : mapping of str to (n_to_keep, n_samples) array, written
        Of each channel, the responses that are to be kept.
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
    found = np.empty((*products.shape[:2], n_common + n_directions, n_columns + n_directions)) if change else products
    known = columns.kept.products(columns.pairs)
    for place, (name, measured) in enumerate(run.channels.items()):
        per_unit = split.per_unit(number, name)
        directions = change.directions[:, place] / per_unit if change else np.empty((0, run.n_samples))
        signals = _Signals(name, measured, readings[name], columns, directions, new[name])
        _fill(found[place], band[place], signals, n_common, known.get(name), segment_length(run))
    columns.kept.keep(columns.to_keep, new)
    if n_common > len(columns.pairs) > 0:
        of_pairs = slice(1, 1 + len(columns.pairs))
        own = {name: found[place][:, of_pairs, of_pairs] for place, name in enumerate(run.channels)}
        columns.kept.keep_products(columns.pairs, own)
    for place, name in enumerate(run.channels):
        found[place] *= split.per_unit(number, name) ** 2
        band[place] *= split.per_unit(number, name) ** 2
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


@dataclass(frozen=True, eq=False)
class _Signals:
    """The gap of a channel, its responses, and directions of what changes, piece by piece; new ones are kept."""

    name: str
    measured: FloatArray
    readings: FloatArray
    columns: ResponseColumns
    directions: FloatArray
    new: FloatArray

    def fill(self, signals: FloatArray, piece: slice) -> None:
        """Fill in a piece of each signal, (n_columns + n_directions, n)."""
        read, origins, new = self.readings[:, piece], self.columns.counted_from, self.columns.new
        np.subtract(self.measured[piece], read[0], out=signals[0])
        for stretch in self.columns.stretches:
            rows = slice(1 + stretch.asked.start, 1 + stretch.asked.stop)
            signals[rows] = stretch.block[self.name][stretch.rows, piece]
        if len(new):
            responses = read[1 : 1 + len(new)], read[origins] if origins.any() else read[0]
            if new[-1] - new[0] + 1 == len(new):
                np.subtract(*responses, out=signals[new[0] : new[-1] + 1])
            else:
                signals[new] = np.subtract(*responses)
            self.new[:, piece] = signals[new[: len(self.new)]]
        signals[self.columns.n_columns :] = self.directions[:, piece]


def _fill(
    products: FloatArray, band: FloatArray, signals: _Signals, n_common: int, known: FloatArray | None, length: int
) -> None:
    """Fill in the products of a channel's signals: those of a run, see `segment_products`."""
    n_samples, n_columns = len(signals.measured), signals.columns.n_columns
    n_rows = n_columns + len(signals.directions)
    at_once = min(length * max(1, AT_ONCE // (n_rows * length)), n_samples)
    buffer = np.empty((n_rows, at_once))
    for first in range(0, n_samples, at_once):
        n = min(at_once, n_samples - first)
        signals.fill(buffer[:, :n], slice(first, first + n))
        whole, segment = n // length, first // length
        parts = [(slice(segment, segment + whole), buffer[:, : whole * length].reshape(n_rows, whole, length))]
        if n > whole * length:
            parts.append((slice(segment + whole, segment + whole + 1), buffer[:, None, whole * length : n]))
        for part, own in parts:
            of_part = None if known is None else known[part]
            _multiply(own.transpose(1, 0, 2), n_common, n_columns, of_part, products[part], band[part])


def _multiply(
    signals: FloatArray, n_common: int, n_columns: int, known: FloatArray | None, products: FloatArray, band: FloatArray
) -> None:
    """Fill in the products of some segments' signals, (n_segments, n_rows, length), that are not ``known``."""
    turned = signals.transpose(0, 2, 1)
    if n_common < n_columns:
        np.matmul(signals[:, :n_common], turned, out=products[:, :n_common])
        np.matmul(signals[:, n_columns:], turned, out=products[:, n_common:])
        for after in range(band.shape[1]):
            one, other = signals[:, n_common : n_columns - after], signals[:, n_common + after : n_columns]
            band[:, after, : one.shape[1]] = np.einsum("sit,sit->si", one, other)
    elif known is None:
        np.matmul(signals, turned, out=products)
    else:
        others = known.shape[-1] + 1
        np.matmul(signals[:, :1], turned, out=products[:, :1])
        np.matmul(signals[:, others:], turned, out=products[:, others:])
        products[:, 1:others, 1:others] = known
        products[:, 1:others, 0] = products[:, 0, 1:others]
        products[:, 1:others, others:] = products[:, others:, 1:others].transpose(0, 2, 1)


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
