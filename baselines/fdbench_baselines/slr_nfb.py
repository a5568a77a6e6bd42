"""Sparse linear regression with a basis of nonlinear functions."""

import math
from collections.abc import Sequence
from typing import final

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.record import Record
from fdbench_baselines._function_basis import NONLINEAR, FloatArray, declined, estimate_force
from fdbench_baselines._sparse_regression import threshold_sequentially


@final
class SlrNfb(BatchEstimator):
    r"""LR-NFB with small coefficients removed by sequentially thresholded least squares: SLR-NFB.

    .. math:: \hat\zeta_S = \arg\min_{\zeta_S} |Y_i - G_S(X) \, \zeta_S|^2, \quad
              S \leftarrow \{ j \in S : |\hat\zeta_j| \ge \gamma \}

    for each part i of a line by itself, N times; the test is made at the start of a pass. G, X, Y and the result as for
    ``lr_nfb``, which is the case :math:`\gamma = 0`.

    Parameters
    ----------
    threshold : float
        gamma, on the coefficients as they are: N for a constant, N per unit of the function else.
    iterations : int
        N, at least 0.
    functions : sequence of str
        As for ``lr_nfb``.

    Raises
    ------
    SpecError
        If a parameter is out of bounds, or as for ``lr_nfb``.

    References
    ----------
    Qu and Vogl (2021), Estimating dynamic cutting forces of machine tools from measured vibrations using sparse
    regression with nonlinear function basis, section 2.3, which does not state gamma; Brunton, Proctor, Kutz (2016),
    PNAS 113.
    """

    def __init__(self, threshold: float = 0.2, iterations: int = 10, functions: Sequence[str] = NONLINEAR) -> None:
        if not (math.isfinite(threshold) and threshold >= 0.0):
            raise SpecError(f"threshold: {threshold:g} is outside [0, inf).")
        if iterations < 0:
            raise SpecError(f"iterations: {iterations} is negative.")
        self.threshold, self.iterations, self.functions = threshold, iterations, tuple(functions)

    def skip(self, context: Context) -> str | None:
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Factorise once and remove columns, line by line."""
        return estimate_force(context, record, self.functions, self._solve)

    def _solve(self, regressors: FloatArray, targets: FloatArray) -> FloatArray:
        return threshold_sequentially(regressors, targets, self.threshold, self.iterations).coefficients
