"""What a data sheet says of a linear model before any sample: parameters that are as likely as it allows."""

from typing import NamedTuple

import numpy as np

from fdbench.estimator import Context, FloatArray, Regression


class Sheet(NamedTuple):
    r"""Parameters :math:`\beta = \beta_0 + L b` with b standard normal.

    Attributes
    ----------
    nominal : (p,) array
        The nominal parameters, in the order of the regression.
    root : (p, p) array
        L.
    """

    nominal: FloatArray
    root: FloatArray


def sheet(context: Context, regression: Regression) -> Sheet:
    r"""Return the data sheet's parameters and a root of their covariance.

    Where it states no covariance each parameter may be so far off that its term alone is as large as the target,
    :math:`L = \mathrm{diag}(\mathrm{rms}(y) / \mathrm{rms}(z_i))`.

    >>> from fdbench.scenario import load_scenario
    >>> scenario = load_scenario("ShakerConstant-v1")
    >>> context = scenario.context()
    >>> found = sheet(context, context.regression(scenario.record()))
    >>> np.allclose(found.root @ found.root.T, context.covariance)
    True
    """
    Z, y, names = regression.regressors, regression.target, regression.names
    in_order = list(context.nominal)
    nominal = np.array([context.nominal[name] for name in names], dtype=np.float64)
    size = np.sqrt(np.mean(Z**2, axis=0))
    size[size == 0.0] = 1.0
    if context.covariance is None:
        return Sheet(nominal, np.diag(np.sqrt(np.mean(y**2)) / size))
    place = [in_order.index(name) for name in names]
    return Sheet(nominal, _root(context.covariance[np.ix_(place, place)], size))


def sheet_beforehand(context: Context) -> Sheet:
    """Return the same before there is a record, in the order of ``context.nominal``.

    Where the data sheet states no covariance a parameter may be off by as much as its nominal value; one of 0 stays so.
    """
    nominal = np.array(list(context.nominal.values()), dtype=np.float64)
    if context.covariance is None:
        return Sheet(nominal, np.diag(np.abs(nominal)))
    deviation = np.sqrt(np.diag(context.covariance))
    return Sheet(nominal, _root(context.covariance, 1.0 / np.where(deviation > 0.0, deviation, 1.0)))


def _root(covariance: FloatArray, size: FloatArray) -> FloatArray:
    # In units of the parameters' sizes, a matrix with kilograms and newtons has eigenvalues that can be compared.
    values, vectors = np.linalg.eigh(covariance * np.outer(size, size))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) / size[:, None])
