"""Whether an estimate has the shape that it must have; who claims something must claim it whole."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from fdbench.errors import PluginError, did_you_mean
from fdbench.estimator import Context
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
        regression, the covariance does not fit the parameters, or a value is not finite. Variances are at least 0 and
        may be infinite.
    """
    check_kinds(estimate)
    allowed = {*regression.names, *others}
    for name, value in estimate.parameters.items():
        _check_parameter(name, value, allowed)
    n_rows, p = len(regression.target), len(estimate.parameters)
    for field in SERIES:
        values = getattr(estimate, field)
        if values is not None:
            _check_array(field, values, (n_rows,), "one value for each row of the regression")
    if estimate.covariance is not None:
        covariance = _check_array("covariance", estimate.covariance, (p, p), "in the order of parameters")
        _check_variance("the diagonal of covariance", np.diag(covariance))


def check_response(response: FloatArray, expected: FloatArray) -> None:
    """Check that what ``predict`` returned has one value for each of the true response.

    Raises
    ------
    PluginError
        If it has another shape.
    """
    if response.shape != expected.shape:
        raise PluginError(f"predict returned the shape {response.shape}, expected {expected.shape}.")


def _check_parameter(name: Any, value: Any, allowed: Iterable[str]) -> None:
    if name not in allowed:
        raise PluginError(f"parameters['{name}']: the model has no such parameter.{did_you_mean(name, allowed)}")
    if not np.isfinite(value):
        raise PluginError(f"parameters['{name}'] is {float(value)}, expected a finite number.")


def _check_array(field: str, values: Any, shape: tuple[int, ...], meaning: str) -> Any:
    array = np.asarray(values)
    if array.shape != shape:
        raise PluginError(f"{field} has shape {array.shape}, expected {shape}, {meaning}.")
    if "variance" in field and field != "covariance":
        _check_variance(field, array)
    else:
        _refuse(field, array, ~np.isfinite(array), "not finite")
    return array


def _check_variance(field: str, array: Any) -> None:
    _refuse(field, array, np.isnan(array) | (array < 0), "no variance; a variance is at least 0")


def _refuse(field: str, array: Any, wrong: Any, what: str) -> None:
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        place = index[0] if len(index) == 1 else index
        raise PluginError(f"{field} holds {array[index]} in row {place}: {what} ({int(wrong.sum())} of {array.size}).")
