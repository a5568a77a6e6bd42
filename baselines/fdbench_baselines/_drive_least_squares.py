"""Least squares on a drive whose data sheet says how exact it is: generalised, on straight friction, and mixed."""

from typing import NamedTuple

import numpy as np

from fdbench.estimator import Context, FloatArray, Regression
from fdbench_baselines._aitken import generalised
from fdbench_baselines._mixed_estimation import Found, mixed
from fdbench_baselines._straight_friction import straight

LOOP = "velocity_loop"
# What inverse dynamics lacks, such as the elastic screw, is at high frequencies; a filter of errors amplifies these.
LAGS = {LOOP: 40, "inverse_dynamics": 0, "directional_inverse_dynamics": 0}


class Drive(NamedTuple):
    """Parameters after record and sheet, coefficients (m - p,) of the columns beside; what the record alone says."""

    found: Found
    beside: FloatArray
    record: Found


def process_columns(regression: Regression) -> FloatArray:
    r"""Return columns (n, 1 or 0) of a process force at constant feed, :math:`\operatorname{sign}(v_r)`.

    Only where no Coulomb friction in the model stands for it.
    """
    if regression.names != ("beta_1", "beta_2"):
        return np.empty((len(regression.target), 0))
    return np.asarray(np.sign(regression.regressors[:, :1]))


def drive_least_squares(
    context: Context, regression: Regression, beside: FloatArray, instruments: FloatArray | None = None
) -> Drive:
    r"""Return the parameters of :math:`y = Z \beta + X \theta + n`, with :math:`\beta` mixed.

    n is autoregressive in a velocity loop.

    Parameters
    ----------
    context, regression : Context, Regression
        Of a drive.
    beside : (n, m - p) array
        X.
    instruments : (n, p) array, optional
        In place of Z, as in `generalised`.
    """
    Z, y = regression.regressors, regression.target
    columns, p = np.hstack((Z, beside)), Z.shape[1]
    trusted = straight(context, Z)
    # In a loop the disturbance drives its own regressor, so that least squares would take it for the drive.
    start = np.append([context.nominal[name] for name in regression.names], np.zeros(beside.shape[1]))
    if context.model != LOOP:
        start = np.linalg.lstsq(columns[trusted], y[trusted], rcond=None)[0]
    W = None if instruments is None else np.hstack((instruments, beside))
    solution = generalised(columns, y, trusted, start, LAGS[context.model], W)
    record = Found(solution.theta[:p], solution.covariance[:p, :p])
    return Drive(mixed(context, regression, record), solution.theta[p:], record)
