"""What several parts compute alike: the root mean square, and the seeded bootstrap with the interval that follows."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def rms(values: FloatArray) -> float:
    """Return the root mean square.

    >>> rms(np.array([3.0, -3.0]))
    3.0
    """
    return float(np.sqrt(np.mean(np.square(values))))


def drawn_counts(groups: NDArray[Any], n_resamples: int, seed: int = 0) -> FloatArray:
    """Return how often each row is drawn, (n_resamples, n); rows of a group are drawn together (cluster bootstrap).

    Groups are drawn with replacement, as many as there are.

    Parameters
    ----------
    groups : (n,) array
        Name of the group of each row; all different where each row is drawn on its own.
    n_resamples, seed : int

    References
    ----------
    A. C. Davison, D. V. Hinkley, Bootstrap Methods and their Application, 1997, section 3.8.

    Examples
    --------
    >>> drawn_counts(np.array([7, 7, 9]), 2, seed=1).tolist()
    [[1.0, 1.0, 1.0], [2.0, 2.0, 0.0]]
    """
    names, place = np.unique(groups, return_inverse=True)
    return _drawn(len(names), n_resamples, seed)[:, place]


@lru_cache(maxsize=4)
def _drawn(n: int, n_resamples: int, seed: int) -> FloatArray:
    """Return how often each of n groups is drawn, (n_resamples, n)."""
    counts = np.random.default_rng(seed).multinomial(n, np.full(n, 1.0 / n), size=n_resamples)
    return counts.astype(np.float64)


def drawn_rows(strata: NDArray[Any], n_resamples: int, seed: int = 0) -> NDArray[np.intp]:
    """Return which rows are drawn, (n_resamples, n), with replacement within each stratum (stratified bootstrap).

    Parameters
    ----------
    strata : (n,) array
        Name of the stratum of each row; all alike where there is one. Its rows are drawn in its own places.
    n_resamples, seed : int

    References
    ----------
    A. C. Davison, D. V. Hinkley, Bootstrap Methods and their Application, 1997, section 3.2.

    Examples
    --------
    >>> drawn_rows(np.array([0, 0, 1]), 2).tolist()
    [[1, 1, 2], [1, 0, 2]]
    """
    rng = np.random.default_rng(seed)
    rows = np.empty((n_resamples, len(strata)), dtype=np.intp)
    for name in np.unique(strata):
        own = np.flatnonzero(strata == name)
        rows[:, own] = rng.choice(own, size=(n_resamples, len(own)))
    return rows


def percentile_interval(resampled: FloatArray) -> FloatArray:
    """Return the bounds of the 95 % percentile interval along the first axis, (2, ...).

    References
    ----------
    B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982, section 10.4.

    Examples
    --------
    >>> percentile_interval(np.arange(201.0)).tolist()
    [5.0, 195.0]
    """
    return np.asarray(np.percentile(resampled, [2.5, 97.5], axis=0))
