"""Frequency-domain least squares row by row, from sliding discrete Fourier transforms."""

import math
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, FloatArray, OnlineEstimator, Sample
from fdbench.plants.slot_milling import SlotMilling
from fdbench_baselines.frequency_least_squares import jacobian

ComplexArray = NDArray[np.complex128]

# Fourier modulating functions of a second-order process vanish at both ends of a window, and so do their slopes.
DIFFERENCE = np.array([1.0, -2.0, 1.0])
LOBE = len(DIFFERENCE)


@final
class SlidingDftLeastSquares(OnlineEstimator):
    r"""Least squares on the process's differential equation, in the lowest bins of the last N samples, row by row.

    .. math::
        X_n(k) = X_n(k - 1) + (x_k - x_{k-N}) e^{-2 \pi i n k / N}, \qquad
        \mathcal{D}_m[x] = \sum_{j=0}^2 (1, -2, 1)_j \, W_k^{m+j} X_{m+j}(k)

    .. math::
        \mathcal{D}_m[s^2 y] + c_1 \mathcal{D}_m[s y] + c_2 \mathcal{D}_m[y]
            - c_3 \mathcal{D}_m[u] - c_4 \mathcal{D}_m[s u] = \epsilon_m, \qquad
        s_n = \frac{2 \pi i n}{N T}, \quad m = 1 \ldots M

    with the force y (N) and the feedrate u (m/s) about the operating point, their sliding transforms X, and
    :math:`W_k = e^{2 \pi i (k + 1) / N}`, which counts time from where the window begins. The three bins of
    :math:`\mathcal{D}_m` are the transform under :math:`(1 - e^{-i \omega_0 t})^2 e^{-i m \omega_0 t}`, a Fourier
    modulating function: it and its slope are 0 at both ends, so that the derivatives of the process pass to it without
    initial conditions, and a window need not hold whole periods of anything. Integrals are sums by the trapezoidal
    rule, both ends half. A constant does not reach them, and a run-out only from near bins, though the weights below
    give part of that back.
    The functions share bins: a row's equations are weighed by the inverse of the covariance that white noise of the
    force gives them through the sheet's denominator A,

    .. math:: C_{lm} = \sum_n d_{n-l}\, d_{n-m} |A(s_n)|^2, \qquad d = (1, -2, 1)

    and enter a triangular factor R of all so far (recursive least squares in square-root form). ``covariance`` is
    :math:`s^2 (R^T R)^{-1}` through the Jacobian of the held-input model, with
    :math:`s^2 = r^2 / (2 M (1 + (n - 1) / N) - 4)` from what is left, r: of n windows, which share samples, only every
    N-th is another one.

    Told: the data sheet, for operating point and weights; the nominal period of a run-out, next to whose harmonics no
    equation is used. Until a window is full, ``parameters`` are those of the sheet. A row costs O(M^2), about 40 us in
    NumPy, whatever has gone before; the memory is N (M + 4) complex numbers, 61 kB.

    Parameters
    ----------
    window_s : float
        N T, s: longer for lower frequencies and less noise, shorter for an earlier answer; at least 8 samples.
    functions : int
        M, at least 2; the last reaches up to bin M + 2 of the window, which is to be where the feedrate is excited.
    forgetting : float
        Share of each equation's weight that is left after a row; above 0, and 1 forgets nothing.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or the rows do not identify every coefficient.
    PluginError
        If a sample comes before ``start``.

    Validity
    --------
    The feedrate has to be excited at two frequencies at least within the bins used, and to vary smoothly: a held one is
    taken for its steps, as it is read. The equation is linear: the curvature of the power law is its floor. Noise of
    the force is in the equation's regressors; it biases by its share of the power in the bins, far less than in the
    time domain. Parameters that change within a window are averaged over it.

    References
    ----------
    Jacobsen and Lyons, The sliding DFT, IEEE Signal Processing Magazine 20 (2003), 74-80; Duda, Accurate, guaranteed
    stable, sliding discrete Fourier transform, ibid. 27 (2010), 124-127, for the form whose pole is exactly 1; Shinbrot
    (1957) for modulating functions, Pearson and Lee (1985) for those of Fourier; Turkay and Ulsoy (1988), eqs. (16) to
    (18), for the batch form.

    Examples
    --------
    Five waves and no noise: the parameters are those of the data sheet, but for 0.02 % of the trapezoidal rule.

    >>> from fdbench_baselines._example import example_milling
    >>> context, record = example_milling()
    >>> found = SlidingDftLeastSquares(window_s=1.5, functions=4).fit(context, record).parameters
    >>> all(abs(found[name] / value - 1.0) < 3e-4 for name, value in context.nominal.items())
    True
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("arx",)

    def __init__(self, window_s: float = 3.2, functions: int = 8, forgetting: float = 1.0) -> None:
        if not 0.0 < window_s < math.inf:
            raise SpecError(f"sliding_dft_least_squares: window_s = {window_s!r} must be above 0 and finite.")
        if not isinstance(functions, int) or functions < 2:
            raise SpecError(f"sliding_dft_least_squares: functions = {functions!r} must be an integer of at least 2.")
        if not 0.0 < forgetting <= 1.0:
            raise SpecError(f"sliding_dft_least_squares: forgetting = {forgetting!r} must be above 0 and at most 1.")
        self.window_s, self.functions, self.forgetting = window_s, functions, forgetting
        self._factor: FloatArray | None = None

    def skip(self, context: Context) -> str | None:
        """Decline plants that are no slot milling."""
        return None if isinstance(context.plant, SlotMilling) else "the plant is no slot milling"

    def start(self, context: Context) -> None:
        """Forget everything."""
        plant, period_s = context.plant, context.sampling_time_s
        if not isinstance(plant, SlotMilling):
            raise SpecError(f"sliding_dft_least_squares: {self.skip(context)}.")
        N, M = round(self.window_s / period_s), self.functions
        if N < 2 * (M + LOBE) + 2:
            raise SpecError(
                f"sliding_dft_least_squares: window_s = {self.window_s:g} holds {N} samples; at least "
                f"{2 * (M + LOBE) + 2} are needed for {M} functions."
            )
        self._context, self._plant = context, plant
        bins = np.arange(1, M + LOBE)
        self._s = 2j * np.pi * bins / (N * period_s)
        self._turn = np.exp(2j * np.pi * np.outer(np.arange(N), bins) / N)
        used = clear(context.disturbance_period_s, bins[:M], N * period_s)
        c_1, c_2, _, _ = plant.coefficients
        self._white = whitening(np.abs(self._s * (self._s + c_1) + c_2), used)
        self._X, self._kept = np.zeros((2, M + LOBE - 1), np.complex128), np.zeros((2, N))
        self._count, self._rows, self._stays = 0, 0.0, math.sqrt(self.forgetting)
        self._factor = np.zeros((5, 5))

    def update(self, sample: Sample) -> None:
        """Take in force and feedrate of the sample before the row; the first row has one more."""
        self._started()
        y_1, y_2, u_1, u_2 = sample.regressors
        if self._count == 0:
            self._slide(-y_2, u_2)
        self._slide(-y_1, u_1)

    def estimate(self) -> Estimate:
        """Return the held-input parameters of the process so far, with their covariance."""
        R, names = self._started(), tuple(self._context.nominal)
        if self._rows == 0.0:
            return Estimate(parameters=dict(self._context.nominal))
        size = np.linalg.norm(R[:, :4], axis=0)
        if not size.all() or np.linalg.cond(R[:4, :4] / size) * np.finfo(np.float64).eps >= 1e-2:
            raise SpecError(
                "sliding_dft_least_squares: the rows do not identify c_1 to c_4: in the bins used, the feedrate has to "
                "be excited at two frequencies at least."
            )
        root = np.linalg.inv(R[:4, :4] / size) / size[:, None]
        c = root @ R[:4, 4]
        independent = 2.0 * len(self._white) * (1.0 + (self._rows - 1.0) / len(self._turn))
        variance = R[4, 4] ** 2 / max(independent - 4.0, 1.0)

        def parameters(c: FloatArray) -> FloatArray:
            values = self._plant.discretised(self._context.model, c[2:], c[:2], self._context.sampling_time_s)
            return np.array([values[name] for name in names])

        slope = jacobian(parameters, c) @ root
        return Estimate(
            parameters=dict(zip(names, parameters(c).tolist(), strict=True)), covariance=variance * slope @ slope.T
        )

    def _slide(self, force: float, feedrate: float) -> None:
        """Take in a sample: the end of a full window, which is two equations for each function, then its newest."""
        N = len(self._turn)
        at, new = self._count % N, np.array([force, feedrate])
        change = new - self._kept[:, at]
        if self._count >= N:
            # The second derivative of a modulating function does not vanish: there both ends count half.
            Y, U = self._X * self._turn[at] + 0.5 * change[:, None]
            s = self._s
            modulated = np.array([Y, s * Y, -U, -s * U, -s * s * Y]) @ self._white.T
            rows = np.hstack((modulated.real, modulated.imag)).T
            self._factor = np.asarray(np.linalg.qr(np.vstack((self._stays * self._started(), rows)), mode="r"))
            self._rows = self.forgetting * self._rows + 1.0
        self._X += change[:, None] * self._turn[at].conj()
        self._kept[:, at] = new
        self._count += 1

    def _started(self) -> FloatArray:
        if self._factor is None:
            raise PluginError("sliding_dft_least_squares: start(context) must come before update and estimate.")
        return self._factor


def whitening(size: FloatArray, used: NDArray[np.bool_]) -> FloatArray:
    """Return what makes bins, of noise of this size (M + 2,), equations of unit noise, (n used functions, M + 2).

    >>> bins = whitening(np.array([1.0, 2.0, 3.0, 4.0]), np.array([True, True]))
    >>> (bins * [1.0, 4.0, 9.0, 16.0]) @ bins.T  # the covariance of the equations
    array([[1., 0.],
           [0., 1.]])
    """
    functions = np.array([np.roll(np.append(DIFFERENCE, np.zeros(len(used) - 1)), m) for m in np.flatnonzero(used)])
    return np.asarray(np.linalg.solve(np.linalg.cholesky((functions * size**2) @ functions.T), functions))


def clear(period_s: float | None, first: NDArray[np.intp], window_s: float) -> NDArray[np.bool_]:
    """Return which functions have no harmonic of a period within a bin of their own three.

    >>> clear(0.25, np.arange(1, 9), 2.0)  # harmonics at bins 8, 16, 24, ...
    array([ True,  True,  True,  True, False, False, False, False])
    """
    if period_s is None:
        return np.ones(len(first), dtype=np.bool_)
    harmonic = window_s / period_s
    nearest = np.maximum(np.round((first + 1) / harmonic), 1.0) * harmonic
    return np.asarray(np.abs(nearest - (first + 1)) > LOBE - 1)
