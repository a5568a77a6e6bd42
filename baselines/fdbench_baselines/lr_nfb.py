"""Linear regression with a basis of nonlinear functions."""

from collections.abc import Sequence
from typing import ClassVar, final

from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.record import Record
from fdbench_baselines._function_basis import NONLINEAR, declined, estimate_force
from fdbench_baselines._sparse_regression import least_squares


@final
class LrNfb(BatchEstimator):
    r"""Every line of the force as a linear function of nonlinear functions of each line of the vibration: LR-NFB.

    .. math:: \hat Y = G(X) \, \hat\zeta, \quad G(X) = [1, X, \sqrt{|X|}, X^2, e^X], \quad
              \hat\zeta = \arg\min_\zeta |Y - G(X) \, \zeta|^2

    X, Y and the result as for ``linear_regression``; 200 parts of lines make 801 distinct columns. The vibration is
    in m/s^2 and not standardised, so that the functions' shape depends on that unit. Square root, square and
    exponential do not turn with the sign of the vibration: they help where its phase repeats, as with a trigger on
    the spindle.

    A column that depends linearly on those before it, to rounding, has coefficients of zero.

    Parameters
    ----------
    functions : sequence of str
        Functions beside the constant: identity, square_root, square, exponential, cosine (of twice the value).

    Raises
    ------
    SpecError
        If there are not more training segments than columns.

    References
    ----------
    Qu and Vogl (2021), Estimating dynamic cutting forces of machine tools from measured vibrations using sparse
    regression with nonlinear function basis, eq. 8, and section 4.3 for the cosine.

    Examples
    --------
    Forces of twice the square of the acceleration; the withheld one is a cosine of 18 N in eight samples.

    >>> from fdbench_baselines._example import example_spectra
    >>> LrNfb().fit(*example_spectra(power=2)).disturbance_N[::4].round(6).tolist()
    [18.0, -18.0]
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("inverse_frequency_response",)

    def __init__(self, functions: Sequence[str] = NONLINEAR) -> None:
        self.functions = tuple(functions)

    def skip(self, context: Context) -> str | None:
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Solve for all lines at once by a QR factorisation."""
        return estimate_force(context, record, self.functions, least_squares)
