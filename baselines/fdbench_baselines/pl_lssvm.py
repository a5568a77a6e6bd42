"""Partially linear least-squares support vector machine (PL-LSSVM), exact for records of any length."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, Regression
from fdbench.record import Record
from fdbench_baselines._envelope import likeliest_envelope
from fdbench_baselines._locally_periodic import Kernel, System, kernel_system
from fdbench_baselines._mixed_estimation import learnable
from fdbench_baselines._one_step import declined, residual_model
from fdbench_baselines._restricted_likelihood import likeliest_kernel, nearby_kernel
from fdbench_baselines._robust import indicators, loudness
from fdbench_baselines._toeplitz import Cholesky
from fdbench_baselines.least_squares import factorise

FloatArray = NDArray[np.float64]

Places = NDArray[np.intp]

MOST_ALONE = 50


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

    with ordinary least squares for theta_0, by its normal equations: any start gives the same theta, but a small r
    keeps alpha accurate.

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
    start = np.linalg.lstsq(basis.T @ basis, basis.T @ target)[0]
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


@final
class PLLSSVM(BatchEstimator):
    r"""Linear plant plus a disturbance that is smooth in a locally periodic kernel: :math:`y = Z \beta + f(t) + c`.

    .. math:: K(\tau) = e^{-\tau^2 / 2 \sigma_1^2} e^{-\sin^2(\pi \tau / \psi) / 2 \sigma_2^2}

    The hyperparameters :math:`\sigma_1, \sigma_2, \gamma, \psi` are those of greatest restricted likelihood, the period
    within 12 % of the nominal frequency (`_restricted_likelihood`). Rows that stand out, such as those in which a drive
    leaves standstill, get a coefficient of their own each, which leaves them out of all else; they are those whose
    leave-one-out residual :math:`\alpha_i / (A^{-1})_{ii}` is beyond four deviations. So do rows of inverse dynamics
    off the straight line of the data sheet's friction, where it says how exact it is (`learnable`); to the likelihood
    they are on that line. With ``hyperparameters="given"`` the published equations are solved with the values given.

    ``disturbance_N`` is f + c (c is about 0: a constant that the kernel could also carry), ``output`` is
    Z beta + f + c smoothed in sample, variances are those of the Gaussian process with this kernel and noise 1/gamma,
    the hyperparameters taken for certain. The bias c is left out where the regressors already span a constant. On a
    uniform grid memory is O(n).

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
    hyperparameters : {"likelihood", "given"}
        Whether the four are found from the record or held. What is found on a uniform clock depends on the period only.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or the record does not identify every parameter.
    FdbenchError
        If more than ``DENSE_LIMIT`` rows are not on a uniform grid, or gamma leaves too few digits.

    Validity
    --------
    One frequency and one amplitude's spread for the whole record: where the force starts or stops at once,
    :math:`\sigma_1` is found too short for the rest. A given period must be right: with the default sigma_1 an error of
    0.65 Hz, 2.4/(2 pi sigma_1), is harmless, one of 2.4 Hz brings back the bias of least squares.

    References
    ----------
    McPherson, thesis, 2024, eq. 2.9 to 2.11 and table 4.1 (values given by default: shaker trials), who leaves open how
    to choose them; Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eq. 5.8 (likelihood), 5.12
    (leave-one-out); Suykens, De Brabanter, Lukas and Vandewalle, Weighted least squares support vector machines,
    Neurocomputing 48 (2002), 85-105 (rows that stand out).

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4, beside a shaker of 5 N.

    >>> from fdbench_baselines._example import example_drive
    >>> found = PLLSSVM().fit(*example_drive(mass_ratio=1.25, wave_N=5.0, period_s=0.065))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.4, 'beta_2': 0.6}
    """

    def __init__(
        self,
        sigma_1_s: float = 0.59,
        sigma_2: float = 0.42,
        gamma: float = 50.3,
        period_s: float | None = None,
        hyperparameters: Literal["likelihood", "given"] = "likelihood",
    ) -> None:
        for name, value in (("sigma_1_s", sigma_1_s), ("sigma_2", sigma_2), ("gamma", gamma), ("period_s", period_s)):
            if value is not None and not 0.0 < value < np.inf:
                raise SpecError(f"pl_lssvm: {name} = {value} must be above 0 and finite.")
        if hyperparameters not in ("likelihood", "given"):
            raise SpecError(f"pl_lssvm: hyperparameters = {hyperparameters!r} must be likelihood or given.")
        self.sigma_1_s = sigma_1_s
        self.sigma_2 = sigma_2
        self.gamma = gamma
        self.period_s = period_s
        self.hyperparameters = hyperparameters

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
        m = basis.shape[1]
        first = m - z.shape[1]
        bent = np.flatnonzero(~learnable(context, z))
        kernel, rows = self._kernel(context, regression, basis, bent)
        alone = indicators(len(y), np.append(bent, rows))
        system = kernel_system(regression.time_s, *kernel)
        fit = partially_linear(system, np.column_stack((basis, alone)), y)
        beta, s2, noise = fit.coefficients[first:m], fit.signal_variance, 1.0 / kernel.gamma

        output = y - noise * fit.alpha - alone @ fit.coefficients[m:]
        smoothed = noise - noise**2 * system.inverse_diagonal()
        output_rows = noise * fit.weighted_basis
        output_rows[:, m:] -= alone
        disturbance_rows = output_rows.copy()
        disturbance_rows[:, first:m] -= z
        covariance = np.asarray(s2 * np.linalg.inv(fit.information), dtype=np.float64)
        return Estimate(
            parameters=dict(zip(regression.names, beta.tolist(), strict=True)),
            covariance=covariance[first:m, first:m],
            disturbance_N=(output - z @ beta) / gain,
            disturbance_variance_N2=s2 * (smoothed + fit.quadratic(disturbance_rows)) / gain**2,
            output=output if predicted is None else output + predicted,
            output_variance=s2 * (smoothed + fit.quadratic(output_rows) + noise),
        )

    def _kernel(
        self, context: Context, regression: Regression, basis: FloatArray, bent: Places
    ) -> tuple[Kernel, Places]:
        """Return the kernel of a period, or the envelope that suits what least squares leaves; rows that stand out."""
        time_s, y, rows = regression.time_s, regression.target, np.zeros(0, dtype=np.intp)
        straight = np.delete(np.arange(len(y)), bent)
        line, settled = basis @ np.linalg.lstsq(basis[straight], y[straight])[0], y.copy()
        settled[bent] = line[bent]
        period_s = context.disturbance_period_s if self.period_s is None else self.period_s
        if period_s is None:
            length_s, gamma = likeliest_envelope(settled - line, regression.sampling_time_s)
            return Kernel(length_s, np.inf, gamma, np.inf), rows
        kernel = Kernel(self.sigma_1_s, self.sigma_2, self.gamma, period_s)
        if self.hyperparameters == "likelihood":
            beside = np.column_stack((basis, indicators(len(y), bent)))
            kernel = nearby_kernel(time_s, basis, settled, kernel)
            rows = standing_out(kernel_system(time_s, *kernel), beside, y, rows)
            kernel = likeliest_kernel(time_s, np.column_stack((basis, indicators(len(y), rows))), settled, kernel)
            rows = standing_out(kernel_system(time_s, *kernel), beside, y, rows)
        return kernel, rows


def standing_out(system: System, basis: FloatArray, target: FloatArray, known: Places) -> Places:
    """Return the known rows and those beside them whose leave-one-out residual stands out, ``MOST_ALONE`` at most."""
    alpha = partially_linear(system, np.column_stack((basis, indicators(len(target), known))), target).alpha
    loud = loudness(alpha / np.sqrt(system.inverse_diagonal()))
    loud[known] = np.inf
    loudest = np.argsort(-loud, kind="stable")[:MOST_ALONE]
    return np.sort(loudest[loud[loudest] > 1.0])


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
