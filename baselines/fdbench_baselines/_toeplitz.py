"""Symmetric positive definite systems: Toeplitz in O(n) memory, by Levinson recursion or FFT, and their dense twin."""

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import cho_factor, cho_solve, lapack, solve_toeplitz, solve_triangular

from fdbench.compilation import kept
from fdbench.errors import FdbenchError

FloatArray = NDArray[np.float64]

LEVINSON_LIMIT = 4000
RELATIVE_TOLERANCE = 1e-10
MAXIMUM_ITERATIONS = 2000
ROWS_AT_ONCE = 64


class Toeplitz:
    """A symmetric positive definite Toeplitz matrix, given by its first column.

    Parameters
    ----------
    column : (n,) array
        t, the first column: A_ij = t_|i-j|.
    """

    def __init__(self, column: FloatArray) -> None:
        self.column = column

    def solve(self, right_hand_sides: FloatArray) -> FloatArray:
        """Return the solutions of A X = B, shape (n, m) as B: Levinson up to ``LEVINSON_LIMIT``, else iteratively.

        Raises
        ------
        FdbenchError
            If A is singular to working precision, or conjugate gradients do not converge.
        """
        if len(self.column) <= LEVINSON_LIMIT:
            try:
                solutions = solve_toeplitz(self.column, right_hand_sides, check_finite=False)
            except np.linalg.LinAlgError as error:
                raise FdbenchError(f"Toeplitz system of {len(self.column)} samples: {error}") from error
            return np.asarray(solutions, dtype=np.float64)
        return conjugate_gradients(self.column, right_hand_sides)[0]

    def inverse_diagonal(self) -> FloatArray:
        r"""Return the diagonal of the inverse, (n,), from its first column x alone (Gohberg and Semencul 1972).

        .. math:: (A^{-1})_{ii} = \frac{1}{x_0} \sum_{j=0}^{i} (x_j^2 - x_{n-j}^2), \quad x_n = 0
        """
        x = self.solve(np.eye(len(self.column), 1))[:, 0]
        mirrored = np.concatenate(([0.0], x[:0:-1]))
        return np.asarray(np.cumsum(x * x - mirrored * mirrored) / x[0], dtype=np.float64)

    def whitened(self, rows: FloatArray) -> tuple[FloatArray, float]:
        r"""Return L^-1 X (n, m) for rows X (n, m), with A = L L', and log|A|: innovations by the Durbin recursion.

        Row k of L^-1 holds the coefficients of the best prediction of a series of covariance A from the k values
        before, over the deviation of its error.

        Raises
        ------
        FdbenchError
            If A is not positive definite to working precision.

        References
        ----------
        Durbin, The fitting of time-series models, Revue de l'Institut International de Statistique 28 (1960), 233-244.
        """
        n = len(self.column)
        whitened = np.empty_like(rows)
        mirrored, predictor = np.ascontiguousarray(self.column[::-1]), np.zeros(n)
        scale = np.array([self.column[0], 0.0])
        for first in range(0, n, ROWS_AT_ONCE):
            last = min(n, first + ROWS_AT_ONCE)
            factor = np.zeros((last - first, last))
            _inverse_factor(mirrored, first, predictor, scale, factor)
            if not scale[0] > 0.0:
                raise FdbenchError(f"Toeplitz matrix of {n} samples is not positive definite.")
            whitened[first:last] = factor @ rows[:last]
        return whitened, float(scale[1])


@kept
@njit(error_model="numpy")
def _inverse_factor(
    mirrored: FloatArray, first: int, predictor: FloatArray, scale: FloatArray, factor: FloatArray
) -> None:
    """Write the next rows of L^-1; ``scale`` is the variance of the last prediction's error and the sum of all logs."""
    n = mirrored.size
    for k in range(first, first + len(factor)):
        if k > 0:
            reflection = (mirrored[n - 1 - k] - np.dot(predictor[: k - 1], mirrored[n - k : n - 1])) / scale[0]
            for j in range(k // 2):
                ahead, behind = predictor[j], predictor[k - 2 - j]
                predictor[j] = ahead - reflection * behind
                if j < k - 2 - j:
                    predictor[k - 2 - j] = behind - reflection * ahead
            predictor[k - 1] = reflection
            scale[0] *= 1.0 - reflection * reflection
        deviation = np.sqrt(scale[0])
        row = factor[k - first]
        for i in range(k):
            row[i] = -predictor[k - 1 - i] / deviation
        row[k] = 1.0 / deviation
        scale[1] += np.log(scale[0])


class Cholesky:
    """A symmetric positive definite (n, n) matrix; ``overwrite`` lets the factor take its place in memory."""

    def __init__(self, matrix: FloatArray, *, overwrite: bool = False) -> None:
        try:
            self.factor, _ = cho_factor(matrix, lower=True, overwrite_a=overwrite, check_finite=False)
        except np.linalg.LinAlgError as error:
            raise FdbenchError(f"kernel matrix of {len(matrix)} samples is not positive definite: {error}") from error

    def solve(self, right_hand_sides: FloatArray) -> FloatArray:
        """Return the solutions of A X = B, shape (n, m) as B."""
        return np.asarray(cho_solve((self.factor, True), right_hand_sides, check_finite=False), dtype=np.float64)

    def inverse_diagonal(self) -> FloatArray:
        """Return the diagonal of the inverse, (n,)."""
        inverse, _ = lapack.dpotri(self.factor, lower=True)
        return np.array(np.diagonal(inverse), dtype=np.float64)

    def whitened(self, rows: FloatArray) -> tuple[FloatArray, float]:
        """Return L^-1 X (n, m) for rows X (n, m), with A = L L', and log|A|."""
        return np.asarray(solve_triangular(self.factor, rows, lower=True), dtype=np.float64), self.log_determinant()

    def log_determinant(self) -> float:
        """Return the natural logarithm of the determinant."""
        return 2.0 * float(np.sum(np.log(np.diagonal(self.factor))))


def conjugate_gradients(column: FloatArray, right_hand_sides: FloatArray) -> tuple[FloatArray, int]:
    r"""Solve A X = B by preconditioned conjugate gradients, all right-hand sides at once.

    A product is a circular convolution of twice the length; the preconditioner is T. Chan's optimal circulant
    :math:`c_j = ((n - j) t_j + j t_{n-j}) / n`.

    Parameters
    ----------
    column : (n,) array
        t, the first column of A.
    right_hand_sides : (n, m) array
        B.

    Returns
    -------
    solutions : (n, m) array
        X, with residuals below ``RELATIVE_TOLERANCE`` times the norm of each right-hand side.
    iterations : int
        Number of products that were needed.

    Raises
    ------
    FdbenchError
        If this takes more than ``MAXIMUM_ITERATIONS``: A is then too ill-conditioned, or not positive definite.

    References
    ----------
    T. F. Chan, An optimal circulant preconditioner for Toeplitz systems, SIAM J. Sci. Stat. Comput. 9 (1988), 766-771.
    """
    multiply, precondition = _product(column), _preconditioner(column)
    residual = np.array(right_hand_sides.T, order="C")
    solution = np.zeros_like(residual)
    limit = RELATIVE_TOLERANCE * np.sqrt(_dot(residual, residual))
    preconditioned = precondition(residual)
    direction = preconditioned
    slope = _dot(residual, preconditioned)
    for iteration in range(MAXIMUM_ITERATIONS + 1):
        pending = ~(np.sqrt(_dot(residual, residual)) <= limit)
        if not pending.any():
            return solution.T, iteration
        image = multiply(direction)
        step = np.divide(slope, _dot(direction, image), out=np.zeros_like(slope), where=pending)[:, None]
        solution += step * direction
        image *= step
        residual -= image
        preconditioned = precondition(residual)
        previous, slope = slope, _dot(residual, preconditioned)
        direction *= np.divide(slope, previous, out=np.zeros_like(slope), where=pending)[:, None]
        direction += preconditioned
    worst = float(np.max(np.sqrt(_dot(residual, residual)) / limit)) * RELATIVE_TOLERANCE
    raise FdbenchError(
        f"Toeplitz system of {len(column)} samples: conjugate gradients stopped after {MAXIMUM_ITERATIONS} iterations "
        f"at a relative residual of {worst:.1e}, {RELATIVE_TOLERANCE:.0e} is required. Is gamma (the signal-to-noise "
        "ratio) far too large?"
    )


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b), dtype=np.float64)


def _product(column: FloatArray) -> Callable[[FloatArray], FloatArray]:
    n = len(column)
    length = fft.next_fast_len(2 * n - 1, real=True)
    embedding = np.zeros(length)
    embedding[:n] = column
    embedding[length - n + 1 :] = column[:0:-1]
    eigenvalues = fft.rfft(embedding).real

    def multiply(rows: FloatArray) -> FloatArray:
        spectrum = fft.rfft(rows, length)
        spectrum *= eigenvalues
        return np.asarray(fft.irfft(spectrum, length, overwrite_x=True)[:, :n], dtype=np.float64)

    return multiply


def _preconditioner(column: FloatArray) -> Callable[[FloatArray], FloatArray]:
    n = len(column)
    length = fft.next_fast_len(n, real=True)
    tapered = (1.0 - np.arange(n) / n) * column
    circulant = np.zeros(length)
    circulant[:n] = tapered
    circulant[length - n + 1 :] += tapered[:0:-1]
    eigenvalues = fft.rfft(circulant).real

    def precondition(rows: FloatArray) -> FloatArray:
        spectrum = fft.rfft(rows, length)
        spectrum /= eigenvalues
        return np.asarray(fft.irfft(spectrum, length, overwrite_x=True)[:, :n], dtype=np.float64)

    return precondition
