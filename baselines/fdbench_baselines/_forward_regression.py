"""Terms of a model chosen one by one: forward regression with orthogonal least squares, judged by free runs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.estimator import FloatArray

LEAST_RATIO = 1e-7  # of the target's sum of squares: what a further term has to explain
ALIKE = 1e-8  # of a column's own square: what is left of it beside the columns chosen
SLOWEST = 0.9999  # modulus of a pole that counts as stable
FOLDS = ((0.0, 0.7), (0.3, 1.0))
GAIN = 0.03


class Terms(NamedTuple):
    """Columns chosen, their weights, and the mean square error of the free runs over the folds withheld."""

    columns: list[int]
    weights: FloatArray
    error: float


def forward_regression(R: FloatArray, target: FloatArray, terms: int) -> list[int]:
    r"""Return columns in the order of their error reduction ratio, at most ``terms`` of them.

    .. math:: \mathrm{ERR}_j = \frac{(q_j^T y)^2}{(q_j^T q_j) (y^T y)}, \qquad
              q_j = p_j - \sum_{i \in \text{chosen}} q_i \frac{q_i^T p_j}{q_i^T q_i}

    Parameters
    ----------
    R : (n, m) array
        Columns p, or the triangular factor of them, which has the same inner products.
    target : (n,) array
        y, or what the orthogonal factor makes of it.

    >>> p = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> forward_regression(p, np.array([2.0, 1.0, 0.1]), 2)  # the second alone explains 90 %, the first the rest of it
    [1, 0]
    """
    size = np.linalg.norm(R, axis=0)
    Q = R / np.where(size > 0.0, size, 1.0)
    left, total = target.copy(), float(target @ target)
    chosen: list[int] = []
    while len(chosen) < terms:
        square = np.einsum("ij,ij->j", Q, Q)
        free = square > ALIKE
        free[chosen] = False
        ratio = np.where(free, (left @ Q) ** 2 / np.where(free, square, 1.0), 0.0)
        best = int(np.argmax(ratio))
        if ratio[best] <= LEAST_RATIO * total:
            break
        q = Q[:, best] / np.sqrt(square[best])
        left = left - q * (q @ left)
        Q = Q - np.outer(q, q @ Q)
        chosen.append(best)
    return chosen


def free_run(known: FloatArray, columns: list[int], weights: FloatArray) -> FloatArray | None:
    r"""Return the output (n,) of inputs' terms alone, None where it would grow without bound.

    .. math:: \hat e_k = \sum_i w_i p_i(k) + \sum_l a_l \hat e_{k-l}

    Parameters
    ----------
    known : (n, m) array
        Terms of the inputs; a column beyond m is the output l = 1, 2, ... rows before.

    >>> free_run(np.array([[1.0], [0.0], [0.0]]), [0, 1], np.array([2.0, 0.5]))
    array([2. , 1. , 0.5])
    """
    from scipy.signal import lfilter

    m = known.shape[1]
    memory = np.zeros(max([0, *(column - m + 1 for column in columns)]))
    driven = np.zeros(len(known))
    for column, weight in zip(columns, weights.tolist(), strict=True):
        if column < m:
            driven += weight * known[:, column]
        else:
            memory[column - m] = weight
    if np.abs(np.roots(np.append(1.0, -memory))).max(initial=0.0) >= SLOWEST:
        return None
    return np.asarray(lfilter([1.0], np.append(1.0, -memory), driven))


def select(
    known: FloatArray, outputs: FloatArray, allowed: list[NDArray[np.intp]], target: FloatArray, terms: int
) -> Terms:
    """Return the terms whose free runs err least on the part of each fold that they were not fitted to.

    Parameters
    ----------
    known, outputs : (n, m), (n, l) arrays
        Terms of the inputs, and the outputs before each row.
    allowed : list of arrays of int
        Sets of columns to choose among, the simplest first; a further set or term has to lower the error by 3 %.
    target : (n,) array
    terms : int
        Most terms.
    """
    n, P = len(target), np.hstack((known, outputs))
    folds = []
    for first, last in FOLDS:
        fitted = slice(int(first * n), int(last * n))
        withheld = np.ones(n, dtype=np.bool_)
        withheld[fitted] = False
        Q, R = np.linalg.qr(P[fitted])
        folds.append((R, Q.T @ target[fitted], withheld))
    best = float(np.sqrt(sum(np.mean(target[withheld] ** 2) for _, _, withheld in folds)))
    chosen: tuple[NDArray[np.intp], int] = (allowed[0], 0)
    for columns in allowed:
        paths = [(columns[forward_regression(R[:, columns], y, terms)], R, y, withheld) for R, y, withheld in folds]
        for count in range(1, max(len(path[0]) for path in paths) + 1):
            errors = []
            for path, R, y, withheld in paths:
                used = path[:count].tolist()
                run = free_run(known, used, fitted_weights(R, y, used))
                errors.append(np.inf if run is None else np.mean((target - run)[withheld] ** 2))
            error = float(np.sqrt(sum(errors)))
            if error < (1.0 - GAIN) * best:
                best, chosen = error, (columns, count)
    columns, count = chosen
    Q, R = np.linalg.qr(P)
    y = Q.T @ target
    used = columns[forward_regression(R[:, columns], y, count)].tolist()
    return Terms(used, fitted_weights(R, y, used), best)


def fitted_weights(R: FloatArray, y: FloatArray, columns: list[int]) -> FloatArray:
    """Return the weights of least squares of some columns."""
    size = np.linalg.norm(R[:, columns], axis=0)
    return np.asarray(np.linalg.lstsq(R[:, columns] / size, y, rcond=1e-10)[0] / size)
