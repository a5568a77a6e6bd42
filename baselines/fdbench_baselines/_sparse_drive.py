"""Sparse regression on a drive: its linear model beside few of many candidates; see `_drive_features`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.estimator import Context, Estimate, FloatArray, Regression
from fdbench.record import Record
from fdbench_baselines._data_sheet import sheet
from fdbench_baselines._drive_features import (
    library,
    motion,
    on_parameters,
    straight_line,
    waves,
)
from fdbench_baselines._drive_least_squares import process_columns
from fdbench_baselines._drive_run import Learned
from fdbench_baselines._mixed_estimation import applies
from fdbench_baselines._robust import robust_residual
from fdbench_baselines._slip import below_half, slipped_period
from fdbench_baselines._sparse_regression import least_squares, threshold_sequentially

BoolArray = NDArray[np.bool_]

DEPENDENT = 1e-3  # share of a candidate that is no combination of the regressors, below which it is left out
LONGEST_ENVELOPES = 40
STEP_S = 0.02


class Sparseness(NamedTuple):
    """How a sparse regression is made: smallest share of a term, passes, harmonics, and s between amplitudes."""

    share: float
    iterations: int
    harmonics: int
    envelope_s: float


def chosen(base: FloatArray, candidates: FloatArray, target: FloatArray, how: Sparseness) -> BoolArray:
    r"""Return which candidates stay, (n_candidates,) of bool.

    What the base explains is taken out of target and candidates, and these are scaled so that a coefficient is the root
    mean square of its term over that of the target left; terms below ``share`` go, in passes of sequentially
    thresholded least squares.
    """
    Q = np.linalg.qr(base)[0]
    rest = target - Q @ (Q.T @ target)
    free = candidates - Q @ (Q.T @ candidates)
    size, whole = np.linalg.norm(free, axis=0), np.linalg.norm(candidates, axis=0)
    usable = np.flatnonzero(size > DEPENDENT * np.maximum(whole, 1e-300))
    keep = np.zeros(candidates.shape[1], dtype=np.bool_)
    scale = float(np.linalg.norm(rest))
    if len(usable) > 0 and scale > 0.0:
        found = threshold_sequentially(free[:, usable] / size[usable], rest[:, None] / scale, how.share, how.iterations)
        keep[usable] = found.coefficients[:, 0] != 0.0
    return keep


def learn_drive(context: Context, record: Record, how: Sparseness) -> tuple[Estimate, Learned]:
    r"""Return the estimate, and what its free run needs.

    .. math::
        y = Z \beta + \sum_j \zeta_j \phi_j(v, x) + \sum_{h,i} H_i(t) (a_{hi} \cos h\omega t + b_{hi} \sin h\omega t)

    with :math:`\beta` about the data sheet as far as its covariance allows. Curves of friction that are chosen count
    as the straight line through half and full speed, which is what the parameters stand for. Where the data sheet says
    how exact it is, a process force of unknown mean, constant and growing with the feed, stands beside a loop without
    friction.
    """
    regression = context.regression(record)
    Z, y, gain = regression.regressors, regression.target, regression.disturbance_gain
    paper = sheet(context, regression)
    residual, loud = robust_residual(Z, y)
    beside = np.empty((len(y), 0))
    if applies(context):
        beside = process_columns(regression)
        if beside.shape[1] > 0 and context.disturbance_period_s is not None:
            beside = np.hstack((beside, Z[:, :1]))
    weight = 1.0 / np.sqrt(loud)
    deviation = float(np.sqrt(np.mean(residual**2 / loud)))
    velocity, position = motion(record, regression, context.model)
    found = library(context, velocity, position)
    curves = found.all(velocity, position)
    periodic = _periodic(context, regression, residual * weight, how)
    candidates = np.hstack((curves, periodic))
    p, n_curves = Z.shape[1], curves.shape[1]
    prior = np.zeros((p, candidates.shape[1]))
    base = np.vstack((Z @ paper.root * weight[:, None], deviation * np.eye(p)))
    base = np.hstack((base, np.vstack((beside * weight[:, None], np.zeros((p, beside.shape[1]))))))
    further = np.vstack((candidates * weight[:, None], prior))
    target = np.concatenate(((y - Z @ paper.nominal) * weight, np.zeros(p)))
    keep = chosen(base, further, target, how)
    solution = least_squares(np.hstack((base, further[:, keep])), target[:, None])[:, 0]
    coefficients = np.zeros(candidates.shape[1])
    coefficients[keep] = solution[base.shape[1] :]
    beta = paper.nominal + paper.root @ solution[:p]
    learned = Learned(beta, found, coefficients[:n_curves])
    wave, output = periodic @ coefficients[n_curves:], Z @ beta + candidates @ coefficients
    estimate = Estimate(
        parameters=_parameters(regression.names, learned),
        disturbance_N=(wave if periodic.shape[1] > 0 else y - output) / gain,
        output=output,
    )
    return estimate, learned


def _periodic(context: Context, regression: Regression, residual: FloatArray, how: Sparseness) -> FloatArray:
    if context.disturbance_period_s is None:
        return np.empty((len(residual), 0))
    time_s, nominal_s = regression.time_s, context.disturbance_period_s
    harmonics = below_half(time_s, nominal_s, how.harmonics)
    if harmonics == 0:
        return np.empty((len(residual), 0))
    period_s = slipped_period(time_s, residual, nominal_s, harmonics)
    apart_s = max(how.envelope_s, (time_s[-1] - time_s[0]) / LONGEST_ENVELOPES)
    return waves(time_s, period_s, harmonics, apart_s)


def _parameters(names: tuple[str, ...], learned: Learned) -> dict[str, float]:
    half = 0.5 * learned.features.speed_m_per_s
    curves = learned.features.friction(half * np.array([-2.0, -1.0, 1.0, 2.0]))
    more = on_parameters(straight_line(curves @ learned.coefficients[: curves.shape[1]], half))
    return {name: value + more.get(name, 0.0) for name, value in zip(names, learned.beta.tolist(), strict=True)}


def learn_steps(regression: Regression, predicted: FloatArray, how: Sparseness) -> Estimate:
    r"""Return the force on a drive whose equation leaves it alone: few of many steps.

    .. math:: y_k - \hat y_k = g \Big( d_0 + \sum_j \zeta_j [t_k \ge \tau_j] \Big), \qquad \tau_{j+1} - \tau_j = 20 ms
    """
    left, time_s = regression.target, regression.time_s
    times = np.arange(time_s[0] + STEP_S, time_s[-1] - STEP_S, STEP_S)
    steps = (time_s[:, None] >= times).astype(np.float64)
    base = np.ones((len(left), 1))
    kept = np.hstack((base, steps[:, chosen(base, steps, left, how)]))
    force = kept @ least_squares(kept, left[:, None])[:, 0]
    return Estimate(disturbance_N=force / regression.disturbance_gain, output=predicted + force)
