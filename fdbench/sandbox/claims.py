"""What a class says of itself, and of which kind the parts of an estimate must be; the rest is checked elsewhere."""

import os
from collections.abc import Mapping
from types import CodeType
from typing import Any

import numpy as np

from fdbench.errors import PluginError
from fdbench.estimator import Estimate, OnlineEstimator
from fdbench.sandbox.fault import is_own

SERIES = ("disturbance_N", "disturbance_variance_N2", "output", "output_variance")

ARRAYS = ("covariance", *SERIES)

# Methods whose answer is a claim.
CLAIMING = ("fit", "estimate", "predict")


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


def declared(cls: type[Any], own: tuple[str, ...]) -> dict[str, Any]:
    """Return what a plug-in's class says of itself, and where in its ``own`` files its methods begin."""
    models, document = getattr(cls, "made_for", None), (cls.__doc__ or "").strip()
    if not (models is None or (isinstance(models, tuple | list) and all(isinstance(model, str) for model in models))):
        raise PluginError(f"made_for is {models!r}, expected names such as ('velocity_loop',), or None for anything.")
    return {
        "made_for": None if models is None else [str(model) for model in models],
        "expected_failures": {str(check): str(reason) for check, reason in cls.expected_failures.items()},
        "has_docstring": bool(document) and document != ((cls.__base__ or object).__doc__ or "").strip(),
        "has_example": ">>> " in document,
        "is_online": issubclass(cls, OnlineEstimator),
        "places": {method: place for method in CLAIMING if (place := _place(getattr(cls, method, None), own))},
    }


def _place(method: Any, own: tuple[str, ...]) -> str:
    """Return file and line where a method begins, or nothing where it is none of ``own`` files."""
    code = getattr(method, "__code__", None)
    if not isinstance(code, CodeType) or not is_own(code.co_filename, own):
        return ""
    return f"{os.path.basename(code.co_filename)}:{code.co_firstlineno}"
