"""Kernel recursive least squares tracker (KRLS-T): a Gaussian process over time that learns and forgets."""

from array import array
from collections.abc import Mapping
from typing import Literal, final

import numpy as np

from fdbench.errors import PluginError, SpecError, did_you_mean
from fdbench.estimator import Context, Estimate, FloatArray, OnlineEstimator, Sample
from fdbench.plants import StateSpacePlant
from fdbench.record import Record
from fdbench_baselines._krls_t_recursion import Tracker, empty_tracker, locally_periodic_inputs, track_beside
from fdbench_baselines._mixed_estimation import learnable
from fdbench_baselines._one_step import OneStep, declined

SMALLEST_JITTER = 1e-6

MEAN_PERIODS = 5.0


@final
class KRLST(OnlineEstimator):
    r"""One-step-ahead prediction of a nearly periodic disturbance beside a known linear model.

    .. math:: y_n = z_n^T \beta + f(t_n) + \varepsilon_n, \qquad v_n = y_n - z_n^T \beta, \qquad
              \hat f_n = E[f(t_n) \mid v_1 \ldots v_{n-1}]

    f has the locally periodic kernel :math:`e^{-\tau^2 / 2 \sigma_1^2} e^{-\sin^2(\pi \tau / \psi) / 2 \sigma_2^2}`;
    at most ``budget`` samples are kept. Where no period is known the kernel is :math:`e^{-\tau^2 / 2 \sigma_0^2}`: a
    force that is smooth. :math:`\beta` is ``linear_parameters`` or else found on the way, from the data sheet's values
    and their covariance, each parameter by itself within 100 % where it states none, by least squares on what the
    tracker cannot tell of target and regressors beforehand; see `track_beside`. Rows of inverse dynamics off the
    straight line of the sheet's friction are predicted but not learnt from (`learnable`). A model in state space has no
    :math:`\beta`; y is there what its equation leaves of a reading, if the readings give all states.

    ``disturbance_N`` is :math:`\hat f / g` with variance :math:`s_0^2 s_f^2 / g^2`, that of the disturbance without
    noise, where g is the disturbance gain; where beta is found on the way and a period is known, it is without its mean
    over the last five periods, since a force that is constant for so long is a friction to the drive. A row depends on
    earlier samples only, save that the first row's variance is scaled by its own sample, as no signal power
    :math:`s_0^2` is known before it. ``output`` is :math:`z^T \beta + \hat f` with variance
    :math:`s_0^2 (s_2 + s_f^2)`, that of an observation. ``parameters`` are those after the last sample; they have no
    covariance: rows that the model misses, such as those near standstill, are not in the recursion's.

    Parameters
    ----------
    sigma_1_s : float
        :math:`\sigma_1`, time over which the period's shape is kept, s; above 0.
    sigma_2 : float
        :math:`\sigma_2`, width within a period in units of the sine; above 0.
    gamma : float
        Signal-to-noise variance ratio, :math:`1 / s_2`; above 0.
    period_s : float, optional
        :math:`\psi`, s; by default the context's disturbance period.
    forgetting : float
        :math:`\lambda` of each sample, in (0, 1].
    budget : int
        M, samples in the dictionary; at least 1.
    jitter : float
        Added to the diagonal of the kernel matrix; at least 1e-6, or rounding errors may grow where inputs come back.
    mode : {"B2P", "UI"}
        Forget back to the prior, or by uncertainty injection. The latter divides the variance of every member by lambda
        at every sample, also of those that time has left behind: over time it serves for short records only.
    linear_parameters : mapping of str to float, optional
        :math:`\beta`, a value for each parameter of the regression, to be held.
    smooth_s : float
        :math:`\sigma_0`, s; above 0.

    Raises
    ------
    SpecError
        If an argument is out of bounds, the names in ``linear_parameters`` are not those of the
        regression, or the recursion diverges.
    PluginError
        If a sample comes before ``start``.

    References
    ----------
    Van Vaerenbergh, Lázaro-Gredilla and Santamaría, Kernel recursive least-squares tracker for time-varying regression,
    IEEE Trans. Neural Networks and Learning Systems 23 (2012); McPherson, thesis, 2024, eq. 2.11 to 2.22 with
    :math:`(v - \hat v)^2` in eq. 2.20, and table 4.5 (defaults: shaker trials; the budget is ours).

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4, beside a shaker of 5 N.

    >>> from fdbench_baselines._example import example_drive
    >>> found = KRLST().fit(*example_drive(mass_ratio=1.25, wave_N=5.0, period_s=0.065))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.4, 'beta_2': 0.6}
    """

    def __init__(
        self,
        sigma_1_s: float = 1.2,
        sigma_2: float = 0.99,
        gamma: float = 5.85,
        period_s: float | None = None,
        forgetting: float = 0.996,
        budget: int = 50,
        jitter: float = SMALLEST_JITTER,
        mode: Literal["B2P", "UI"] = "B2P",
        linear_parameters: Mapping[str, float] | None = None,
        smooth_s: float = 0.05,
    ) -> None:
        lengths = (("sigma_1_s", sigma_1_s), ("sigma_2", sigma_2), ("period_s", period_s), ("smooth_s", smooth_s))
        for name, value in (*lengths, ("gamma", gamma)):
            _require(value is None or 0.0 < value < np.inf, name, value, "above 0 and finite")
        _require(0.0 < forgetting <= 1.0, "forgetting", forgetting, "above 0 and at most 1")
        _require(isinstance(budget, int) and budget >= 1, "budget", budget, "an integer of at least 1")
        _require(SMALLEST_JITTER <= jitter < np.inf, "jitter", jitter, f"at least {SMALLEST_JITTER} and finite")
        _require(mode in ("B2P", "UI"), "mode", mode, "B2P (back to the prior) or UI (uncertainty injection)")
        for name, value in (linear_parameters or {}).items():
            _require(np.isfinite(value), f"linear_parameters[{name}]", value, "finite")
        self.sigma_1_s, self.sigma_2, self.gamma, self.period_s = sigma_1_s, sigma_2, gamma, period_s
        self.forgetting, self.budget, self.jitter, self.mode = forgetting, budget, jitter, mode
        self.linear_parameters, self.smooth_s = linear_parameters, smooth_s
        self._tracker: Tracker | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where the model is no equation of a force, or rows are not a series in time."""
        if context.model == "servo_response":
            return "the model is the response of a servo, whose position holds no series of a force"
        return declined(context)

    def start(self, context: Context) -> None:
        """Forget everything; the linear parameters are those given, or the data sheet's to begin with."""
        names, given = tuple(context.nominal), self.linear_parameters
        for name in given or ():
            if name not in names:
                raise SpecError(f"krls_t: {context.model} has no linear parameter {name}.{did_you_mean(name, names)}")
        missing = [name for name in names if given is not None and name not in given]
        if missing:
            raise SpecError(f"krls_t: {context.model} needs linear_parameters for {', '.join(missing)} too.")
        self._context, self._names = context, names
        self._beta = np.array([float((given or context.nominal)[name]) for name in names])
        self._P = np.zeros((len(names), len(names)))
        if given is None:
            self._P = np.diag(self._beta**2) if context.covariance is None else context.covariance.copy()
        period_s = context.disturbance_period_s if self.period_s is None else self.period_s
        self._kernel = (
            (self.smooth_s, self.sigma_2, np.inf) if period_s is None else (self.sigma_1_s, self.sigma_2, period_s)
        )
        self._constant_s = 0.0 if period_s is None else MEAN_PERIODS * period_s
        plant = context.plant
        self._step = (
            OneStep(plant, context.sampling_time_s) if not names and isinstance(plant, StateSpacePlant) else None
        )
        self._before: FloatArray | None = None
        self._rows = array("d")
        self._tracker = empty_tracker(3, self.budget, len(names))

    def update(self, sample: Sample) -> None:
        """Predict a sample, then take it in."""
        time_s, regressors, target, gain, readings = sample
        self._take(np.array([time_s]), regressors[np.newaxis], np.array([target]), gain, readings[np.newaxis])

    def estimate(self) -> Estimate:
        """Return the predictions made so far, and the parameters by now."""
        self._started()
        time_s, linear, mean, variance, power, gain = np.array(self._rows).reshape(-1, 6).T
        is_found = self.linear_parameters is None and len(self._names) > 0
        force = mean - running_mean(time_s, mean, self._constant_s) if is_found and self._constant_s else mean
        return Estimate(
            parameters=dict(zip(self._names, self._beta.tolist(), strict=True)),
            disturbance_N=force / gain,
            disturbance_variance_N2=power * variance / gain**2,
            output=linear + mean,
            output_variance=power * (1.0 / self.gamma + variance),
        )

    def fit(self, context: Context, record: Record) -> Estimate:
        """Run over a whole record."""
        regression = context.regression(record)
        self.start(context)
        n = len(regression.target)
        readings = np.empty((n, 0)) if regression.readings is None else regression.readings
        self._take(regression.time_s, regression.regressors, regression.target, regression.disturbance_gain, readings)
        return self.estimate()

    def _take(
        self, time_s: FloatArray, regressors: FloatArray, target: FloatArray, gain: float, readings: FloatArray
    ) -> None:
        tracker, known = self._started(), np.zeros(len(target))
        if self._step is not None:
            known = self._step.predicted(self._before, readings)
            self._before = readings[-1]
        x = locally_periodic_inputs(time_s, *self._kernel)
        learnt = learnable(self._context, regressors)
        settings = (1.0 / self.gamma, self.forgetting, self.jitter, self.mode == "UI")
        rows = track_beside(
            tracker, x, np.ascontiguousarray(regressors), target - known, learnt, self._beta, self._P, *settings
        )
        if not np.isfinite(tracker.power[0]):
            raise SpecError(
                f"krls_t: diverged within {tracker.seen[0]} samples with mode {self.mode}, jitter {self.jitter}, "
                f"forgetting {self.forgetting}. Use mode B2P, more jitter or forgetting nearer to 1."
            )
        rows[:, 0] += known
        self._rows.frombytes(np.column_stack((time_s, rows, np.full(len(target), gain))).tobytes())

    def _started(self) -> Tracker:
        if self._tracker is None:
            raise PluginError("krls_t: start(context) must come before update and estimate.")
        return self._tracker


def running_mean(time_s: FloatArray, values: FloatArray, length_s: float) -> FloatArray:
    """Return the mean of each value and those before it within a time, or of as many as there are.

    >>> running_mean(np.array([0.0, 1.0, 2.0, 3.0]), np.array([2.0, 4.0, 6.0, 8.0]), 2.0)
    array([2., 3., 5., 7.])
    """
    sums = np.append(0.0, np.cumsum(values))
    step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    first = np.searchsorted(time_s, time_s - length_s + 0.5 * step_s)
    return np.asarray((sums[1:] - sums[first]) / (np.arange(1, len(sums)) - first))


def _require(allowed: bool | np.bool, name: str, value: object, bounds: str) -> None:
    if not allowed:
        raise SpecError(f"krls_t: {name} = {value!r} must be {bounds}.")
