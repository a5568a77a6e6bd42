"""Of which kind the parts of an estimate must be; their names, shapes and values are `fdbench.benchmark.validate`'s."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fdbench.errors import PluginError
from fdbench.estimator import Estimate

SERIES = ("disturbance_N", "disturbance_variance_N2", "output", "output_variance")

ARRAYS = ("covariance", *SERIES)


def check_kinds(estimate: Any) -> None:
    """Check that ``fit`` returned an Estimate of real numbers.

    Raises
    ------
    PluginError
        If it is no Estimate, its parameters are no mapping of names to numbers, or an array holds anything else.
    """
    if not isinstance(estimate, Estimate):
        raise PluginError(f"fit returned {kind_of(estimate)}, expected an Estimate.")
    if not isinstance(estimate.parameters, Mapping):
        raise PluginError(f"parameters is {kind_of(estimate.parameters)}, expected a mapping of name to number.")
    for name, value in estimate.parameters.items():
        if not isinstance(name, str):
            raise PluginError(f"parameters has the key {name!r}, expected a name.")
        if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
            raise PluginError(f"parameters['{name}'] is {kind_of(value)}, expected a number.")
    for field in ARRAYS:
        values = getattr(estimate, field)
        if values is not None:
            check_real(field, values)


def check_real(field: str, values: Any) -> None:
    """Raise a PluginError unless ``values`` can be an array of real numbers."""
    dtype = np.asarray(values).dtype
    if dtype.kind not in "fiu":
        raise PluginError(f"{field} is {kind_of(values)} of type {dtype}, expected real numbers.")


def kind_of(value: Any) -> str:
    """Return how a message calls a value.

    >>> kind_of(None), kind_of([])
    ('None', 'a list')
    """
    return "None" if value is None else f"a {type(value).__name__}"
