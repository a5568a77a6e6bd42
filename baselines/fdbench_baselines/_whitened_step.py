r"""One step of Gauss and Newton in the parameters of a simulation, its errors whitened by an autoregression.

.. math::
    y - \hat y(\theta) - X_w c = n, \quad A(q) n = \varepsilon, \qquad
    (\hat d, \hat c) = \arg\min \sum_k \frac{1}{\ell_k}
        \big(A(q) (y - \hat y(\theta) - S d - X_w c)_k\big)^2 + \sigma^2 |(\theta + d, c)|_P^2

with :math:`S = \partial \hat y / \partial \theta`, A from what the last step left, :math:`\ell_k \ge 1` for rows that
stand out (`_robust`) and P the precision of what is known of both beforehand, :math:`|z|_P^2 = z^T P z`. The
covariance lets errors go together within blocks of rows, as that of `_aitken`.

References
----------
Ljung, System Identification, 2nd ed. 1999, sections 4.2 (output error), 7.2 (prefilters) and 10.2 (Gauss-Newton).
"""

from typing import NamedTuple

import numpy as np

from fdbench.estimator import FloatArray
from fdbench_baselines._aitken import BLOCK, autoregression
from fdbench_baselines._robust import robust_residual


class WhitenedStep(NamedTuple):
    """Change d (q,) of the parameters, its covariance (q, q), and the coefficients c (m,) beside."""

    change: FloatArray
    covariance: FloatArray
    beside: FloatArray


def whitened_step(
    S: FloatArray,
    beside: FloatArray,
    left: FloatArray,
    noise: FloatArray,
    settings: FloatArray,
    P: FloatArray,
    lags: int,
) -> WhitenedStep:
    """Return the step.

    Parameters
    ----------
    S, beside : (n, q), (n, m) arrays
        Sensitivities, and columns X_w.
    left, noise : (n,) arrays
        What the simulation leaves of the record, and what is left of that by the columns beside.
    settings : (q,) array
        The parameters.
    P : (q + m, q + m) array
        Precision of parameters and coefficients beforehand, about 0.
    lags : int
        Order of A.
    """
    from scipy.signal import fftconvolve

    q = S.shape[1]
    taps = autoregression(noise, lags)
    white = fftconvolve(np.hstack((S, beside, left[:, None])), taps[:, None], axes=0)[lags : len(left)]
    X, y = white[:, :-1], white[:, -1]
    scale = np.sqrt(np.mean(X**2, axis=0))
    scale[scale == 0.0] = 1.0
    # What the record's own step leaves says which rows stand out: the errors before still hold that step.
    errors, loud = robust_residual(X / scale, y)
    variance = float(np.mean(errors**2 / loud))
    known = variance * P / np.outer(scale, scale)
    weighted = X / scale / loud[:, None]
    bread = np.linalg.pinv(weighted.T @ (X / scale) + known)
    solution = bread @ (weighted.T @ y - known[:, :q] @ (settings * scale[:q])) / scale
    pulls = np.zeros((-(-len(y) // BLOCK) * BLOCK, X.shape[1]))
    pulls[: len(y)] = weighted * (y - X @ solution)[:, None]
    sums = pulls.reshape(-1, BLOCK, X.shape[1]).sum(axis=1)
    covariance = (bread @ (sums.T @ sums + variance * known) @ bread.T / np.outer(scale, scale))[:q, :q]
    return WhitenedStep(solution[:q], 0.5 * (covariance + covariance.T), solution[q:])
