"""Where a drive's knobs stand once record and data sheet have been weighed, and the rigid model that follows."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fdbench.estimator import Context, FloatArray, Regression
from fdbench.plants.feed_drive import FeedDrive
from fdbench_baselines._mixed_estimation import directions, weighed
from fdbench_baselines._simulated_drive import Knob, turned
from fdbench_baselines._whitened_step import WhitenedStep

DIFFERENCE, RANK = 1e-4, 1e-8


class Weighed(NamedTuple):
    """Settings (q,) to go to, and the covariance (p, p) of the parameters of the rigid model."""

    settings: FloatArray
    covariance: FloatArray


def rigid_parameters(context: Context, drive: FeedDrive, knobs: Sequence[Knob], settings: FloatArray) -> FloatArray:
    """Return the parameters (p,) of the context's model, in its order."""
    model = turned(drive, knobs, settings).linear_model(context.model)
    return np.array(list(model.nominal_parameters(context.sampling_time_s).values()))


def weighed_settings(
    context: Context,
    regression: Regression,
    drive: FeedDrive,
    knobs: Sequence[Knob],
    settings: FloatArray,
    step: WhitenedStep,
) -> Weighed:
    r"""Return the settings that record and sheet together make likely.

    The stated settings :math:`\theta_s` stand for parameters :math:`\beta(\theta_s)` of as many dimensions, in which
    the step's is what the record says alone, and is weighed as in `_mixed_estimation`; the others follow by

    .. math:: \theta_o + V_{os} V_{ss}^{-1} (\theta_s^{weighed} - \theta_s)
    """
    stated = np.array([knob.is_stated for knob in knobs])
    free, V = settings + step.change, step.covariance
    nominal = rigid_parameters(context, drive, knobs, np.zeros(len(knobs)))
    here = rigid_parameters(context, drive, knobs, settings)
    moved = [
        rigid_parameters(context, drive, knobs, settings + DIFFERENCE * unit) for unit in np.eye(len(knobs))[stated]
    ]
    size = np.sqrt(np.mean(regression.regressors**2, axis=0))
    size[size == 0.0] = 1.0
    J = (np.array(moved).T - here[:, None]) / DIFFERENCE * size[:, None]
    if context.covariance is None:
        return Weighed(free, J @ V[np.ix_(stated, stated)] @ J.T / np.outer(size, size))
    left, values, _ = np.linalg.svd(J, full_matrices=False)
    basis = left[:, values > RANK * values[0]]
    T = basis.T @ J
    difference = basis.T @ ((here - nominal) * size) + T @ step.change[stated]
    C = basis.T @ (context.covariance * np.outer(size, size)) @ basis
    confounded = basis.T @ directions(context, tuple(context.nominal))
    found = weighed(difference, C, T @ V[np.ix_(stated, stated)] @ T.T, confounded)
    change = np.linalg.pinv(T) @ (found.beta - difference)
    free[stated] += change
    others = V[np.ix_(~stated, stated)] @ np.linalg.pinv(V[np.ix_(stated, stated)]) @ change
    free[~stated] += others
    return Weighed(free, basis @ found.covariance @ basis.T / np.outer(size, size))
