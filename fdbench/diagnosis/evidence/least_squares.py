"""Least squares on sums over segments: fits on the training segments, judged on the held-out ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evidence.evidence import Evidence, misfit
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Coefficients of the chosen columns, found on the training segments.

    Attributes
    ----------
    coefficients : (n_chosen,) array
    train, misfit : float
        On the training and on the held-out segments; 1 is noise alone.
    squares : float
        Weighted squared distance on the training segments.
    """

    coefficients: FloatArray
    train: float
    misfit: float
    squares: float


class Scores:
    """Fits on sums over training segments, judged on sums over held-out segments.

    Parameters
    ----------
    evidence : Evidence
    priors : mapping of int to pair of floats
        Columns with a prior: where they stand before the fit, in standard deviations, and the weight of their squares.
    limits : mapping of int to pair of floats
        Columns whose coefficients are bounded, and between what.
    """

    def __init__(
        self, evidence: Evidence, priors: Mapping[int, tuple[float, float]], limits: Mapping[int, tuple[float, float]]
    ) -> None:
        self.priors, self.limits = dict(priors), dict(limits)
        inside = ~evidence.held_out
        self.train, self.test = evidence.sums
        self._parts = [(evidence.weights[part], evidence.counts[part]) for part in (inside, ~inside)]

    def fit(self, columns: Sequence[int], damping: float = 0.0) -> Fit:
        """Fit the columns by regularised least squares, the diagonal of the normal matrix raised by ``damping``.

        Coefficients beyond their limits are held there, and the others fitted again beside them.
        """
        chosen = list(columns)
        normal, right = self.normal(chosen), self.train[chosen, 0].copy()
        normal[np.diag_indices(len(chosen))] *= 1.0 + damping
        for place, column in enumerate(chosen):
            stand, weight = self.priors.get(column, (0.0, 0.0))
            right[place] -= weight * stand
        low, high = np.array([self.limits.get(column, (-np.inf, np.inf)) for column in chosen]).T
        theta, free = solved(normal, right), np.ones(len(chosen), dtype=np.bool_)
        while (beyond := free & ((theta < low) | (theta > high))).any():
            free &= ~beyond
            theta = np.clip(theta, low, high)
            rest = right[free] - normal[np.ix_(free, ~free)] @ theta[~free]
            theta[free] = solved(normal[np.ix_(free, free)], rest)
        fitted, judged = (distance(sums, chosen, theta) for sums in (self.train, self.test))
        return Fit(
            coefficients=theta,
            train=float(misfit(fitted, *self._parts[0])),
            misfit=float(misfit(judged, *self._parts[1])),
            squares=fitted,
        )

    def normal(self, columns: Sequence[int]) -> FloatArray:
        """Return the normal matrix of the columns, priors included."""
        chosen = list(columns)
        normal: FloatArray = self.train[np.ix_(chosen, chosen)].copy()
        normal[np.diag_indices(len(chosen))] += [self.priors.get(column, (0.0, 0.0))[1] for column in chosen]
        return normal


def solved(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of normal equations, or of each of a stack of them, scaled and held off singularity."""
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), 1e-30))
    held = normal / (scale[..., :, None] * scale[..., None, :]) + 1e-9 * np.eye(scale.shape[-1])
    return np.asarray(np.linalg.solve(held, (right / scale)[..., None])[..., 0] / scale)


def distance(sums: FloatArray, columns: Sequence[int], theta: FloatArray) -> float:
    """Return the squared distance of the gap, column 0, from columns with the coefficients theta."""
    inner = sums[np.ix_(columns, columns)]
    return float(sums[0, 0] - 2.0 * theta @ sums[columns, 0] + theta @ inner @ theta)
