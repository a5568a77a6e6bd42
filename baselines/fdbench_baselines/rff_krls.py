"""Recursive least squares on random Fourier features, which learns what the data sheet's machine gets wrong."""

from typing import ClassVar, NamedTuple, final

import numpy as np

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.record import Record
from fdbench_baselines._forward_regression import FOLDS, GAIN, free_run
from fdbench_baselines._nominal_runs import DRIVES, known, nominal_runs, root_mean_square, unpredictable
from fdbench_baselines._recursive_least_squares import rls


class Features(NamedTuple):
    """What is regressed on: delays of inputs, errors before, and random waves of the delayed inputs.

    Attributes
    ----------
    lags, outputs : int
    numbers, phases : (m, n_waves), (n_waves,) arrays
        Wave numbers and phases.
    """

    lags: int
    outputs: int
    numbers: FloatArray
    phases: FloatArray


class LearntFeatures(NamedTuple):
    """What an axis has learnt: its features with their weights, the sizes of error and inputs, the withheld error."""

    features: Features | None
    weights: FloatArray
    size: float
    scale: FloatArray
    ratio: float


@final
class RffKrls(BatchEstimator):
    r"""Kernel recursive least squares with random Fourier features (RFF-KRLS), of what a nominal free run leaves.

    .. math::
        y_k = \hat y_k + s e_k, \qquad
        e_k = w^T \varphi(v_k) + \sum_{l=1}^{n_y} a_l e_{k-l} + \epsilon_k, \qquad
        v_k = (u_k, u_{k-d}, \ldots u_{k-Ld}) \\
        \varphi(v) = (1, v, \sqrt{2 / M} \cos(\omega_1^T v + b_1), \ldots \sqrt{2 / M} \cos(\omega_M^T v + b_M))

    with the nominal machine's response :math:`\hat y` to the command (m, m/s or N), the size s of its error and, as
    inputs u, each in units of its size, what the machine's equation multiplies on that run: on a drive commanded and
    own velocity or acceleration, velocity and direction; on a servo stage the response, with its first and second
    change from row to row. :math:`\omega \sim N(0, I / m)`, m numbers in v, and b uniform are drawn once: the inner
    product of the waves is nearly the Gaussian kernel :math:`e^{-|v - v'|^2 / 2 m}`. Nothing measured is an input, so
    that training and free run see the same.

    Weights w and a are those of recursive least squares, row after row, from zero with the covariance
    :math:`I / \lambda`. A free run puts its own e in the place of errors before. With or without delays, errors before
    and waves are eight models: the one whose free runs err least on 30 % of the record at its end and at its start,
    which were not fitted, is fitted to the whole record; each has to be better by 3 % than those before it. Where none
    is, it stays with the data sheet, which ``ratios`` tells.

    The waves are bounded and only errors before are fed back, linearly: a model with a pole of 0.9999 or more is not
    chosen, and its free run, if the fit to the whole record has made it one, is the sheet's.

    L, d, :math:`n_y` and M are those of the least mean logarithm of the free run's error on seeds 101 to 103 of six
    simulated scenarios (a servo stage's staircase and spiral, a ball screw, a shaker, two linear motors), out of 2, 4
    and 8, 1, 2 and 4, 20 and 50, 30 and 60. No measured record was among them.

    Told: the data sheet. Claims nothing but the free run. Training costs O(n p^2) for n rows and p features, at most
    118: 0.2 s for a record of 4000 rows on one core. A free run costs O(p) a row; the memory is 16 n p bytes, 8 MB: all
    rows of features are made beforehand, though the recursion needs but p^2 numbers.

    Parameters
    ----------
    lags, stride : int
        L and d, in rows; at least 0 and at least 1.
    outputs : int
        :math:`n_y`, at least 0: many, since noise of the output draws few of them to 0.
    waves : int
        M, at least 0.
    regularisation : float
        :math:`\lambda`, above 0, in units of s^2.
    seed : int
        Of the waves, at least 0.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or the nominal model has no free run.
    PluginError
        If predict comes before fit.

    Validity
    --------
    A process force is no part of it: what goes with the feed, as a mean cutting force does, is learnt as if it were the
    machine's and is missing in air. Where a command goes beyond the record, waves go on waving: what they add is then
    of the size of s and has no meaning, and the withheld parts cannot tell, as they are of the same motion. Weights of
    errors before are those of a prediction by one row, not of a free run.

    References
    ----------
    Rahimi and Recht, Random features for large-scale kernel machines, NIPS 2007, for the waves; Bouboulis, Chouvardas
    and Theodoridis, Online distributed learning over networks in RKH spaces using random Fourier features, IEEE Trans.
    Signal Processing 66 (2018), 1920-1932, for least squares on them; Engel, Mannor and Meir, The kernel recursive
    least-squares algorithm, IEEE Trans. Signal Processing 52 (2004), 2275-2285. The nominal run as input and the choice
    by free runs are ours.

    Examples
    --------
    The mass is 1.25 times that of the data sheet: an error of v that follows from the command.

    >>> from fdbench_baselines._example import example_drive
    >>> context, record = example_drive(mass_ratio=1.25)
    >>> estimator = RffKrls(stride=1)
    >>> error = estimator.predict(context, estimator.fit(context, record), record) - record["velocity_m_per_s"][1:]
    >>> bool(np.abs(error).max() < 1e-3)
    True
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("servo_response", *DRIVES)

    def __init__(
        self,
        lags: int = 8,
        stride: int = 4,
        outputs: int = 20,
        waves: int = 60,
        regularisation: float = 0.01,
        seed: int = 0,
    ) -> None:
        for name, value, least, most in (
            ("lags", lags, 0, 100),
            ("stride", stride, 1, 100),
            ("outputs", outputs, 0, 100),
            ("waves", waves, 0, 1000),
            ("seed", seed, 0, 2**32 - 1),
        ):
            if not isinstance(value, int) or not least <= value <= most:
                raise SpecError(f"rff_krls: {name} = {value!r} must be an integer from {least} to {most}.")
        if not 0.0 < regularisation < np.inf:
            raise SpecError(f"rff_krls: regularisation = {regularisation!r} must be above 0 and finite.")
        self.lags, self.stride, self.outputs, self.waves = lags, stride, outputs, waves
        self.regularisation, self.seed = regularisation, seed
        self._axes: list[LearntFeatures] | None = None

    @property
    def ratios(self) -> list[float]:
        """Withheld error of each axis beside the data sheet's, 0 to 1; 1 says that nothing was learnt."""
        return [axis.ratio for axis in self._learnt()]

    def skip(self, context: Context) -> str | None:
        """Skip where no command makes the nominal model's target."""
        return unpredictable(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Learn the error of each axis."""
        runs, axes = nominal_runs(context, record, "rff_krls"), []
        for run, target in zip(runs, np.split(context.regression(record).target, len(runs)), strict=True):
            inputs, error = known(context, run), target - run.target
            size, scale = float(root_mean_square(error)), root_mean_square(inputs)
            features, ratio = self._choose(inputs / scale, error / size)
            whole = (0.0, 1.0)
            weights = np.empty(0) if features is None else self._fitted(features, inputs / scale, error / size, whole)
            axes.append(LearntFeatures(features, weights, size, scale, ratio))
        self._axes = axes
        return Estimate()

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the nominal machine's response to a command and the error that was learnt, both in a free run."""
        responses = []
        for run, axis in zip(nominal_runs(context, command, "rff_krls"), self._learnt(), strict=True):
            error = None
            if axis.features is not None:
                error = self._run(axis.features, known(context, run) / axis.scale, axis.weights)
            responses.append(run.target if error is None else run.target + axis.size * error)
        return np.concatenate(responses)

    def _learnt(self) -> list[LearntFeatures]:
        if self._axes is None:
            raise PluginError("rff_krls: fit(context, record) must come before predict.")
        return self._axes

    def _models(self, n_inputs: int) -> list[Features]:
        """Return the models to choose from, the simplest first."""
        models = []
        for waves in sorted({0, self.waves}):
            for lags in sorted({0, self.lags}):
                rng, m = np.random.default_rng(self.seed), n_inputs * (lags + 1)
                numbers, phases = rng.standard_normal((m, waves)) / np.sqrt(m), rng.uniform(0.0, 2.0 * np.pi, waves)
                models += [Features(lags, outputs, numbers, phases) for outputs in sorted({0, self.outputs})]
        return models

    def _choose(self, inputs: FloatArray, error: FloatArray) -> tuple[Features | None, float]:
        """Return the features whose free runs err least where they were not fitted, and that error beside none."""
        without = sum(withheld(error, fold) for fold in FOLDS)
        best, chosen = without, None
        for features in self._models(inputs.shape[1]):
            found = 0.0
            for fold in FOLDS:
                run = self._run(features, inputs, self._fitted(features, inputs, error, fold))
                found += np.inf if run is None else withheld(error - run, fold)
            if found < (1.0 - GAIN) ** 2 * best:
                best, chosen = found, features
        return chosen, float(np.sqrt(best / without)) if chosen is not None else 1.0

    def _rows(self, features: Features, inputs: FloatArray) -> FloatArray:
        """Return the features of the inputs (n, p); before the first row, rest."""
        n, delays = len(inputs), self.stride * np.arange(features.lags + 1)
        delayed = np.hstack([inputs[np.maximum(np.arange(n) - delay, 0)] for delay in delays])
        waves = np.cos(delayed @ features.numbers + features.phases) * np.sqrt(2.0 / max(len(features.phases), 1))
        return np.column_stack((np.ones(n), delayed, waves))

    def _fitted(
        self, features: Features, inputs: FloatArray, error: FloatArray, fold: tuple[float, float]
    ) -> FloatArray:
        """Return the weights of the rows of a fold."""
        rows = slice(int(fold[0] * len(error)), int(fold[1] * len(error)))
        before = [np.append(np.zeros(lag), error[:-lag]) for lag in range(1, features.outputs + 1)]
        regressors = np.column_stack((self._rows(features, inputs), *before))[rows]
        p = regressors.shape[1]
        weights, P = np.zeros(p), np.eye(p) / self.regularisation
        rls(weights, P, np.ascontiguousarray(regressors), error[rows], 1.0)
        return weights

    def _run(self, features: Features, inputs: FloatArray, weights: FloatArray) -> FloatArray | None:
        return free_run(self._rows(features, inputs), list(range(len(weights))), weights)


def withheld(error: FloatArray, fold: tuple[float, float]) -> float:
    """Return the mean square of what lies outside a fold.

    >>> withheld(np.array([1.0, 1.0, 3.0, 5.0]), (0.0, 0.5))
    17.0
    """
    n = len(error)
    outside = np.append(error[: int(fold[0] * n)], error[int(fold[1] * n) :])
    return float(np.mean(outside**2))
