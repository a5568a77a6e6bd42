"""Least squares with many outputs, and sequential thresholding of its coefficients, by orthogonal factors only."""

from collections.abc import Iterator
from typing import NamedTuple, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.errors import SpecError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Sparse(NamedTuple):
    """Coefficients (n_columns, n_outputs), and how many least-squares problems each output took (n_outputs,)."""

    coefficients: FloatArray
    solves: NDArray[np.intp]


class Triangle(NamedTuple):
    r"""Some outputs that share a support: minimise :math:`|R z - C|`, with z the coefficients in units of ``scale``.

    Attributes
    ----------
    R, C : (k, k), (k, n) arrays
        R is upper triangular.
    scale : (k,) array
        Length of each column.
    columns, outputs : (k,), (n,) arrays of int
        Which they are.
    """

    R: FloatArray
    C: FloatArray
    scale: FloatArray
    columns: NDArray[np.intp]
    outputs: NDArray[np.intp]

    def coefficients(self) -> FloatArray:
        """Return the coefficients (k, n) that belong to the columns as they were given."""
        from scipy.linalg import solve_triangular

        z: FloatArray = solve_triangular(self.R, self.C, check_finite=False)
        return z / self.scale[:, None]


def factorise(regressors: FloatArray, targets: FloatArray) -> Triangle:
    r"""Return the triangle of all outputs, after columns are scaled to unit length.

    Where the first column is constant, the factors are those of the others' differences to a multiple of it,
    :math:`g_j - m_j g_0 = Q r_j`, so that :math:`g_j = Q (r_j + m_j r_0)`: no digit is lost in what they share.
    A column that depends linearly on those before it, to rounding, is left out: its coefficients are zero.

    Raises
    ------
    SpecError
        If there are not more rows than columns.
    """
    n, p = regressors.shape
    if n <= p:
        raise SpecError(f"regression: {n} training rows for {p} columns; more rows than columns are needed.")
    scale = np.linalg.norm(regressors, axis=0)
    scale[scale == 0.0] = 1.0
    # A function of small values, as their cosine, may differ from a constant in its last digits, all that it tells.
    multiple = np.median(regressors, axis=0) / regressors[0, 0] if _is_constant(regressors[:, 0]) else np.zeros(p)
    multiple[0] = 0.0
    R, C = _triangularise((regressors - multiple * regressors[:, :1]) / scale, targets)
    R[0] += multiple * scale[0] / scale * R[0, 0]
    whole = Triangle(R, C, scale, np.arange(p), np.arange(targets.shape[1]))
    independent = np.abs(np.diag(R)) > n * np.finfo(np.float64).eps
    return whole if independent.all() else _part(whole, np.flatnonzero(independent), whole.outputs)


def _is_constant(column: FloatArray) -> bool:
    return bool(column[0] != 0.0 and (column == column[0]).all())


def least_squares(regressors: FloatArray, targets: FloatArray) -> FloatArray:
    """Return the coefficients (n_columns, n_outputs) by one QR factorisation; see `factorise`."""
    return threshold_sequentially(regressors, targets, 0.0, 0).coefficients


def threshold_sequentially(regressors: FloatArray, targets: FloatArray, threshold: float, iterations: int) -> Sparse:
    r"""Sequentially thresholded least squares.

    Each pass sets the coefficients with :math:`|\zeta| < \gamma` to zero and solves for the others again, for each
    output by itself. As the test is made at the start of a pass, the last solution may hold smaller ones. A pass that
    would change nothing ends the iteration.

    The regressors are factorised once. Columns are only ever removed, so that a support's triangle comes from that of
    the pass before by Householder reflections of the few entries left below the diagonal; outputs of one support share
    it. No normal equations are formed: the condition number is not squared.

    Parameters
    ----------
    regressors, targets : (n, n_columns), (n, n_outputs) arrays
    threshold : float
        gamma, in units of target over regressor; the columns are taken as they come.
    iterations : int
        Largest number of passes.

    References
    ----------
    Brunton, Proctor, Kutz (2016), PNAS 113; Qu and Vogl (2021), figure 1, where the test lacks the magnitude.
    """
    result = np.zeros((regressors.shape[1], targets.shape[1]))
    solves = np.zeros(targets.shape[1], dtype=np.intp)
    passes = [iter([factorise(regressors, targets)])]
    while passes:
        triangle = next(passes[-1], None)
        if triangle is None:
            passes.pop()
            continue
        found = triangle.coefficients()
        small = np.abs(found) < threshold
        open_ = small.any(axis=0) & (len(passes) <= iterations)
        solves[triangle.outputs] = len(passes)
        result[np.ix_(triangle.columns, triangle.outputs[~open_])] = found[:, ~open_]
        if open_.any():
            passes.append(_parts(triangle, ~small, np.flatnonzero(open_)))
    return Sparse(result, solves)


def _parts(triangle: Triangle, keep: BoolArray, rest: NDArray[np.intp]) -> Iterator[Triangle]:
    """Yield a triangle for each support among the outputs ``rest``, those without any column left out."""
    bits = np.ascontiguousarray(np.packbits(keep[:, rest], axis=0).T)
    _, first, member = np.unique(bits.view(f"V{bits.shape[1]}").ravel(), return_index=True, return_inverse=True)
    supports = keep[:, rest[first]]
    if supports.shape[1] > 1:
        # The columns that most outputs keep come first: little is left below the diagonal when others go.
        order = np.argsort(-supports.sum(axis=1), kind="stable")
        R, C = _triangularise(triangle.R[:, order], triangle.C)
        triangle = Triangle(R, C, triangle.scale[order], triangle.columns[order], triangle.outputs)
        supports = supports[order]
    for number, support in enumerate(supports.T):
        if support.any():
            yield _part(triangle, np.flatnonzero(support), rest[member == number])


def _part(triangle: Triangle, columns: NDArray[np.intp], outputs: NDArray[np.intp]) -> Triangle:
    """Return the triangle of some columns, in increasing order, and some outputs, both by their place in another."""
    S = np.concatenate((triangle.R[:, columns], triangle.C[:, outputs]), axis=1)
    remove_subdiagonal(S, columns)
    k = len(columns)
    return Triangle(
        np.ascontiguousarray(S[:k, :k]),
        np.ascontiguousarray(S[:k, k:]),
        triangle.scale[columns],
        triangle.columns[columns],
        triangle.outputs[outputs],
    )


def _triangularise(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    p = A.shape[1]
    joint = cast(FloatArray, np.linalg.qr(np.concatenate((A, B), axis=1), mode="r"))
    return np.ascontiguousarray(joint[:p, :p]), np.ascontiguousarray(joint[:p, p:])


@kept
@njit(error_model="numpy")
def remove_subdiagonal(S: FloatArray, last: NDArray[np.intp]) -> None:
    """Make the first ``len(last)`` columns of S upper triangular, in place; column j is zero below row ``last[j]``."""
    n = S.shape[1]
    w = np.empty(n)
    for j in range(len(last)):
        bottom = last[j] + 1
        if bottom == j + 1:
            continue
        square = 0.0
        for i in range(j, bottom):
            square += S[i, j] * S[i, j]
        if square == 0.0:
            continue
        pivot = S[j, j]
        diagonal = -np.copysign(np.sqrt(square), pivot)
        head = pivot - diagonal
        weight = 1.0 / (square - pivot * diagonal)
        for c in range(j + 1, n):
            w[c] = head * S[j, c]
        for i in range(j + 1, bottom):
            v = S[i, j]
            for c in range(j + 1, n):
                w[c] += v * S[i, c]
        for c in range(j + 1, n):
            S[j, c] -= weight * head * w[c]
        for i in range(j + 1, bottom):
            v = weight * S[i, j]
            for c in range(j + 1, n):
                S[i, c] -= v * w[c]
            S[i, j] = 0.0
        S[j, j] = diagonal
