"""A locally periodic force given its hyperparameters: mean, variance, and the share of white force."""

from typing import NamedTuple

import numpy as np

from fdbench.estimator import FloatArray
from fdbench_baselines._locally_periodic_states import Amplitudes, LikeliestProcess, NoisyRows, filtered
from fdbench_baselines._state_space_gp import Innovations, Transition, by_components, run_smoother, run_spread

QUIET_S, QUIETEST = 0.3, 0.5


class Posterior(NamedTuple):
    """Force (n,) in units of the target, its variance (n,), and what is left of the target (n,)."""

    force: FloatArray
    variance: FloatArray
    left: FloatArray


def smoothed(rows: NoisyRows, design: Amplitudes, move: Transition, run: Innovations) -> FloatArray:
    """Return the force in each column given all rows, (n, m)."""
    return np.asarray(run_smoother((0.0,) * design.order, design.H, by_components(move.F), rows.fresh, *run[:-1]))


def spread(rows: NoisyRows, design: Amplitudes, move: Transition, run: Innovations) -> FloatArray:
    """Return the variance (n,) of the force given all rows, in units of s^2."""
    size, F = (0.0,) * design.order, by_components(move.F)
    return np.asarray(run_spread(size, design.H, design.own, F, rows.loud, rows.fresh, run.variances, *run[3:]))


def posterior(
    process: LikeliestProcess,
    left: FloatArray,
    Z: FloatArray,
    covariance: FloatArray,
    step_s: float,
    is_irregular: bool,
) -> Posterior:
    r"""Return the force given all rows, with the variance that process and parameters leave.

    .. math:: \hat d = \hat f + (1 - r) (y - Z \beta - \hat f)

    What is left of the target is noise and, if ``is_irregular``, white force that no harmonic holds, such as that of
    the edges of a cut: the share 1 - r of its variance, see `noise_share`; outliers count there less, too.
    """
    design = process.design
    rows = NoisyRows(np.column_stack((left, Z)), process.loud, process.fresh)
    run = filtered(rows, design, process.motion)
    mean, variance = (part(rows, design, process.motion, run) for part in (smoothed, spread))
    rest = left - mean[:, 0]
    r = noise_share(rest / np.sqrt(process.loud), step_s) if is_irregular else 1.0
    moved = r * mean[:, 1:] + (1.0 - r) * Z
    total = process.s2 * (r**2 * variance + r * (1.0 - r)) + np.einsum("ij,jk,ik->i", moved, covariance, moved)
    return Posterior(left - r * rest, total, r * rest)


def noise_share(rest: FloatArray, step_s: float) -> float:
    """Return r: the mean square where the force rests, in the quietest 0.3 s, over that of all; 1 where it is similar.

    >>> round(noise_share(np.append(np.full(300, 0.1), np.ones(700)), 0.001), 4)
    0.0142
    >>> noise_share(np.append(np.full(300, 0.8), np.ones(700)), 0.001)
    1.0
    """
    window, whole = max(1, round(QUIET_S / step_s)), float(np.mean(rest**2))
    if len(rest) < 2 * window or whole == 0.0:
        return 1.0
    sums = np.cumsum(np.append(0.0, rest**2))
    quiet = float(np.min(sums[window:] - sums[:-window])) / (window * whole)
    return quiet if quiet < QUIETEST else 1.0
