"""The linear hybrid model on a drive: the data sheet's equation, corrected row by row by recursive least squares."""

from array import array

import numpy as np

from fdbench.estimator import Context, Estimate, FloatArray
from fdbench.plants import StateSpacePlant
from fdbench_baselines._one_step import OneStep
from fdbench_baselines._recursive_least_squares import rls
from fdbench_baselines._streamed_parameters import StreamedParameters

FORGETTING = 0.98  # of a force that is all that is to be learnt
WIDE = 1e6


class DriveHybrid:
    r"""Rows of a linear model with its data sheet as physics, or of a single step of a model in state space.

    .. math::
        \hat y_k = z_k^T (\beta_0 + \Delta\beta) + \sum_{i=1}^p w_i n_{k-i}, \qquad n = y - z^T (\beta_0 + \Delta\beta)

    :math:`\Delta\beta` begins within the data sheet's covariance, each weight on an error within 0.03; see
    `_generalised_least_squares` and, for what is left out and how the sheet counts, `_streamed_parameters`. The force
    is what the errors before a row foretell of it, so that neither its own noise nor its force is in it. Where there
    are no parameters a constant force is learnt that forgets, 0.98 a row.
    """

    def __init__(self, context: Context, error_lags: int) -> None:
        self._names = tuple(context.nominal)
        p, plant = len(self._names), context.plant
        self._parameters = StreamedParameters(context, error_lags)
        self._step = OneStep(plant, context.sampling_time_s) if p == 0 and isinstance(plant, StateSpacePlant) else None
        self._force, self._P = np.zeros(1), np.full((1, 1), WIDE)
        self._before: FloatArray | None = None
        self._rows = array("d")

    def take(self, regressors: FloatArray, target: FloatArray, gain: float, readings: FloatArray) -> None:
        """Predict rows, then take them in."""
        n = len(target)
        if self._step is not None:
            known = self._step.predicted(self._before, readings)
            self._before = readings[-1]
            left = target - known
            foretold = left - rls(self._force, self._P, np.ones((n, 1)), left, FORGETTING)
            rows = np.column_stack((known + foretold, foretold, np.full(n, np.nan)))
        else:
            rows = self._parameters.take(regressors, target)
        self._rows.frombytes(np.column_stack((rows, np.full(n, gain))).tobytes())

    def estimate(self) -> Estimate:
        """Return the predictions so far, and the parameters by now with their covariance."""
        output, foretold, variance, gain = np.array(self._rows).reshape(-1, 4).T
        if not self._names:
            return Estimate(disturbance_N=foretold / gain, output=output)
        beta, covariance = self._parameters.found()
        return Estimate(
            parameters=dict(zip(self._names, beta.tolist(), strict=True)),
            covariance=covariance,
            disturbance_N=foretold / gain,
            output=output,
            output_variance=variance,
        )
