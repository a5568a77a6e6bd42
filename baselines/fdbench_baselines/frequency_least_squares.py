"""Least squares in the frequency domain."""

from collections.abc import Callable, Sequence
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.plants._plant import TransferFunctionPlant
from fdbench.record import Record
from fdbench_baselines._rational_fit import RationalFit, fit_rational

FloatArray = NDArray[np.float64]

EXCITED_SHARE = 0.1
STEP = 1e-5


def jacobian(function: Callable[[FloatArray], FloatArray], at: FloatArray) -> FloatArray:
    """Return d function/d at by central differences, exact to about ten digits."""
    columns = []
    for index, value in enumerate(at):
        step = np.zeros(len(at))
        step[index] = STEP * abs(value) if value != 0.0 else STEP
        columns.append((function(at + step) - function(at - step)) / (2.0 * step[index]))
    return np.column_stack(columns)


@final
class FrequencyLeastSquares(BatchEstimator):
    r"""Fit the plant's transfer function to :math:`G_n = Y_n / U_n`, the ratio of discrete Fourier transforms.

    The noise of a bin that is not used does no harm, but what leaks from it into the others does: a period that does
    not divide the record spreads over all bins. The covariance of the p coefficients is
    :math:`(X^T X)^{-1} E^T E / (2N - p)`, with two equations X for each of N bins and their errors E; that of the
    model's parameters follows by the Jacobian of their map. It takes the errors of the equations for independent.

    Parameters
    ----------
    bins : sequence of int, optional
        Multiples of the lowest frequency; without them those where the input is excited, that is at least 10 % of
        its largest amplitude.
    deleted_bins : sequence of int
        Bins to leave out, such as those next to a known disturbance.
    relative : bool
        Whether relative errors of G are minimised.
    iterations : int
        Iterations of Sanathanan and Koerner after the linear solution.

    Raises
    ------
    SpecError
        If a bin cannot be used, or too few are left.

    References
    ----------
    Turkay and Ulsoy (1988), eqs. (16) to (25), with the sign in (18) and the errors in (23) and (25) put right.

    Examples
    --------
    Five waves and no noise: the parameters are those of the data sheet.

    >>> from fdbench_baselines._example import example_milling
    >>> context, record = example_milling()
    >>> found = FrequencyLeastSquares().fit(context, record).parameters
    >>> all(abs(found[name] / value - 1.0) < 1e-6 for name, value in context.nominal.items())
    True
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("arx",)

    def __init__(
        self,
        bins: Sequence[int] | None = None,
        deleted_bins: Sequence[int] = (),
        relative: bool = False,
        iterations: int = 0,
    ) -> None:
        if iterations < 0:
            raise SpecError(f"frequency_least_squares: iterations: {iterations} is outside [0, inf).")
        self.bins = None if bins is None else tuple(bins)
        self.deleted_bins = frozenset(deleted_bins)
        self.relative = relative
        self.iterations = iterations

    def skip(self, context: Context) -> str | None:
        """Decline plants whose nominal model is no transfer function."""
        if isinstance(context.plant, TransferFunctionPlant):
            return None
        return "the plant offers no transfer function between measured signals"

    def fit(self, context: Context, record: Record) -> Estimate:
        """Return the discrete parameters that follow from the coefficients, with their covariance."""
        plant = context.plant
        if not isinstance(plant, TransferFunctionPlant):
            raise SpecError(f"frequency_least_squares: {self.skip(context)}.")
        fit = self.identify(plant, record)
        split = len(fit.denominator)
        names: list[str] = []

        def parameters(coefficients: FloatArray) -> FloatArray:
            values = plant.discretised(
                context.model, coefficients[split:], coefficients[:split], context.sampling_time_s
            )
            names[:] = values
            return np.array(list(values.values()))

        at = np.concatenate((fit.denominator, fit.numerator))
        values, slope = parameters(at), jacobian(parameters, at)
        covariance = slope @ fit.covariance @ slope.T
        return Estimate(
            parameters=dict(zip(names, values.tolist(), strict=True)), covariance=0.5 * (covariance + covariance.T)
        )

    def identify(self, plant: TransferFunctionPlant, record: Record) -> RationalFit:
        """Return the continuous coefficients."""
        signals = plant.transfer_function(record)
        U, Y = np.fft.rfft(signals.input), np.fft.rfft(signals.output)
        n = self._chosen(np.abs(U), len(signals.input))
        omega = np.asarray(2.0 * np.pi * n / (len(signals.input) * signals.sampling_time_s), dtype=np.float64)
        return fit_rational(omega, Y[n] / U[n], signals.n_zeros, signals.n_poles, self.relative, self.iterations)

    def _chosen(self, amplitude: FloatArray, n_samples: int) -> NDArray[np.intp]:
        last = (n_samples - 1) // 2
        inner = amplitude[1 : last + 1]
        excited = (np.flatnonzero(inner >= EXCITED_SHARE * inner.max()) + 1).tolist()
        wanted = excited if self.bins is None else self.bins
        chosen = [n for n in wanted if n not in self.deleted_bins]
        for n in chosen:
            if not 1 <= n <= last or amplitude[n] == 0.0:
                raise SpecError(
                    f"frequency_least_squares: bin {n} cannot be used; allowed: 1 to {last}, where the input is not 0."
                )
        return np.array(chosen, dtype=np.intp)
