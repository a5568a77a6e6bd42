"""Symmetric positive definite systems: Toeplitz in O(n) memory, by Durbin's recursion and FFT, and their dense twin."""

from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import cho_factor, cho_solve, lapack, solve_triangular

from fdbench.compilation import kept
from fdbench.errors import FdbenchError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

REFINEMENTS, BACKWARD_ERROR = 1, 1e-13
ROWS_AT_ONCE, NUMBERS_AT_ONCE = 64, 1 << 18


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
        r"""Return the solutions of A X = B, shape (n, m) as B, directly: O(n^2) once, then O(m n log n).

        .. math:: A^{-1} = \frac{1}{x_0} \left( L(x) L(x)^T - L(\bar x) L(\bar x)^T \right), \quad
                  \bar x = (0, x_{n-1} \ldots x_1)

        with the first column x of the inverse, and L(x) the lower triangular Toeplitz matrix of first column x. What a
        solution leaves of B is solved for again, so that rounding errors of x do not count.

        Raises
        ------
        FdbenchError
            If A is not positive definite to working precision: a residual is above ``BACKWARD_ERROR`` times |A| |x|,
            of which it has some 1e-16 if it is (no method leaves less).

        References
        ----------
        Gohberg and Semencul, On the inversion of finite Toeplitz matrices and their continuous analogues, Mat. Issled.
        7 (1972), 201-223; Higham, Accuracy and stability of numerical algorithms, 2nd ed. 2002, chapter 12
        (refinement).
        """
        solutions = np.empty_like(right_hand_sides, dtype=np.float64)
        together = max(1, NUMBERS_AT_ONCE // len(self.column))
        for first in range(0, solutions.shape[1], together):
            chosen = slice(first, first + together)
            solutions[:, chosen] = self._solved(np.ascontiguousarray(right_hand_sides[:, chosen].T)).T
        return solutions

    def _solved(self, rows: FloatArray) -> FloatArray:
        solutions, residual = np.zeros_like(rows), rows
        for _ in range(1 + REFINEMENTS):
            solutions = solutions + self._inverse_times(residual)
            residual = rows - self._times(solutions)
        size = 2.0 * np.sum(np.abs(self.column)) * np.linalg.norm(solutions, axis=1)
        if not np.all(np.linalg.norm(residual, axis=1) <= BACKWARD_ERROR * size):
            raise self._singular()
        return solutions

    def _singular(self) -> FdbenchError:
        return FdbenchError(
            f"Toeplitz matrix of {len(self.column)} samples is not positive definite to working precision. Is gamma "
            "(the signal-to-noise ratio) far too large?"
        )

    @cached_property
    def _inverse_column(self) -> FloatArray:
        """First column (n,) of the inverse: the coefficients of the best prediction over its error's variance."""
        n = len(self.column)
        predictor, scale = np.zeros(n), np.array([self.column[0], 0.0])
        _durbin(np.ascontiguousarray(self.column[::-1]), 0, n, predictor, scale, np.empty((0, 0)))
        if not scale[0] > 0.0:
            raise self._singular()
        return np.asarray(np.append(1.0, -predictor[: n - 1]) / scale[0])

    @cached_property
    def _spectra(self) -> tuple[int, FloatArray, ComplexArray, ComplexArray]:
        """Length of a circular convolution that is none on n, and transforms of A, L(x) and L(x-bar) in it."""
        x, n = self._inverse_column, len(self.column)
        length = fft.next_fast_len(2 * n - 1, real=True)
        embedding = np.zeros(length)
        embedding[:n] = self.column
        embedding[length - n + 1 :] = self.column[:0:-1]
        mirrored = np.append(0.0, x[:0:-1])
        return length, fft.rfft(embedding).real, fft.rfft(x, length), fft.rfft(mirrored, length)

    def _times(self, rows: FloatArray) -> FloatArray:
        length, circulant, _, _ = self._spectra
        return np.asarray(fft.irfft(fft.rfft(rows, length) * circulant, length)[:, : len(self.column)])

    def _inverse_times(self, rows: FloatArray) -> FloatArray:
        n, (length, _, forward, backward) = len(self.column), self._spectra
        spectrum = fft.rfft(rows, length)
        upper, lower = (fft.irfft(spectrum * part.conj(), length)[:, :n] for part in (forward, backward))
        product = fft.rfft(upper, length) * forward - fft.rfft(lower, length) * backward
        return np.asarray(fft.irfft(product, length)[:, :n] / self._inverse_column[0])

    def inverse_diagonal(self) -> FloatArray:
        r"""Return the diagonal of the inverse, (n,), from its first column x alone (Gohberg and Semencul 1972).

        .. math:: (A^{-1})_{ii} = \frac{1}{x_0} \sum_{j=0}^{i} (x_j^2 - x_{n-j}^2), \quad x_n = 0
        """
        x = self._inverse_column
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
            _durbin(mirrored, first, last, predictor, scale, factor)
            if not scale[0] > 0.0:
                raise self._singular()
            whitened[first:last] = factor @ rows[:last]
        return whitened, float(scale[1])


@kept
@njit(error_model="numpy")
def _sum_of_products(a: FloatArray, b: FloatArray) -> float:
    """Return a' b in eight sums that every processor adds up alike; a library would wake threads for each."""
    whole, p, q, r, s, t, u, v, w = a.size - a.size % 8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(0, whole, 8):
        p += a[i] * b[i]
        q += a[i + 1] * b[i + 1]
        r += a[i + 2] * b[i + 2]
        s += a[i + 3] * b[i + 3]
        t += a[i + 4] * b[i + 4]
        u += a[i + 5] * b[i + 5]
        v += a[i + 6] * b[i + 6]
        w += a[i + 7] * b[i + 7]
    for i in range(whole, a.size):
        p += a[i] * b[i]
    return ((p + q) + (r + s)) + ((t + u) + (v + w))


@kept
@njit(error_model="numpy")
def _durbin(
    mirrored: FloatArray, first: int, last: int, predictor: FloatArray, scale: FloatArray, factor: FloatArray
) -> None:
    """Predict from ever more values, and write rows of L^-1 if asked for.

    ``scale`` is the variance of the last prediction's error, and the sum of all their logarithms.
    """
    n = mirrored.size
    for k in range(first, last):
        if k > 0:
            reflection = (mirrored[n - 1 - k] - _sum_of_products(predictor[: k - 1], mirrored[n - k : n - 1])) / scale[
                0
            ]
            for j in range(k // 2):
                ahead, behind = predictor[j], predictor[k - 2 - j]
                predictor[j] = ahead - reflection * behind
                if j < k - 2 - j:
                    predictor[k - 2 - j] = behind - reflection * ahead
            predictor[k - 1] = reflection
            scale[0] *= 1.0 - reflection * reflection
        scale[1] += np.log(scale[0])
        if factor.size > 0:
            deviation = np.sqrt(scale[0])
            row = factor[k - first]
            for i in range(k):
                row[i] = -predictor[k - 1 - i] / deviation
            row[k] = 1.0 / deviation


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
        """Return the diagonal of the inverse, (n,): squared lengths of the columns of L^-1."""
        inverse, _ = lapack.dtrtri(self.factor, lower=True)
        return np.array([column[place:] @ column[place:] for place, column in enumerate(inverse.T)])

    def whitened(self, rows: FloatArray) -> tuple[FloatArray, float]:
        """Return L^-1 X (n, m) for rows X (n, m), with A = L L', and log|A|."""
        return np.asarray(solve_triangular(self.factor, rows, lower=True), dtype=np.float64), self.log_determinant()

    def log_determinant(self) -> float:
        """Return the natural logarithm of the determinant."""
        return 2.0 * float(np.sum(np.log(np.diagonal(self.factor))))
