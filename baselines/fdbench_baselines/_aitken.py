r"""Generalised least squares, and instrumental variables, where the errors of a linear model go on for many rows.

.. math::
    y = X \theta + n, \quad n_k = \sum_{i=1}^q a_i n_{k-i} + \varepsilon_k, \qquad
    \hat\theta = (\tilde W^T \tilde X)^{-1} \tilde W^T \tilde y, \quad \tilde x_k = x_k - \sum_i a_i x_{k-i}

with a from the autocovariance of the errors, in turn with :math:`\hat\theta`. W = X is generalised least squares; a
W without noise are instruments. The covariance lets what is left of :math:`\tilde w_k \varepsilon_k` go together within
blocks of rows, :math:`(\tilde W^T \tilde X)^{-1} \sum_b s_b s_b^T (\tilde X^T \tilde W)^{-1}` with s the sum over a
block. A row after one that is not to be trusted is left out for as long as the filter
remembers that one; rows that stand out count less (`_robust`).

References
----------
Aitken, On least squares and linear combination of observations, Proc. Royal Society of Edinburgh 55 (1935); Cochrane
and Orcutt, J. American Statistical Association 44 (1949), 32-61; Young, Recursive estimation and time-series
analysis, 2nd ed. 2011, chapter 7 (the same filter on instruments); Liang and Zeger, Biometrika 73 (1986), 13-22
(blocks).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.estimator import FloatArray
from fdbench_baselines._robust import loudness

PASSES = 4
BLOCK = 100
RIDGE = 1e-9  # of the variance, on the diagonal: lines of a spectrum leave the equations without a digit else


class Solution(NamedTuple):
    """Coefficients (m,) and their covariance (m, m)."""

    theta: FloatArray
    covariance: FloatArray


def autoregression(errors: FloatArray, lags: int) -> FloatArray:
    r"""Return the filter :math:`(1, -a_1 \ldots -a_q)` of a series by the equations of Yule and Walker.

    >>> rng = np.random.default_rng(0)
    >>> n = np.zeros(20000)
    >>> for k in range(1, len(n)):
    ...     n[k] = 0.8 * n[k - 1] + rng.standard_normal()
    >>> autoregression(n, 2).round(1) + 0.0
    array([ 1. , -0.8,  0. ])
    """
    from scipy.linalg import solve_toeplitz

    if lags == 0:
        return np.ones(1)
    n = len(errors)
    power = np.abs(np.fft.rfft(errors, 2 * n)) ** 2
    autocovariance = np.fft.irfft(power)[: lags + 1] / n
    if autocovariance[0] == 0.0:
        return np.append(1.0, np.zeros(lags))
    autocovariance[0] *= 1.0 + RIDGE
    return np.append(1.0, -solve_toeplitz(autocovariance[:lags], autocovariance[1:]))


def generalised(
    X: FloatArray, y: FloatArray, trusted: NDArray[np.bool_], start: FloatArray, lags: int, W: FloatArray | None = None
) -> Solution:
    """Solve for the coefficients.

    Parameters
    ----------
    X, y : (n, m), (n,) arrays
        Uniformly sampled rows.
    trusted : (n,) array of bool
        Rows on which the model holds.
    start : (m,) array
        Coefficients whose errors the first filter is made from.
    lags : int
        q; 0 leaves the errors as they are.
    W : (n, m) array, optional
        Instruments.
    """
    from scipy.signal import fftconvolve

    kept = trusted & (np.convolve(~trusted, np.ones(lags + 1))[: len(y)] < 0.5)
    kept[:lags] = False
    theta, loud = start, np.ones(int(kept.sum()))
    for _ in range(PASSES):
        taps = autoregression(np.where(trusted, y - X @ theta, 0.0), lags)
        Xf, yf = (fftconvolve(part, taps[:, None], axes=0)[: len(y)][kept] for part in (X, y[:, None]))
        yf = yf[:, 0]
        Wf = Xf if W is None else fftconvolve(W, taps[:, None], axes=0)[: len(y)][kept]
        scale = np.sqrt(np.mean(Xf**2, axis=0))
        scale[scale == 0.0] = 1.0
        weighted = Wf / scale / loud[:, None]
        bread = np.linalg.pinv(weighted.T @ (Xf / scale))
        theta = bread @ (weighted.T @ yf) / scale
        errors = yf - Xf @ theta
        loud = loudness(errors)
    pull = np.zeros((-(-len(y) // BLOCK) * BLOCK, X.shape[1]))
    pull[: len(y)][kept] = weighted * errors[:, None]
    sums = pull.reshape(-1, BLOCK, X.shape[1]).sum(axis=1)
    covariance = bread @ (sums.T @ sums) @ bread.T / np.outer(scale, scale)
    return Solution(theta, 0.5 * (covariance + covariance.T))
