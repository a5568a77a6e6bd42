"""Partially linear least-squares support vector machine (PL-LSSVM), exact for records of any length."""

from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.errors import FdbenchError, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, Regression
from fdbench.record import Record
from fdbench_baselines._envelope import likeliest_envelope
from fdbench_baselines._one_step import declined, residual_model
from fdbench_baselines._toeplitz import Cholesky, Toeplitz
from fdbench_baselines.least_squares import factorise

FloatArray = NDArray[np.float64]

DENSE_LIMIT = 20_000
UNIFORM_GRID_TOLERANCE = 1e-6


System = Toeplitz | Cholesky


class Kernel(NamedTuple):
    """Hyperparameters as `kernel_system` takes them; an infinite period and width leave the envelope alone."""

    sigma_1_s: float
    sigma_2: float
    gamma: float
    period_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class PartiallyLinearFit:
    r"""Solution of the PL-LSSVM equations, :math:`A \alpha + P \theta = y,\; P^T \alpha = 0`.

    Attributes
    ----------
    coefficients : (m,) array
        theta, one for each column of P.
    alpha : (n,) array
        Support values.
    weighted_basis : (n, m) array
        S = A^-1 P.
    information : (m, m) array
        G = P' A^-1 P; ``signal_variance`` times its inverse is the covariance of theta.
    signal_variance : float
        s^2, restricted maximum likelihood estimate of the kernel's scale: (y - P theta)' alpha / (n - m).
    """

    coefficients: FloatArray
    alpha: FloatArray
    weighted_basis: FloatArray
    information: FloatArray
    signal_variance: float

    def quadratic(self, rows: FloatArray) -> FloatArray:
        """Return w' G^-1 w for each row w."""
        return np.asarray(np.einsum("ij,ji->i", rows, np.linalg.solve(self.information, rows.T)), dtype=np.float64)


def partially_linear(system: System, basis: FloatArray, target: FloatArray) -> PartiallyLinearFit:
    r"""Fit y = P theta + f(t) + noise, the same as generalised least squares with covariance s^2 A.

    .. math:: A [S_0 | S] = [r | P], \quad \theta = \theta_0 + (S^T P)^{-1} S^T r, \quad
              \alpha = S_0 - S (\theta - \theta_0), \quad r = y - P \theta_0

    with ordinary least squares for theta_0: any start gives the same theta, but a small r keeps alpha accurate where
    the systems are solved iteratively.

    Parameters
    ----------
    system : System
        A = K + I / gamma.
    basis : (n, m) array
        P of full rank: a column of ones, if a bias c is wanted, and the regressors.
    target : (n,) array
        y.

    Raises
    ------
    SpecError
        If there are not more rows than columns of P.

    References
    ----------
    Espinoza, Suykens and De Moor, Kernel based partially linear models and nonlinear identification, IEEE Trans.
    Automatic Control 50 (2005), 1602-1606; McPherson, thesis, 2024, eq. 2.9.
    """
    degrees = len(target) - basis.shape[1]
    if degrees < 1:
        raise SpecError(f"pl_lssvm: {len(target)} rows for {basis.shape[1]} coefficients; more rows are needed.")
    start = np.linalg.lstsq(basis, target)[0]
    residual = target - basis @ start
    solutions = system.solve(np.column_stack((residual, basis)))
    weighted = solutions[:, 1:]
    information = weighted.T @ basis
    change = np.asarray(np.linalg.solve(information, weighted.T @ residual), dtype=np.float64)
    alpha = solutions[:, 0] - weighted @ change
    return PartiallyLinearFit(
        coefficients=start + change,
        alpha=alpha,
        weighted_basis=weighted,
        information=0.5 * (information + information.T),
        signal_variance=float((residual - basis @ change) @ alpha) / degrees,
    )


def predict(
    system: System, fit: PartiallyLinearFit, kernel: FloatArray, prior_variance: float, basis: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of P theta + f at new times (universal kriging); the variance is for s^2 = 1.

    Parameters
    ----------
    system, fit : System, PartiallyLinearFit
        The training matrix and its fit.
    kernel : (n, n_new) array
        Kernel between the training and the new times; ``prior_variance`` is the kernel at lag zero.
    basis : (n_new, m) array
        P at the new times.
    """
    explained = np.einsum("ij,ij->j", kernel, system.solve(kernel))
    drift = basis - kernel.T @ fit.weighted_basis
    return basis @ fit.coefficients + kernel.T @ fit.alpha, prior_variance - explained + fit.quadratic(drift)


def restricted_log_likelihood(system: Cholesky, fit: PartiallyLinearFit) -> float:
    r"""Return the restricted log likelihood for s^2 = 1, to choose hyperparameters by.

    .. math:: -\tfrac12 \left( y^T \alpha + \log|A| + \log|P^T A^{-1} P| + (n - m) \log 2 \pi \right)
    """
    degrees = len(fit.alpha) - len(fit.coefficients)
    log_information = float(np.linalg.slogdet(fit.information)[1])
    fidelity = fit.signal_variance * degrees
    return -0.5 * (fidelity + system.log_determinant() + log_information + degrees * float(np.log(2.0 * np.pi)))


def locally_periodic(lag_s: FloatArray, sigma_1_s: float, sigma_2: float, period_s: float) -> FloatArray:
    r"""Kernel of a periodic signal whose shape drifts, equal to 1 at lag zero.

    .. math:: K(\tau) = e^{-\tau^2 / 2 \sigma_1^2} e^{-\sin^2(\pi \tau / \psi) / 2 \sigma_2^2}

    McPherson, thesis, 2024, eq. 2.11, with the square on the sine and the pi that make it positive definite and of
    period psi.

    >>> float(locally_periodic(np.array([0.0]), 0.59, 0.42, 0.02)[0])
    1.0
    """
    sine = np.sin(np.pi * lag_s / period_s)
    return np.asarray(np.exp(-0.5 * (lag_s / sigma_1_s) ** 2 - 0.5 * (sine / sigma_2) ** 2), dtype=np.float64)


@kept
@njit(error_model="numpy")
def _fill_lower(
    matrix: FloatArray,
    time: FloatArray,
    sine: FloatArray,
    cosine: FloatArray,
    decay: float,
    sharpness: float,
) -> None:
    for j in range(len(time)):
        for i in range(j, len(time)):
            tau = time[i] - time[j]
            s = sine[i] * cosine[j] - cosine[i] * sine[j]
            matrix[i, j] = np.exp(-decay * tau * tau - sharpness * s * s)


def kernel_system(time_s: FloatArray, sigma_1_s: float, sigma_2: float, gamma: float, period_s: float) -> System:
    """Return K + I / gamma at the given times: from one column if the clock is uniform to 1e-6 of a step, else dense.

    Raises
    ------
    FdbenchError
        If the clock is not uniform and longer than ``DENSE_LIMIT``.
    """
    n = len(time_s)
    step_s = (time_s[-1] - time_s[0]) / (n - 1)
    grid_s = step_s * np.arange(n)
    elapsed_s = time_s - time_s[0]
    if np.max(np.abs(elapsed_s - grid_s)) <= UNIFORM_GRID_TOLERANCE * step_s:
        column = locally_periodic(grid_s, sigma_1_s, sigma_2, period_s)
        column[0] += 1.0 / gamma
        return Toeplitz(column)
    if n > DENSE_LIMIT:
        raise FdbenchError(
            f"pl_lssvm: {n} rows on a clock that is not uniform, at most {DENSE_LIMIT} are possible. "
            "Resample the record or split it."
        )
    matrix = np.zeros((n, n), order="F")
    angle = np.pi * elapsed_s / period_s
    _fill_lower(matrix, elapsed_s, np.sin(angle), np.cos(angle), 0.5 / sigma_1_s**2, 0.5 / sigma_2**2)
    matrix[np.diag_indices(n)] += 1.0 / gamma
    return Cholesky(matrix, overwrite=True)


@final
class PLLSSVM(BatchEstimator):
    r"""Linear plant plus a disturbance that is smooth in a locally periodic kernel: :math:`y = Z \beta + f(t) + c`.

    ``disturbance_N`` is f + c (c is about 0: a constant that the kernel could also carry), ``output`` is
    Z beta + f + c smoothed in sample, variances are those of the Gaussian process with this kernel and noise 1/gamma.
    The bias c is left out where the regressors already span a constant. On a uniform grid memory is O(n).

    Where no period is known f is smooth only: the kernel is its envelope :math:`e^{-\tau^2 / 2 \sigma_1^2}`, with
    :math:`\sigma_1` and gamma by Whittle's likelihood of what least squares leaves (`_envelope`). A model in state
    space has no Z; y is there what its equation leaves of a reading, if the readings give all states.

    Parameters
    ----------
    sigma_1_s : float
        :math:`\sigma_1`, time over which the period's shape is kept, s; above 0.
    sigma_2 : float
        :math:`\sigma_2`, width within a period in units of the sine; above 0.
    gamma : float
        Signal-to-noise variance ratio; above 0.
    period_s : float, optional
        :math:`\psi`, s; by default the context's disturbance period. The other three count only where there is one.

    Raises
    ------
    SpecError
        If the record does not identify every parameter.
    FdbenchError
        If more than ``DENSE_LIMIT`` rows are not on a uniform grid, or conjugate gradients do not converge.

    Validity
    --------
    The frequency 1/psi must be known: with the default sigma_1 an error of 0.65 Hz, 2.4/(2 pi sigma_1), is harmless,
    one of 2.4 Hz brings back the bias of least squares.

    References
    ----------
    McPherson, thesis, 2024, eq. 2.9 to 2.11 and table 4.1 (defaults: shaker trials).
    """

    def __init__(
        self, sigma_1_s: float = 0.59, sigma_2: float = 0.42, gamma: float = 50.3, period_s: float | None = None
    ) -> None:
        for name, value in (("sigma_1_s", sigma_1_s), ("sigma_2", sigma_2), ("gamma", gamma), ("period_s", period_s)):
            if value is not None and not 0.0 < value < np.inf:
                raise SpecError(f"pl_lssvm: {name} = {value} must be above 0 and finite.")
        self.sigma_1_s = sigma_1_s
        self.sigma_2 = sigma_2
        self.gamma = gamma
        self.period_s = period_s

    def skip(self, context: Context) -> str | None:
        """Skip where the model is no equation of a force, or rows are not a series in time."""
        if context.model == "servo_response":
            return "the model is the response of a servo, whose position holds no series of a force"
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Solve the PL-LSSVM equations in the dual, by Toeplitz methods on a uniform grid."""
        regression, predicted = residual_model(context, context.regression(record))
        z, y, gain = regression.regressors, regression.target, regression.disturbance_gain
        basis = _with_bias(regression)
        first = basis.shape[1] - z.shape[1]
        kernel = self._kernel(context, regression, basis)
        system = kernel_system(regression.time_s, *kernel)
        fit = partially_linear(system, basis, y)
        beta, s2, noise = fit.coefficients[first:], fit.signal_variance, 1.0 / kernel.gamma

        output = y - noise * fit.alpha
        smoothed = noise - noise**2 * system.inverse_diagonal()
        output_rows = noise * fit.weighted_basis
        disturbance_rows = output_rows.copy()
        disturbance_rows[:, first:] -= z
        covariance = np.asarray(s2 * np.linalg.inv(fit.information), dtype=np.float64)
        return Estimate(
            parameters=dict(zip(regression.names, beta.tolist(), strict=True)),
            covariance=covariance[first:, first:],
            disturbance_N=(output - z @ beta) / gain,
            disturbance_variance_N2=s2 * (smoothed + fit.quadratic(disturbance_rows)) / gain**2,
            output=output if predicted is None else output + predicted,
            output_variance=s2 * (smoothed + fit.quadratic(output_rows) + noise),
        )

    def _kernel(self, context: Context, regression: Regression, basis: FloatArray) -> Kernel:
        """Return the kernel of a known period, or the envelope alone that suits what least squares leaves."""
        period_s = context.disturbance_period_s if self.period_s is None else self.period_s
        if period_s is not None:
            return Kernel(self.sigma_1_s, self.sigma_2, self.gamma, period_s)
        y = regression.target
        length_s, gamma = likeliest_envelope(y - basis @ np.linalg.lstsq(basis, y)[0], regression.sampling_time_s)
        return Kernel(length_s, np.inf, gamma, np.inf)


def _with_bias(regression: Regression) -> FloatArray:
    """Return [1 Z], or Z where it spans a constant."""
    if not regression.names:
        return np.ones((len(regression.target), 1))
    u = factorise(regression.regressors, regression.names).u
    ones = np.ones(len(regression.target))
    remainder = ones - u @ (u.T @ ones)
    if float(remainder @ remainder) < 1e-16 * len(ones):
        return regression.regressors
    return np.column_stack((ones, regression.regressors))
