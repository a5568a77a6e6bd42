"""Linear regression of force spectra on vibration spectra."""

from typing import ClassVar, final

from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.record import Record
from fdbench_baselines._function_basis import LINEAR, declined, estimate_force
from fdbench_baselines._sparse_regression import least_squares


@final
class LinearRegression(BatchEstimator):
    r"""Every line of the force as a linear function of all lines of the vibration: LR.

    .. math:: \hat Y = [1, X] \, \hat\zeta, \quad \hat\zeta = \arg\min_\zeta |Y - [1, X] \, \zeta|^2

    with a row of X for each training segment: real and imaginary parts of its acceleration lines, m/s^2; Y likewise for
    the force, N. ``disturbance_N`` is the time signal of the predicted lines in the withheld segments.

    Raises
    ------
    SpecError
        If there are not more training segments than columns.

    References
    ----------
    Qu and Vogl (2021), Estimating dynamic cutting forces of machine tools from measured vibrations using sparse
    regression with nonlinear function basis, section 4.2.

    Examples
    --------
    Forces of 2 N s^2/m times the acceleration; the withheld one is a cosine of 6 N in eight samples.

    >>> from fdbench_baselines._example import example_spectra
    >>> LinearRegression().fit(*example_spectra(power=1)).disturbance_N[::4].round(6).tolist()
    [6.0, -6.0]
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("inverse_frequency_response",)

    def skip(self, context: Context) -> str | None:
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Solve for all lines at once by a QR factorisation."""
        return estimate_force(context, record, LINEAR, least_squares)
