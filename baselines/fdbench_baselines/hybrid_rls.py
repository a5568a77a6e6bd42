"""Linear hybrid model: a physics model whose errors are learnt by recursive least squares."""

from array import array
from typing import ClassVar, final

import numpy as np

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, FloatArray, OnlineEstimator, Sample
from fdbench.plants import RespondingPlant
from fdbench.record import Record
from fdbench_baselines._hybrid_drive import DriveHybrid
from fdbench_baselines._one_step import MODEL as STATE_SPACE
from fdbench_baselines._one_step import declined
from fdbench_baselines._recursive_least_squares import Hybrid, free_run, predict, untrained

MM_PER_M = 1e3
DRIVES = ("velocity_loop", "inverse_dynamics", "directional_inverse_dynamics")


@final
class HybridRLS(OnlineEstimator):
    r"""Nominal physics and a learnt correction: on a servo stage of its response, on a drive of its equation.

    On a stage, prediction of the position a batch ahead, from the command and the errors before the batch:

    .. math::
        \hat x_k = x_{pb,k} + w^T \varphi_k, \qquad
        \varphi_k = (1, x_{pb,k} \ldots x_{pb,k-q}, e_{k-1} \ldots e_{k-p}), \qquad e = x - x_{pb}, \qquad
        w = \arg\min \sum_{i < j N_p} (e_i - w^T \varphi_i)^2 + \lambda |w|^2

    :math:`x_{pb}` is the response of the nominal plant to the command, w the weights of batch j, learnt from all
    batches before it. Within a batch, errors that are not measured yet are replaced by predicted ones. Before the first
    sample all signals are zero. ``output`` is :math:`\hat x`. Rows of a second axis, which start at an earlier time,
    are learnt anew. In a free run the weights are those of the whole record, and all errors are predicted ones.

    Until it has seen similar motion the model can be worse than the physics alone: a record that starts at rest needs
    ``initialisation_samples`` beyond the first move.

    On a drive, rows of its linear model a sample ahead, with corrections to the data sheet's parameters and weights on
    the errors before, of which ``error_lags`` counts alone (`DriveHybrid`): ``parameters`` with covariance,
    ``disturbance_N`` as foretold, ``output``, and a free run with the corrected parameters.

    Parameters
    ----------
    response_lags, error_lags : int
        q and p, at least 0. Paper: 3, for the command up to its jerk, and half the batch.
    batch_samples : int
        :math:`N_p`, samples that the controller looks ahead; at least 1.
    regularisation_m2 : float
        :math:`\lambda`, above 0. The 1 in the features stands for 1 mm, so that 1e-6 is 1 in the paper's units.
    initialisation_samples : int
        Samples at the start that are predicted by the physics alone; at least 0.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or the regularisation too small for the features.
    PluginError
        If a sample comes before ``start``.

    References
    ----------
    Chou, Duan, Okwudire, A linear hybrid model for enhanced servo error pre-compensation of feed drives with unmodeled
    nonlinear dynamics, CIRP Annals, eqs. (3) to (6). The size of the regularisation is ours: the paper states none. So
    is the model of a drive; its recursion is that of Hastings-James and Sage (1969).

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4.

    >>> from fdbench_baselines._example import example_drive
    >>> found = HybridRLS().fit(*example_drive(mass_ratio=1.25))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.4, 'beta_2': 0.6}
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("servo_response", STATE_SPACE, *DRIVES)

    def __init__(
        self,
        response_lags: int = 3,
        error_lags: int = 50,
        batch_samples: int = 100,
        regularisation_m2: float = 1e-6,
        initialisation_samples: int = 0,
    ) -> None:
        bounds = {
            "response_lags": (response_lags, 0),
            "error_lags": (error_lags, 0),
            "batch_samples": (batch_samples, 1),
            "initialisation_samples": (initialisation_samples, 0),
        }
        for name, (value, least) in bounds.items():
            if not isinstance(value, int) or value < least:
                raise SpecError(f"hybrid_rls: {name} = {value!r} must be an integer of at least {least}.")
        if not 0.0 < regularisation_m2 < np.inf:
            raise SpecError(f"hybrid_rls: regularisation_m2 = {regularisation_m2!r} must be above 0 and finite.")
        self.response_lags, self.error_lags, self.batch_samples = response_lags, error_lags, batch_samples
        self.regularisation_m2, self.initialisation_samples = regularisation_m2, initialisation_samples
        self._state: Hybrid | None = None
        self._axes: list[Hybrid] = []
        self._drive: DriveHybrid | None = None
        self._seen, self._last_time_s = 0, -np.inf

    def skip(self, context: Context) -> str | None:
        """Skip where the model is neither a servo's response nor an equation of a force on a drive."""
        if isinstance(context.plant, RespondingPlant) or context.model in DRIVES:
            return None
        if context.model == STATE_SPACE:
            return declined(context)
        return "the model is neither the response of a servo nor an equation of a force on a drive"

    def start(self, context: Context) -> None:
        """Forget everything."""
        reason = self.skip(context)
        if reason is not None:
            raise SpecError(f"hybrid_rls: {reason}.")
        self._nominal = np.array(list(context.nominal.values()))
        self._output, self._axes = array("d"), []
        on_stage = isinstance(context.plant, RespondingPlant)
        self._drive = None if on_stage else DriveHybrid(context, self.error_lags)
        self._begin_axis()

    def update(self, sample: Sample) -> None:
        """Predict a sample, then take it in."""
        if self._drive is not None:
            readings = sample.readings[np.newaxis]
            self._drive.take(
                sample.regressors[np.newaxis], np.array([sample.target]), sample.disturbance_gain, readings
            )
            return
        self._take(np.array([sample.time_s]), sample.regressors[np.newaxis], np.array([sample.target]))

    def estimate(self) -> Estimate:
        """Return the predictions made so far."""
        self._started()
        return Estimate(output=np.array(self._output)) if self._drive is None else self._drive.estimate()

    def fit(self, context: Context, record: Record) -> Estimate:
        """Run over a whole record."""
        regression = context.regression(record)
        self.start(context)
        if self._drive is not None:
            readings = np.empty((len(regression.target), 0)) if regression.readings is None else regression.readings
            self._drive.take(regression.regressors, regression.target, regression.disturbance_gain, readings)
            return self.estimate()
        breaks = np.flatnonzero(np.diff(regression.time_s) < 0.0) + 1
        for first, last in zip([0, *breaks], [*breaks, len(regression.time_s)], strict=True):
            rows = slice(first, last)
            self._take(regression.time_s[rows], regression.regressors[rows], regression.target[rows])
        return self.estimate()

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return physics and correction of a command; on a stage the correction follows its own predictions."""
        if not isinstance(context.plant, RespondingPlant):
            return super().predict(context, estimate, command)
        response = MM_PER_M * context.plant.nominal_response(command).reshape(len(self._axes), -1)
        runs = [row + free_run(axis, row, self.response_lags) for axis, row in zip(self._axes, response, strict=True)]
        return np.concatenate(runs) / MM_PER_M

    def _take(self, time_s: FloatArray, regressors: FloatArray, target: FloatArray) -> None:
        """Predict samples of one axis, then take them in."""
        self._started()
        if time_s[0] < self._last_time_s:
            self._begin_axis()
        self._last_time_s = float(time_s[-1])
        response = regressors @ self._nominal
        error = predict(
            self._started(),
            MM_PER_M * response,
            MM_PER_M * (target - response),
            self.response_lags,
            self.batch_samples,
        )
        if not np.isfinite(error).all():
            raise SpecError(
                f"hybrid_rls: the weights cannot be solved for with regularisation_m2 = {self.regularisation_m2:g}; "
                "the features are too alike for so small a value. Use a larger one."
            )
        error[: max(self.initialisation_samples - self._seen, 0)] = 0.0
        self._seen += len(time_s)
        self._output.frombytes((response + error / MM_PER_M).tobytes())

    def _begin_axis(self) -> None:
        self._state = untrained(self.response_lags, self.error_lags, MM_PER_M**2 * self.regularisation_m2)
        self._axes.append(self._state)
        self._seen, self._last_time_s = 0, -np.inf

    def _started(self) -> Hybrid:
        if self._state is None:
            raise PluginError("hybrid_rls: start(context) must come before update and estimate.")
        return self._state
