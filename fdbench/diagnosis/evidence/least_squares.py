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
    penalty : float
        Squared distance of the nominal parameters in standard deviations.
    """

    coefficients: FloatArray
    train: float
    misfit: float
    squares: float
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
        self._parts = [(evidence.weights[part], evidence.counts[part]) for part in (inside, ~inside)]

    def fit(self, columns: Sequence[int], damping: float = 0.0) -> Fit:
        """Fit the columns by regularised least squares, the diagonal of the normal matrix raised by ``damping``."""
        chosen = list(columns)
        normal, right = self.normal(chosen), self.train[chosen, 0].copy()
        normal[np.diag_indices(len(chosen))] *= 1.0 + damping
        for place, column in enumerate(chosen):
            right[place] -= self.priors.get(column, 0.0)
        theta = solved(normal, right)
        fitted, judged = (distance(sums, chosen, theta) for sums in (self.train, self.test))
        return Fit(
            coefficients=theta,
            train=float(misfit(fitted, *self._parts[0])),
            misfit=float(misfit(judged, *self._parts[1])),
            squares=fitted,
            penalty=self._penalty(chosen, theta),
        )

    def normal(self, columns: Sequence[int]) -> FloatArray:
        """Return the normal matrix of the columns, priors included."""
        chosen = list(columns)
        normal: FloatArray = self.train[np.ix_(chosen, chosen)].copy()
        normal[np.diag_indices(len(chosen))] += [float(column in self.priors) for column in chosen]
        return normal

    def _penalty(self, chosen: list[int], theta: FloatArray) -> float:
        moved = dict(zip(chosen, theta.tolist(), strict=True))
        return float(sum((stand + moved.get(column, 0.0)) ** 2 for column, stand in self.priors.items()))


def solved(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of normal equations, or of each of a stack of them, scaled and held off singularity."""
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), 1e-30))
    held = normal / (scale[..., :, None] * scale[..., None, :]) + 1e-9 * np.eye(scale.shape[-1])
    return np.asarray(np.linalg.solve(held, (right / scale)[..., None])[..., 0] / scale)


def distance(sums: FloatArray, columns: Sequence[int], theta: FloatArray) -> float:
    """Return the squared distance of the gap, column 0, from columns with the coefficients theta."""
    inner = sums[np.ix_(columns, columns)]
    return float(sums[0, 0] - 2.0 * theta @ sums[columns, 0] + theta @ inner @ theta)
