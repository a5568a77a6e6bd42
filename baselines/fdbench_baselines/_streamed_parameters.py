"""Parameters of a drive row by row: recursive generalised least squares about the data sheet, on straight friction."""

import numpy as np

from fdbench.estimator import Context, FloatArray
from fdbench_baselines._data_sheet import sheet_beforehand
from fdbench_baselines._generalised_least_squares import at_start, follow_errors
from fdbench_baselines._mixed_estimation import Found, applies, directions, weighed
from fdbench_baselines._straight_friction import force_left, straight

WEIGHT_DEVIATION = 0.03
PROCESS_SHARE = 0.01  # of the velocity limit: how far a process force may set a velocity off in a sample
SMALLEST_INFORMATION = 1e-9  # of the sheet's, for a direction of which the record says nothing
SMALLEST_SHARE = 1e-6  # of the largest deviation: below it the sheet holds a direction exact
LOOP = "velocity_loop"
LOOP_WITHOUT_FRICTION = ("beta_1", "beta_2")


class StreamedParameters:
    r"""Corrections :math:`\Delta\beta` to the data sheet and weights on errors; see `_generalised_least_squares`.

    Where the sheet says how exact it is, rows off the straight line of the nominal friction are predicted but not
    learnt from, a process force at constant feed has a coefficient of its own in a loop without friction, and
    `found` weighs record and sheet once more as `_mixed_estimation` does.
    """

    def __init__(self, context: Context, error_lags: int) -> None:
        self._context, self._sheet = context, sheet_beforehand(context)
        self._names, self._applies = tuple(context.nominal), applies(context)
        self._has_process = self._applies and self._names == LOOP_WITHOUT_FRICTION
        p = len(self._names)
        limit: float = getattr(context.plant, "velocity_limit_m_per_s", 1.0)
        deviation = np.append(np.ones(p), [PROCESS_SHARE * limit] if self._has_process else [])
        # What inverse dynamics lacks is at high frequencies, which weights on the errors would amplify: they follow.
        apart = self._applies and context.model != LOOP
        self._state = at_start(np.zeros(len(deviation)), deviation, 0 if apart else error_lags, WEIGHT_DEVIATION)
        self._errors = at_start(np.empty(0), np.empty(0), error_lags, WEIGHT_DEVIATION) if apart else None
        self._squares, self._rows = np.zeros(p), 0

    def take(self, regressors: FloatArray, target: FloatArray) -> FloatArray:
        """Predict rows, then take them in; return prediction, its part that errors foretell, and variance, (n, 3)."""
        physics = regressors @ self._sheet.nominal
        columns = regressors @ self._sheet.root
        if self._has_process:
            columns = np.hstack((columns, np.sign(regressors[:, :1])))
        learnt = straight(self._context, regressors) if self._applies else np.ones(len(target), dtype=np.bool_)
        rows = follow_errors(self._state, np.ascontiguousarray(columns), target - physics, learnt)
        if self._errors is not None:
            left = target - physics - rows[:, 0]
            following = follow_errors(self._errors, np.empty((len(target), 0)), left, np.ones(len(target), np.bool_))
            rows = np.column_stack(
                (rows[:, 0] + following[:, 0], force_left(self._context, regressors, following[:, 1]), following[:, 2])
            )
        rows[:, 0] += physics
        self._squares += (regressors**2).sum(axis=0)
        self._rows += len(target)
        return np.asarray(rows)

    def found(self) -> Found:
        """Return the parameters by now, with their covariance."""
        p, (nominal, root) = len(self._names), self._sheet
        theta, P = self._state.theta[:p], self._state.P[:p, :p]
        if self._applies and self._rows > 0:
            # The sheet is in theta and P already; what is left without it is what the record says.
            values, vectors = np.linalg.eigh(np.linalg.inv(P) - np.eye(p))
            V = (vectors / np.maximum(values, SMALLEST_INFORMATION)) @ vectors.T
            J = directions(self._context, self._names)
            size = np.sqrt(self._squares / self._rows)
            size[size == 0.0] = 1.0
            inverse = np.linalg.pinv(root * size[:, None], rcond=SMALLEST_SHARE)
            theta, P = weighed(V @ np.linalg.solve(P, theta), np.eye(p), V, inverse @ J)
        covariance = root @ P @ root.T
        return Found(nominal + root @ theta, 0.5 * (covariance + covariance.T))
