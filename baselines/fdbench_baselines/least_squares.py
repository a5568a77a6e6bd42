"""Least squares in the time domain."""

from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, Regression
from fdbench.record import Record
from fdbench_baselines._mixed_estimation import learnable
from fdbench_baselines._one_step import declined, residual_model

FloatArray = NDArray[np.float64]


class Factors(NamedTuple):
    """Singular value decomposition of regressors with columns of unit length, Z = U diag(s) V' diag(scale)."""

    u: FloatArray
    s: FloatArray
    vt: FloatArray
    scale: FloatArray


def factorise(regressors: FloatArray, names: Sequence[str]) -> Factors:
    """Decompose regressors of full rank; column scaling makes the result independent of units.

    Raises
    ------
    SpecError
        If there are not more rows than parameters, or if some parameters cannot be identified; it names them.
    """
    n, p = regressors.shape
    if n <= p:
        raise SpecError(f"regression: {n} rows for {p} parameters; more rows than parameters are needed.")
    scale = np.linalg.norm(regressors, axis=0)
    scale[scale == 0.0] = 1.0
    u, s, vt = np.linalg.svd(regressors / scale, full_matrices=False)
    null = vt[s <= n * np.finfo(np.float64).eps * s[0]]
    if len(null) > 0:
        lost = [name for name, share in zip(names, np.abs(null).max(axis=0), strict=True) if share > 1e-6]
        raise SpecError(
            f"regression: {', '.join(lost)} cannot be identified: the regressor columns are zero or linearly dependent "
            f"(rank {p - len(null)} of {p}). Does the record excite them all, such as both directions of motion?"
        )
    return Factors(u, s, vt, scale)


@final
class LeastSquares(BatchEstimator):
    r"""Ordinary least squares, which takes the disturbance for white noise.

    .. math:: \hat\beta = (Z^T Z)^{-1} Z^T y, \quad
              \mathrm{cov} = s^2 (Z^T Z)^{-1}, \quad s^2 = \frac{|y - Z \hat\beta|^2}{n - p}

    ``output`` is :math:`Z \hat\beta`, its variance that of a new observation, :math:`s^2 (1 + z^T (Z^T Z)^{-1} z)`;
    ``disturbance_N`` is the residual divided by the disturbance gain, all that the method says about it.
    Biased where the disturbance is correlated with the regressors, as it is under feedback.

    Where the data sheet says how exact it is, rows of inverse dynamics off the straight line of its friction are left
    out (`learnable`), since a few reversals of an axis would outweigh all other rows; the force is 0 there.

    A model in state space has no parameters; where the readings give all states, its equation leaves a force at each
    sample, buried in noise. There the force is that of least squares about each sample, constant over ``window_s``: the
    mean of what is left, with the variance of a mean.

    Parameters
    ----------
    window_s : float
        Width of the window, s; above 0.

    Raises
    ------
    SpecError
        If the record does not identify every parameter, or the window is not above 0.

    References
    ----------
    C. F. Gauss, Theoria combinationis observationum, 1823; McPherson, thesis, 2024, eq. 2.8.

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4.

    >>> from fdbench_baselines._example import example_drive
    >>> found = LeastSquares().fit(*example_drive(mass_ratio=1.25))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.4, 'beta_2': 0.6}
    """

    def __init__(self, window_s: float = 0.05) -> None:
        if not 0.0 < window_s < np.inf:
            raise SpecError(f"least_squares: window_s = {window_s} must be above 0 and finite.")
        self.window_s = window_s

    def skip(self, context: Context) -> str | None:
        """Return why the estimator does not apply, or None."""
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Solve for the parameters by a singular value decomposition of the scaled regressors."""
        regression, predicted = residual_model(context, context.regression(record))
        if predicted is not None:
            return self._held(regression, predicted)
        y, names = regression.target, regression.names
        Z, learnt = regression.regressors, learnable(context, regression.regressors)
        u, s, vt, scale = factorise(Z[learnt], names)
        root = vt.T / s / scale[:, None]
        beta = root @ (u.T @ y[learnt])
        output = Z @ beta
        residual = y - output
        variance = float(residual[learnt] @ residual[learnt]) / (int(learnt.sum()) - len(names))
        covariance = variance * root @ root.T
        return Estimate(
            parameters=dict(zip(names, beta.tolist(), strict=True)),
            covariance=covariance,
            disturbance_N=np.where(learnt, residual, 0.0) / regression.disturbance_gain,
            output=output,
            output_variance=variance + np.einsum("ij,jk,ik->i", Z, covariance, Z),
        )

    def _held(self, regression: Regression, predicted: FloatArray) -> Estimate:
        """Return the mean of what the equation leaves in a window about each sample, shorter at the ends."""
        n, gain, left = len(regression.target), regression.disturbance_gain, regression.target
        half = max(int(0.5 * self.window_s / regression.sampling_time_s), 1)
        first, last = np.maximum(np.arange(n) - half, 0), np.minimum(np.arange(n) + half + 1, n)
        total = np.concatenate(([0.0], np.cumsum(left)))
        mean = (total[last] - total[first]) / (last - first)
        variance = float(np.mean((left - mean) ** 2))
        return Estimate(
            disturbance_N=mean / gain,
            disturbance_variance_N2=variance / (last - first) / gain**2,
            output=predicted + mean,
            output_variance=variance * (1.0 + 1.0 / (last - first)),
        )
