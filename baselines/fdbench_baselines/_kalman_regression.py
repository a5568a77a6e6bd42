"""The Kalman observer of a linear model: noises by maximum likelihood, then filter and smoother."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.estimator import Context, Estimate, FloatArray, Regression, Sample
from fdbench_baselines._data_sheet import Sheet, sheet
from fdbench_baselines._kalman_oscillators import Filtered, Variances, run_filter, run_smoother
from fdbench_baselines._mixed_estimation import learnable
from fdbench_baselines._robust import robust_residual
from fdbench_baselines._slip import below_half, slipped_period

EVALUATIONS = 110
MISSING = 1e8  # times the variance of a reading
SURPRISE, BURST_S = 6.0, 0.2
TOLERANCE = 1e-2  # of a logarithm or of the log likelihood
SHORTEST_MEMORY_S, LONGEST_MEMORY_S = 0.05, 300.0
START = {"reading": 0.3, "walk": 1e-3, "wave": 1.0, "memory_s": 2.0, "slope": 0.03}


class Rows(NamedTuple):
    """Whitened regressors (n, p), target (n,), how many times the variance of a reading each row has (n,).

    Before a row that is ``sudden`` (n,) the force may change to any other, as where a tool enters or leaves.
    The first ``own`` columns are of parameters; one that may follow is the feed, of which a process force is a part.
    """

    Z: FloatArray
    y: FloatArray
    loud: FloatArray
    sudden: NDArray[np.bool_]
    own: int


def filtered(rows: Rows, noise: Variances, harmonics: int, keep: bool = True) -> Filtered:
    """Return what the filter makes of the rows; see `_kalman_oscillators`."""
    return Filtered(*run_filter(*rows, noise, harmonics, keep))


def sudden_rows(run: Filtered, step_s: float) -> NDArray[np.bool_]:
    """Return the rows (n,) whose innovation is beyond `SURPRISE` deviations, the first within each `BURST_S`."""
    found = np.zeros(len(run.errors), dtype=np.bool_)
    after = 0
    for k in np.flatnonzero(np.abs(run.errors) > SURPRISE * np.sqrt(run.variances)).tolist():
        if k >= after:
            found[k] = True
            after = k + int(BURST_S / step_s)
    return found


def likeliest(rows: Rows, harmonics: int, angle: float, step_s: float) -> Variances:
    r"""Return the noises of greatest likelihood, by the simplex of Nelder and Mead from a fixed start.

    .. math:: \log p(y) = -\tfrac12 \sum_k \big( \log 2 \pi S_k + \nu_k^2 / S_k \big)

    with the filter's innovations :math:`\nu_k` of variance :math:`S_k`. The search is over logarithms of the variances
    and of the oscillators' memory, and over their frequency within what a memory of the start can tell.
    """
    from scipy.optimize import minimize

    def noise(logarithms: FloatArray) -> Variances:
        reading, walk, wave, memory_s, slip, slope = np.append(logarithms, np.zeros(6 - len(logarithms))).tolist()
        seconds = np.clip(START["memory_s"] * np.exp(memory_s), SHORTEST_MEMORY_S, LONGEST_MEMORY_S)
        return Variances(
            START["reading"] ** 2 * np.exp(2.0 * np.clip(reading, -20.0, 5.0)),
            START["walk"] ** 2 * np.exp(2.0 * np.clip(walk, -20.0, 5.0)),
            START["wave"] ** 2 * np.exp(2.0 * np.clip(wave, -20.0, 5.0)),
            float(np.exp(-step_s / seconds)),
            angle + slip * step_s,
            START["slope"] ** 2 * np.exp(2.0 * np.clip(slope, -20.0, 10.0)),
        )

    def loss(logarithms: FloatArray) -> float:
        value = -filtered(rows, noise(logarithms), harmonics, keep=False).log_likelihood
        return float(value) if np.isfinite(value) else 1e300

    free = 2 if harmonics == 0 else 5 if rows.own == rows.Z.shape[1] else 6
    first = np.zeros(free)
    corners = np.vstack((first, np.diag([-1.0, 1.5, -1.0, 1.0, 0.3, 3.0][:free])))
    options: Any = {"initial_simplex": corners, "maxfev": EVALUATIONS, "xatol": TOLERANCE, "fatol": TOLERANCE}
    return noise(minimize(loss, first, method="Nelder-Mead", options=options).x)


class Stream:
    """Rows of a linear model as they come in; the estimate is that of all rows so far."""

    def __init__(self, context: Context, harmonics: int) -> None:
        self.context, self.harmonics = context, harmonics
        self._samples: list[Sample] = []

    def take(self, sample: Sample) -> None:
        """Keep a row."""
        self._samples.append(sample)

    def estimate(self) -> Estimate:
        """Return what `observe` makes of the rows."""
        names, kept = tuple(self.context.nominal), self._samples
        if len(kept) <= len(names):
            raise SpecError(f"kalman: {len(kept)} rows for {len(names)} parameters; more rows are needed.")
        regression = Regression(
            regressors=np.array([sample.regressors for sample in kept]),
            target=np.array([sample.target for sample in kept]),
            names=names,
            target_name="",
            time_s=np.array([sample.time_s for sample in kept]),
            rows=np.arange(len(kept)),
            disturbance_gain=kept[0].disturbance_gain,
        )
        return observe(self.context, regression, self.harmonics)


def observe(context: Context, regression: Regression, harmonics: int) -> Estimate:
    """Return parameters with covariance, the smoothed force with variance, and the output a sample ahead."""
    Z, y, gain = regression.regressors, regression.target, regression.disturbance_gain
    paper: Sheet = sheet(context, regression)
    residual, loud = robust_residual(Z, y)
    loud = np.where(learnable(context, Z), loud, MISSING)
    unit = float(np.sqrt(np.mean(residual**2 / loud))) or 1.0
    step_s, period_s, angle = regression.sampling_time_s, context.disturbance_period_s, 0.0
    if period_s is None:
        harmonics = 0
    elif context.model != "velocity_loop":  # whose rows are not filtered and hold the faster harmonics as well
        harmonics = below_half(regression.time_s, period_s, harmonics)
    if period_s is not None and harmonics > 0:
        angle = 2.0 * np.pi * step_s / slipped_period(regression.time_s, residual / np.sqrt(loud), period_s, harmonics)
    columns, p = [Z @ paper.root / unit], Z.shape[1]
    # On an axis whose friction is no straight line its curve would be taken for a process force.
    if harmonics > 0 and context.covariance is not None and context.model == "velocity_loop":
        feed = Z[:, 0]
        columns.append(feed[:, None] / (float(np.sqrt(np.mean(feed**2))) or 1.0))
    rows = Rows(
        np.ascontiguousarray(np.hstack(columns)), (y - Z @ paper.nominal) / unit, loud, np.zeros(len(y), np.bool_), p
    )
    noise = likeliest(rows, harmonics, angle, step_s)
    run = filtered(rows, noise, harmonics)
    sudden = sudden_rows(run, step_s)
    if sudden.any():
        rows = rows._replace(sudden=sudden)
        noise = likeliest(rows, harmonics, noise.angle, step_s)
        run = filtered(rows, noise, harmonics)
    mean, variance = run_smoother(
        rows.Z, p, noise, harmonics, run.errors, run.variances, run.states[:-1], run.covariances[:-1]
    )
    beta = paper.nominal + paper.root @ run.states[-1, :p]
    covariance = paper.root @ run.covariances[-1, :p, :p] @ paper.root.T
    return Estimate(
        parameters=dict(zip(regression.names, beta.tolist(), strict=True)),
        covariance=0.5 * (covariance + covariance.T),
        disturbance_N=mean * unit / gain,
        disturbance_variance_N2=variance * (unit / gain) ** 2,
        output=y - unit * run.errors,
        output_variance=unit**2 * run.variances,
    )
