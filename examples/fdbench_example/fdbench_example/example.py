"""Parameters that follow the record sample by sample."""

from typing import final

import numpy as np

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, OnlineEstimator, Sample
from fdbench.record import FloatArray


@final
class Example(OnlineEstimator):
    r"""Normalised least mean squares, each parameter in units of its value on the data sheet.

    .. math:: \beta_k = \beta_{k-1} + \mu \frac{S z_k}{\epsilon^2 + z_k^T S z_k} (y_k - z_k^T \beta_{k-1}), \quad
              S = \mathrm{diag}(\beta_0^2)

    with the regressors z (p,), the target y, and the data sheet's parameters :math:`\beta_0` (p,), from which it
    starts. ``output`` is :math:`z_k^T \beta_{k-1}`, predicted before y is seen.

    Parameters
    ----------
    step : float
        mu, 1; between 0 and 2. At 1 and without epsilon each sample is met exactly.
    quiet : float
        epsilon, in the unit of y; above 0. Samples in which the model says less than this change little.

    Raises
    ------
    SpecError
        If an argument is out of bounds.
    PluginError
        If ``update`` or ``estimate`` comes before ``start``.

    References
    ----------
    Haykin, Adaptive Filter Theory, 5th edition, 2014, eq. 7.12; the scaling S is ours.

    Examples
    --------
    From 1 to half way between the data sheet's 1 and the 3 that a sample shows.

    >>> Example(step=0.5, quiet=1e-9).moved(np.array([1.0]), np.array([2.0]), 6.0, np.array([1.0])).round(6).tolist()
    [2.0]
    """

    def __init__(self, step: float = 0.01, quiet: float = 1e-3) -> None:
        if not 0.0 < step < 2.0:
            raise SpecError(f"example: step = {step} must be between 0 and 2.")
        if not 0.0 < quiet < np.inf:
            raise SpecError(f"example: quiet = {quiet} must be above 0 and finite.")
        self.step, self.quiet = step, quiet
        self._names: tuple[str, ...] | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where nothing is linear in parameters."""
        return None if context.nominal else "the model has no parameters"

    def start(self, context: Context) -> None:
        """Start from the data sheet."""
        self._names = tuple(context.nominal)
        self._beta = np.array(list(context.nominal.values()))
        self._scale = self._beta**2
        self._output: list[float] = []

    def update(self, sample: Sample) -> None:
        """Predict the target, then move towards it."""
        if self._names is None:
            raise PluginError("example: start comes before update.")
        self._output.append(float(sample.regressors @ self._beta))
        self._beta = self.moved(self._beta, sample.regressors, sample.target, self._scale)

    def estimate(self) -> Estimate:
        """Return where the parameters are, and all predictions so far."""
        if self._names is None:
            raise PluginError("example: start comes before estimate.")
        parameters = dict(zip(self._names, self._beta.tolist(), strict=True))
        return Estimate(parameters=parameters, output=np.array(self._output))

    def moved(self, beta: FloatArray, z: FloatArray, y: float, scale: FloatArray) -> FloatArray:
        """Return the next beta (p,) from the last, z (p,), y and the diagonal of S (p,)."""
        gain = scale * z / (self.quiet**2 + z @ (scale * z))
        return np.asarray(beta + self.step * gain * (y - z @ beta), dtype=np.float64)
