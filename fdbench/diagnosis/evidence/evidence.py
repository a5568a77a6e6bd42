"""Evidence: responses of variants beside the gap, summed over segments; every fit is made on these sums."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.evidence.at_limit import at_limit
from fdbench.diagnosis.evidence.response_columns import ResponseColumns
from fdbench.diagnosis.evidence.segment_products import (
    DIVERGED,
    diagonal,
    segment_counts,
    segment_length,
    segment_products,
)
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.settings import EVIDENCE
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    r"""Products of the gap (column 0) and of responses (other columns) in units of the floor.

    Attributes
    ----------
    products : (n_segments, n_common, n_columns) array
        Of the first columns with all.
    band : (n_segments, n_neighbours, n_columns - n_common) array
        Of each other column with itself and with those that follow it: what is never fitted together has no product.
    counts : (n_segments,) array
        Samples.
    weights : (n_segments,) array
        :math:`w = 1 / (1 + \kappa (g - 1) + \kappa_0 (g_0 - 1))` with the segment's gap g in units of the floor, and
        that of the model without effects: an error of the responses in proportion to the gap, or of effects in
        proportion to what they explain, is not read as evidence. 0 where a controller is `at_limit`.
    held_out : (n_segments,) array of bool
    group : (n_segments,) array of int
        The same stretch of time has one group over all channels, for the bootstrap.
    run, channel : (n_segments,) array of int
        Place in those of the split, and in those of the run.
    lost : (n_columns,) array of bool
        Variants that diverge: they have no response in any fit, and are as far off as can be where they are tried.
    """

    products: FloatArray
    band: FloatArray
    counts: FloatArray
    weights: FloatArray
    held_out: NDArray[np.bool_]
    group: NDArray[np.intp]
    run: NDArray[np.intp]
    channel: NDArray[np.intp]
    lost: NDArray[np.bool_]

    def misfits(self, held_out: bool) -> FloatArray:
        r"""Return the misfit of the base and of each variant on one part, (n_columns,).

        .. math:: M = 1 + \sum_s w_s (g_s - n_s) / \sum_s n_s

        so that 1 is noise alone, and no base exceeds :math:`1 + 1 / \kappa`.
        """
        part = self.held_out == held_out
        return misfit(self.squares(held_out), self.weights[part], self.counts[part])

    @property
    def gaps(self) -> FloatArray:
        """Squared gap of the base, (n_segments,)."""
        return self.products[:, 0, 0]

    def squared_gaps(self) -> FloatArray:
        """Return the squared gap of the base and of each variant, (n_segments, n_columns)."""
        return self._squared_gaps(self.diagonal, self.products[:, 0], self.counts[:, None])

    def squares(self, held_out: bool) -> FloatArray:
        """Return the same, weighted and summed over one part, (n_columns,)."""
        sums, part = self.sums[int(held_out)], self.held_out == held_out
        return self._squared_gaps(np.diagonal(sums), sums[0], float(self.weights[part] @ self.counts[part]))

    def _squared_gaps(self, squares: FloatArray, with_gap: FloatArray, counts: FloatArray | float) -> FloatArray:
        """Return the squared distance of the gap from no response and from each, (..., n_columns), by their products.

        That of a variant that diverges is by ``counts``, how many weighted samples the products are of.
        """
        own = squares.copy()
        own[..., 1:] += with_gap[..., :1] - 2.0 * with_gap[..., 1:]
        own[..., self.lost] = DIVERGED**2 * counts
        return own

    def by_group(self, held_out: bool) -> FloatArray:
        """Return the weighted squared gaps on one part, summed over the channels of a group, (n_groups, n_columns)."""
        part = self.held_out == held_out
        return summed((self.squared_gaps() * self.weights[:, None])[part], self.group[part])

    @property
    def diagonal(self) -> FloatArray:
        """Products of each column with itself, (n_segments, n_columns)."""
        return diagonal(self.products, self.band)

    @cached_property
    def sums(self) -> FloatArray:
        """Weighted products summed over the training and over the held-out segments, (2, n_columns, n_columns)."""
        parts = np.stack([~self.held_out, self.held_out]) * self.weights
        n_common, n_columns = self.products.shape[1:]
        sums = np.zeros((2, n_columns, n_columns))
        sums[:, :n_common] = np.tensordot(parts, self.products, 1)
        sums[:, n_common:, :n_common] = sums[:, :n_common, n_common:].transpose(0, 2, 1)
        for after, own in enumerate(np.tensordot(parts, self.band, 1).transpose(1, 0, 2)):
            place = np.arange(n_common, n_columns - after)
            sums[:, place, place + after] = sums[:, place + after, place] = own[:, : len(place)]
        return sums

    def of_run(self, place: int) -> "Evidence":
        """Return the evidence of one run, by its place in the split."""
        own = self.run == place
        parts = {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}
        return Evidence(**{name: value if name == "lost" else value[own] for name, value in parts.items()})

    def worst(self) -> float:
        """Return the mean squared gap of the stretch of time in which it is largest, over all channels.

        Only of stretches that have a weight.
        """
        weighty = self.weights > 0.0
        _, place = np.unique(self.group[weighty], return_inverse=True)
        gaps, counts = (np.bincount(place, values[weighty]) for values in (self.gaps, self.counts))
        return float(np.max(gaps / counts))

    def sizes(self, split: Split) -> FloatArray:
        """Return the mean square of each column in the run where that is most, in units of what repeats differ by."""
        within = np.array([(floor.rms / floor.total) ** 2 for floor in split.noise_models.values()])[self.channel]
        repeats = np.array([run.repeats for run in split.runs])[self.run]
        squares = self.diagonal * (within / repeats)[:, None]
        return np.asarray((summed(squares, self.run) / summed(self.counts[:, None], self.run)).max(axis=0))


def summed(values: FloatArray, groups: NDArray[np.intp]) -> FloatArray:
    """Return the sums of the rows of each group, (n_groups, n_columns)."""
    found, place = np.unique(groups, return_inverse=True)
    sums = np.zeros((len(found), values.shape[1]))
    np.add.at(sums, place, values)
    return sums


def gather(
    readings: Readings,
    split: Split,
    base: Hypothesis,
    variants: Sequence[Hypothesis],
    places: Sequence[int] | None = None,
    keep: Sequence[Hypothesis] = (),
    about: Sequence[Hypothesis] = (),
    common: int | None = None,
    neighbours: int = 1,
    kept: int = 0,
) -> Evidence:
    """Sum the products of the gap of a base and of the responses of its variants over the segments of runs.

    Parameters
    ----------
    readings : Readings
        Of the runs of the split.
    split : Split
    base : Hypothesis
        Its readings are kept.
    variants : sequence of Hypothesis
        One that diverges has no response.
    places : sequence of int, optional
        Of the runs, such as ``split.fitted``; without, all.
    keep : sequence of Hypothesis
        Variants whose readings are kept, too.
    about : sequence of Hypothesis, optional
        What the response of each variant is counted from; without, the base.
    common : int, optional
        Of the columns, the gap first, those that are fitted together with any other; without, all.
    neighbours : int
        Of the others, how many in a row are fitted together.
    kept : int
        Of the variants, how many first ones have responses that are kept, and not simulated again.
    """
    numbers = range(len(split.runs)) if places is None else places
    responses = [*zip(variants, about or [base] * len(variants), strict=True)]
    columns = {number: ResponseColumns.of(base, responses, readings.responses[number], kept) for number in numbers}
    segments = [segment_counts(split.runs[number]) for number in numbers]
    n_columns, n_channels = 1 + len(variants), len(split.noise_models)
    n_common, n_segments = min(common or n_columns, n_columns), n_channels * sum(map(len, segments))
    products = np.empty((n_segments, n_common, n_columns))
    band = np.zeros((n_segments, neighbours, n_columns - n_common))
    counts, outs, groups, owners, channels, known, limited = [], [], [], [], [], [], []
    first = offset = 0
    lost = np.zeros(n_columns, dtype=np.bool_)
    asked = {number: own.asked for number, own in columns.items()}
    simulated = readings.each(asked, [base, *keep], lent=True)
    for number, count, own in zip(numbers, segments, simulated, strict=True):
        run, out, n = split.runs[number], split.held_out[number], len(count)
        new = readings.responses[number].room(run, len(columns[number].to_keep))
        last = first + n_channels * n
        written = (part[first:last].reshape(n_channels, n, *part.shape[1:]) for part in (products, band))
        lost |= segment_products(split, number, own, columns[number], new, *written)
        at_its_limit = at_limit(run, base.nominal.drive)
        for place, name in enumerate(run.channels):
            counts.append(count)
            limited.append(at_its_limit)
            outs.append(out[:: segment_length(run)])
            groups.append(offset + np.arange(n))
            owners.append(np.full(n, number))
            channels.append(np.full(n, place))
            known.append(split.explained[number][name] if split.explained else count)
        first, offset = last, offset + n
    every = np.concatenate(counts)
    excess, explained = (np.maximum(item / every - 1.0, 0.0) for item in (products[:, 0, 0], np.concatenate(known)))
    weights = 1.0 / (1.0 + EVIDENCE.model_error * excess + EVIDENCE.explained_error * explained)
    nowhere = np.concatenate(limited)
    return Evidence(
        products=products,
        band=band,
        counts=every,
        weights=weights if nowhere.all() else np.where(nowhere, 0.0, weights),
        held_out=np.concatenate(outs),
        group=np.concatenate(groups),
        run=np.concatenate(owners),
        channel=np.concatenate(channels),
        lost=lost,
    )


def fitted_part(readings: Readings, split: Split) -> tuple[Readings, Split]:
    """Return readings and split of each run up to the segment after which nothing of it is fitted.

    What comes later moves nothing before, so a fit need not simulate it. Runs in which whole runs are whitened, and
    those of which nothing or all is fitted, stay as they are.
    """
    runs, explained = [*split.runs], [*split.explained]
    for place in split.fitted:
        run, length = runs[place], segment_length(runs[place])
        n_segments = -(-int(np.flatnonzero(~split.held_out[place])[-1] + 1) // length)
        if n_segments * length < run.n_samples and not (split.changes and split.changes[place]):
            runs[place] = run.up_to(n_segments * length)
            if explained:
                explained[place] = {name: own[:n_segments] for name, own in explained[place].items()}
    if all(run is own for run, own in zip(runs, split.runs, strict=True)):
        return readings, split
    held_out = [out[: run.n_samples] for out, run in zip(split.held_out, runs, strict=True)]
    part = dataclasses.replace(split, runs=runs, held_out=held_out, explained=explained)
    return readings.up_to(runs), part


def misfit(squares: FloatArray | float, weights: FloatArray, counts: FloatArray) -> FloatArray:
    """Return the misfit of weighted squares that are summed over segments."""
    return np.asarray(1.0 + (squares - np.sum(weights * counts)) / max(float(counts.sum()), 1.0))


def with_explained(split: Split, evidence: Evidence) -> Split:
    """Return the split with the gaps of a model without effects, which is what effects explain at most."""
    explained = [
        {
            name: evidence.gaps[(evidence.run == place) & (evidence.channel == index)]
            for index, name in enumerate(run.channels)
        }
        for place, run in enumerate(split.runs)
    ]
    return dataclasses.replace(split, explained=explained)
