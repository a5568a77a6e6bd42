"""Whether an estimate has the shape that it must have; who claims something must claim it whole."""

from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.benchmark.store import LARGEST
from fdbench.errors import PluginError, did_you_mean, raise_all
from fdbench.estimator import Context, Estimate
from fdbench.record import FloatArray
from fdbench.regression import Regression
from fdbench.sandbox import check_kinds
from fdbench.sandbox.claims import SERIES


def plant_parameters(context: Context) -> frozenset[str]:
    """Return the names of the parameters of the nominal model, and of the physical ones that follow from them."""
    model, period_s = context.plant.linear_model(context.model), context.sampling_time_s
    own = model.nominal_parameters(period_s)
    return frozenset({*own, *model.physical_parameters(own, period_s)})


def check_estimate(estimate: Any, regression: Regression, others: Iterable[str] = ()) -> None:
    """Check names, types, shapes and values of what ``fit`` returned.

    Parameters
    ----------
    estimate : object
    regression : Regression
    others : iterable of str
        Names that a parameter may have besides those of the regression; see `plant_parameters`.

    Raises
    ------
    PluginError
        If it is no Estimate, a parameter has an unknown name, a series has not one value for each row of the
        regression, the covariance does not fit the parameters, or a value is not finite; the message has every such
        miss. Variances are at least 0 and may be infinite.
    """
    check_kinds(estimate)
    raise_all(_misses(estimate, regression, {*regression.names, *others}))


def _misses(estimate: Estimate, regression: Regression, allowed: Collection[str]) -> Iterator[str]:
    for name, value in estimate.parameters.items():
        if name not in allowed:
            yield f"parameters['{name}']: the model has no such parameter.{did_you_mean(name, allowed)}"
        elif not abs(value) <= LARGEST:
            yield f"parameters['{name}'] is {float(value)}, expected a finite number up to {LARGEST:g}."
    n_rows, p = len(regression.target), len(estimate.parameters)
    shapes = dict.fromkeys(SERIES, ((n_rows,), "one value for each row of the regression"))
    for field, (shape, meaning) in {**shapes, "covariance": ((p, p), "in the order of parameters")}.items():
        if (values := getattr(estimate, field)) is not None:
            array = np.asarray(values)
            if array.shape != shape:
                yield f"{field} has shape {array.shape}, expected {shape}, {meaning}."
            elif "variance" in field and field != "covariance":
                yield from _no_variance(field, array)
            elif (wrong := ~(np.abs(array) <= LARGEST)).any():
                yield _refused(field, array, wrong, f"not finite, or beyond {LARGEST:g}")
            elif field == "covariance":
                yield from _no_variance("the diagonal of covariance", np.diag(array))


def check_response(response: FloatArray, expected: FloatArray) -> None:
    """Check that what ``predict`` returned has one value for each of the true response.

    Raises
    ------
    PluginError
        If it has another shape.
    """
    if response.shape != expected.shape:
        raise PluginError(f"predict returned the shape {response.shape}, expected {expected.shape}.")


def _no_variance(field: str, array: FloatArray) -> Iterator[str]:
    wrong = np.isnan(array) | (array < 0)
    if wrong.any():
        yield _refused(field, array, wrong, "no variance; a variance is at least 0")


def _refused(field: str, array: FloatArray, wrong: NDArray[np.bool_], what: str) -> str:
    index = tuple(int(i) for i in np.argwhere(wrong)[0])
    place = index[0] if len(index) == 1 else index
    return f"{field} holds {array[index]} in row {place}: {what} ({int(wrong.sum())} of {array.size})."
