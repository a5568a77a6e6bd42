"""Evidence: responses of variants beside the gap, summed over segments; every fit is made on these sums."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.gap.floor import Floor
from fdbench.gap.hypothesis import Hypothesis
from fdbench.gap.replay import Replay
from fdbench.gap.runs import Run
from fdbench.record import FloatArray

MODEL_ERROR = 0.03
SEGMENT_S = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class Split:
    """Runs, and which samples of each are judged on instead of fitted."""

    runs: Sequence[Run]
    held_out: Sequence[NDArray[np.bool_]]
    floors: Mapping[str, Floor]


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    r"""Products of the gap (column 0) and of responses (other columns) in units of the floor.

    Attributes
    ----------
    products : (n_segments, n_columns, n_columns) array
        Weighted by :math:`1 / (1 + \kappa (g - 1))` with the segment's gap g in units of the floor: an error of the
        responses in proportion to the gap is not read as evidence.
    gaps : (n_segments,) array
        Squared gap without weights.
    counts : (n_segments,) array
        Samples.
    weights : (n_segments,) array
    held_out : (n_segments,) array of bool
    group : (n_segments,) array of int
        The same stretch of time has one group over all channels, for the bootstrap.
    """

    products: FloatArray
    gaps: FloatArray
    counts: FloatArray
    weights: FloatArray
    held_out: NDArray[np.bool_]
    group: NDArray[np.intp]


def gather(
    replay: Replay, split: Split, base: Hypothesis, variants: Sequence[Hypothesis], fitted_only: bool = False
) -> Evidence:
    """Simulate the base and its variants on every run, and sum the products over segments.

    ``fitted_only`` leaves out the runs of which nothing is fitted.
    """
    lanes = [base.variant(), *(item.variant() for item in variants)]
    products, gaps, counts, outs, groups = [], [], [], [], []
    offset = 0
    for run, out in zip(split.runs, split.held_out, strict=True):
        if fitted_only and out.all():
            continue
        simulated = replay.simulate(run, lanes)
        length = max(8, round(SEGMENT_S / run.period_s))
        n_segments = -(-run.n_samples // length)
        filling = n_segments * length - run.n_samples
        for name, measured in run.channels.items():
            signals = simulated[name] - simulated[name][0]
            signals[0] = measured - simulated[name][0]
            signals[~np.isfinite(signals).all(axis=1)] = 0.0
            signals *= np.sqrt(run.repeats) / split.floors[name].rms
            signals = np.pad(signals, ((0, 0), (0, filling)))
            pieces = signals.reshape(len(lanes), n_segments, length).transpose(1, 0, 2)
            products.append(pieces @ pieces.transpose(0, 2, 1))
            count = np.full(n_segments, float(length))
            count[-1] -= filling
            gaps.append(products[-1][:, 0, 0].copy())
            counts.append(count)
            outs.append(out[np.arange(n_segments) * length])
            groups.append(offset + np.arange(n_segments))
        offset += n_segments
    gap, count = np.concatenate(gaps), np.concatenate(counts)
    weight = 1.0 / (1.0 + MODEL_ERROR * np.maximum(gap / count - 1.0, 0.0))
    return Evidence(
        products=np.concatenate(products) * weight[:, None, None],
        gaps=gap,
        counts=count,
        weights=weight,
        held_out=np.concatenate(outs),
        group=np.concatenate(groups),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Coefficients of the chosen columns, found on the training segments.

    Attributes
    ----------
    coefficients : (n_chosen,) array
    train, misfit : float
        Mean squared distance on the training and on the held-out segments, weighted; 1 is noise alone.
    penalty : float
        Squared distance of the values on paper in standard deviations.
    """

    coefficients: FloatArray
    train: float
    misfit: float
    penalty: float


class Scores:
    """Fits on sums over training segments, judged on sums over held-out segments.

    Parameters
    ----------
    evidence : Evidence
    priors : mapping of int to float
        Columns with unit prior, and where they stand before the fit, in standard deviations.
    """

    def __init__(self, evidence: Evidence, priors: Mapping[int, float]) -> None:
        self.priors = dict(priors)
        inside = ~evidence.held_out
        self.train, self.test = evidence.products[inside].sum(axis=0), evidence.products[~inside].sum(axis=0)
        self.train_count = float(np.sum((evidence.weights * evidence.counts)[inside]))
        self.test_count = float(np.sum((evidence.weights * evidence.counts)[~inside]))

    def fit(self, columns: Sequence[int]) -> Fit:
        """Fit the columns by regularised least squares."""
        chosen = list(columns)
        normal = self.train[np.ix_(chosen, chosen)].copy()
        right = self.train[chosen, 0].copy()
        for place, column in enumerate(chosen):
            if column in self.priors:
                normal[place, place] += 1.0
                right[place] -= self.priors[column]
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        theta = np.linalg.solve(normal / np.outer(scale, scale) + 1e-9 * np.eye(len(chosen)), right / scale) / scale
        return Fit(
            coefficients=theta,
            train=self._distance(self.train, chosen, theta) / max(self.train_count, 1.0),
            misfit=self._distance(self.test, chosen, theta) / max(self.test_count, 1.0),
            penalty=self._penalty(chosen, theta),
        )

    def _penalty(self, chosen: list[int], theta: FloatArray) -> float:
        moved = dict(zip(chosen, theta.tolist(), strict=True))
        return float(sum((stand + moved.get(column, 0.0)) ** 2 for column, stand in self.priors.items()))

    @staticmethod
    def _distance(sums: FloatArray, chosen: list[int], theta: FloatArray) -> float:
        inner = sums[np.ix_(chosen, chosen)]
        return float(sums[0, 0] - 2.0 * theta @ sums[chosen, 0] + theta @ inner @ theta)
