"""Least squares in the time domain."""

from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.record import Record

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

    Raises
    ------
    SpecError
        If the record does not identify every parameter.

    References
    ----------
    C. F. Gauss, Theoria combinationis observationum, 1821; McPherson, thesis, 2024, eq. 2.8.
    """

    def skip(self, context: Context) -> str | None:
        """Return why the estimator does not apply, or None."""
        parameters = context.plant.true_parameters(context.model, context.sampling_time_s)
        return None if parameters else "the plant's model has no parameters"

    def fit(self, context: Context, record: Record) -> Estimate:
        """Solve for the parameters by a singular value decomposition of the scaled regressors."""
        regression = context.regression(record)
        y, names = regression.target, regression.names
        u, s, vt, scale = factorise(regression.regressors, names)
        root = vt.T / s / scale[:, None]
        coordinates = u.T @ y
        output = u @ coordinates
        residual = y - output
        variance = float(residual @ residual) / (len(y) - len(names))
        return Estimate(
            parameters=dict(zip(names, (root @ coordinates).tolist(), strict=True)),
            covariance=variance * root @ root.T,
            disturbance_N=residual / regression.disturbance_gain,
            output=output,
            output_variance=variance * (1.0 + np.einsum("ij,ij->i", u, u)),
        )
