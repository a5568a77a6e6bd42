"""Rational transfer functions fitted to frequency responses by linear least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class RationalFit:
    r"""Fitted :math:`G(s) = (q_0 + \dots + q_m s^m) / (p_0 + \dots + p_{n-1} s^{n-1} + s^n)`.

    Attributes
    ----------
    denominator, numerator : (n,), (m + 1,) arrays
        p and q.
    covariance : (n + m + 1, n + m + 1) array
        Of p and q, in this order.
    degrees_of_freedom : int
        Real equations minus coefficients.
    """

    denominator: FloatArray
    numerator: FloatArray
    covariance: FloatArray
    degrees_of_freedom: int

    def response(self, omega: FloatArray) -> ComplexArray:
        """Return G(j omega)."""
        polynomial = np.polynomial.polynomial.polyval
        denominator = np.append(self.denominator, 1.0)
        return np.asarray(polynomial(1j * omega, self.numerator) / polynomial(1j * omega, denominator))

    def half_widths(self, probability: float = 0.95) -> FloatArray:
        """Return half the widths of the two-sided t intervals of p and q."""
        from scipy.special import stdtrit

        t = float(stdtrit(self.degrees_of_freedom, 0.5 + 0.5 * probability))
        return np.asarray(t * np.sqrt(np.diag(self.covariance)))


def fit_rational(
    omega: FloatArray,
    response: ComplexArray,
    n_zeros: int,
    n_poles: int,
    relative: bool = False,
    iterations: int = 0,
) -> RationalFit:
    r"""Fit a transfer function to a frequency response.

    Levy's equations, real and imaginary part of each frequency, are linear in the coefficients,

    .. math:: w_i [ G_i (p_0 + \dots + p_{n-1} s_i^{n-1}) - (q_0 + \dots + q_m s_i^m) ] = -w_i G_i s_i^n,
        \quad s_i = j \omega_i

    with w = 1, or 1/\|G\| for relative errors. Each further iteration (Sanathanan and Koerner) divides them by the last
    denominator, so that in the end the error of G itself is small. s is scaled by the largest frequency and columns
    to unit length, without which the powers of s cannot be told apart numerically.

    Parameters
    ----------
    omega : (n_frequencies,) array
        Frequencies, rad/s.
    response : (n_frequencies,) array
        G.

    Raises
    ------
    SpecError
        If there are too few frequencies, or they do not identify every coefficient.

    References
    ----------
    Levy, IRE Trans. Automatic Control 4 (1959); Sanathanan and Koerner, IEEE Trans. Automatic Control 8 (1963).
    """
    n = n_poles + n_zeros + 1
    freedom = 2 * len(omega) - n
    if freedom < 1:
        raise SpecError(f"rational fit: {len(omega)} frequencies for {n} coefficients; more than {n // 2} are needed.")
    size = np.abs(response) if relative else np.ones(len(omega))
    if not size.all():
        raise SpecError("rational fit: relative errors of a response that is 0 at a frequency are undefined.")
    top = float(omega.max())
    powers = np.vander(1j * omega / top, max(n_poles, n_zeros) + 1, increasing=True)
    equations = np.empty((len(omega), n + 1), dtype=np.complex128)
    equations[:, :n_poles] = powers[:, :n_poles] * response[:, None]
    equations[:, n_poles:n] = -powers[:, : n_zeros + 1]
    equations[:, n] = -powers[:, n_poles] * response
    weight = 1.0 / size
    for iteration in range(iterations + 1):
        weighted = equations * weight[:, None]
        rows = np.concatenate((weighted.real, weighted.imag))
        length = np.sqrt(np.einsum("ij,ij->j", rows[:, :n], rows[:, :n]))
        rows[:, :n] /= np.where(length > 0.0, length, 1.0)
        triangle: FloatArray = np.asarray(np.linalg.qr(rows, mode="r"))
        if iteration == 0 and np.linalg.cond(triangle[:n, :n]) * np.finfo(np.float64).eps * len(rows) >= 1.0:
            raise SpecError(
                f"rational fit: the frequency response does not identify {n_poles} poles and {n_zeros} "
                "zeros: its equations are linearly dependent. Fewer coefficients or more frequencies are needed."
            )
        scaled = np.linalg.solve(triangle[:n, :n], triangle[:n, n]) / length
        weight = 1.0 / (size * np.abs(powers[:, :n_poles] @ scaled[:n_poles] + powers[:, n_poles]))
    degree = np.concatenate((np.arange(n_poles), np.arange(n_zeros + 1)))
    scale = top ** (n_poles - degree)
    root = np.linalg.inv(triangle[:n, :n]) * (scale / length)[:, None]
    variance = float(triangle[n, n]) ** 2 / freedom
    coefficients = scaled * scale
    return RationalFit(
        denominator=coefficients[:n_poles],
        numerator=coefficients[n_poles:],
        covariance=variance * root @ root.T,
        degrees_of_freedom=freedom,
    )
