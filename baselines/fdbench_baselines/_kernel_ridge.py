"""Ridge regression with a Gaussian kernel, whose widths and ridge have the largest marginal likelihood."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Smoother = Callable[[FloatArray], ComplexArray]

# Steps of the search, as logarithms of factors, and the fall of the cost that is worth one: places of a coarse lattice
# are the same on every processor.
STEPS, FALL = (0.8, 0.4, 0.2), 1e-2
# Factors, as logarithms: widths and ridge are sought this far from where they start.
REACH = 7.0


def kernel(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return exp(-|x - y|^2 / 2) for points (n, d) and (m, d).

    >>> kernel(np.array([[0.0, 0.0]]), np.array([[0.0, 0.0], [2.0, 0.0]]))
    array([[1.        , 0.13533528]])
    """
    distance = np.sum(left**2, axis=1)[:, None] + np.sum(right**2, axis=1) - 2.0 * np.einsum("id,jd->ij", left, right)
    return np.asarray(np.exp(-0.5 * np.maximum(distance, 0.0)))


def smoother(points: FloatArray, values: ComplexArray, variances: FloatArray, start: FloatArray) -> Smoother:
    r"""Return the function of points that ridge regression makes of noisy complex values.

    .. math:: \hat f(x) = k(x)^T (K + \lambda V)^{-1} y, \quad K_{ij} = e^{-\sum_d (x_{id} - x_{jd})^2 / 2 \ell_d^2}

    with the variances V = diag(v) up to a factor, and :math:`\ell, \lambda` that minimise
    :math:`2 n \log(y^H (K + \lambda V)^{-1} y) + 2 \log |K + \lambda V|`, the marginal likelihood of real and imaginary
    parts whose size is left free (Rasmussen and Williams 2006, eq. 5.8).

    Parameters
    ----------
    points : (n, d) array
    values, variances : (n,) arrays
    start : (d,) array
        Widths to start from, in units of the points.
    """
    from scipy.linalg import cho_factor, cho_solve

    noise = variances / np.mean(np.abs(values) ** 2)
    y = np.column_stack((values.real, values.imag))

    def factor(logarithms: FloatArray) -> tuple[FloatArray, bool]:
        gram = kernel(points / (start * np.exp(logarithms[:-1])), points / (start * np.exp(logarithms[:-1])))
        # Values are never as exact as 1e-8, and a smaller ridge leaves too few digits alike on all processors.
        gram[np.diag_indices(len(gram))] += np.exp(logarithms[-1]) * noise + 1e-8
        factored: tuple[FloatArray, bool] = cho_factor(gram, lower=True, overwrite_a=True, check_finite=False)
        return factored

    def cost(logarithms: FloatArray) -> float:
        factored = factor(logarithms)
        misfit = float(np.sum(y * cho_solve(factored, y, check_finite=False)))
        return float(2.0 * len(y) * np.log(misfit) + 4.0 * np.sum(np.log(np.diag(factored[0]))))

    place = _lowest(cost, len(start) + 1)
    widths = start * np.exp(place[:-1])
    weights = cho_solve(factor(place), y, check_finite=False)
    learnt = points / widths

    def smooth(at: FloatArray) -> ComplexArray:
        real = kernel(at / widths, learnt) @ weights
        return np.asarray(real[:, 0] + 1j * real[:, 1])

    return smooth


def _lowest(cost: Callable[[FloatArray], float], n: int) -> FloatArray:
    """Return the place of a lattice where a cost of n numbers is lowest: pattern search (Hooke and Jeeves 1961).

    >>> _lowest(lambda x: float((x[0] - 1.1) ** 2 + (x[1] + 0.5) ** 2), 2).round(3).tolist()
    [1.2, -0.4]
    """
    place = np.zeros(n)
    lowest = cost(place)
    for step in STEPS:
        turning = True
        while turning:
            turning = False
            for change in (*np.diag(np.full(n, step)), *np.diag(np.full(n, -step))):
                trial = np.clip(place + change, -REACH, REACH)
                height = cost(trial)
                if height < lowest - FALL:
                    place, lowest, turning = trial, height, True
    return place
