"""Parameters of an outcome beside the truth: those of the model, and the physical ones that follow from them."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fdbench.errors import PluginError
from fdbench.metrics._metric import Outcome
from fdbench.regression import FloatArray

# Share of a standard error by which a parameter is varied to differentiate the physical parameters.
STEP = 1e-3


class ParameterRow(NamedTuple):
    """One parameter in its own unit; NaN for what is not known."""

    name: str
    estimate: float
    standard_error: float
    truth: float


def signed_errors(outcome: Outcome) -> list[ParameterRow]:
    """Return a row for each parameter of the model, each physical one, and each other one that the estimate names.

    Standard errors of physical parameters are those of first order: the Jacobian on both sides of the covariance.

    Raises
    ------
    PluginError
        If the covariance has a wrong shape or a negative variance.
    """
    claimed = {name: float(value) for name, value in outcome.estimate.parameters.items()}
    estimates = physical_parameters(outcome, claimed) | claimed
    truths = {name: float(value) for name, value in outcome.truth.parameters.items()}
    truths |= physical_parameters(outcome, truths)
    errors = _standard_errors(outcome, claimed)
    return [
        ParameterRow(name, estimates.get(name, math.nan), errors.get(name, math.nan), truths.get(name, math.nan))
        for name in dict.fromkeys((*truths, *estimates))
    ]


def physical_parameters(outcome: Outcome, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return what follows from the parameters of the model; nothing if one of them is missing."""
    names = outcome.regression.names
    if any(name not in parameters for name in names):
        return {}
    own = {name: float(parameters[name]) for name in names}
    values = outcome.scenario.linear_model.physical_parameters(own, outcome.record.sampling_time_s)
    return {name: float(value) for name, value in values.items()}


def comparable(truths: Mapping[str, float]) -> dict[str, float]:
    """Return the truths that a relative error can refer to: finite and not zero."""
    return {name: float(value) for name, value in truths.items() if math.isfinite(value) and value != 0.0}


def value_of(parameters: Mapping[str, float], name: str) -> float:
    """Return a parameter; one that is missing or not finite counts as 0, which is an error of 100 %."""
    value = float(parameters.get(name, 0.0))
    return value if math.isfinite(value) else 0.0


def relative_error_percent(estimates: Mapping[str, float], truths: Mapping[str, float]) -> float:
    """Return the root mean square of the relative errors over ``comparable(truths)``.

    >>> relative_error_percent({"a": 1.03, "b": 1.92}, {"a": 1.0, "b": 2.0, "c": 0.0})  # 3 % and -4 %
    3.53553
    >>> relative_error_percent({}, {"a": 5.0})
    100.0
    """
    wanted = comparable(truths)
    errors = [(value_of(estimates, name) - truth) / truth for name, truth in wanted.items()]
    return 100.0 * math.hypot(*errors) / math.sqrt(len(errors))


def _standard_errors(outcome: Outcome, claimed: Mapping[str, float]) -> dict[str, float]:
    covariance = outcome.estimate.covariance
    if covariance is None:
        return {}
    if np.shape(covariance) != (len(claimed), len(claimed)):
        raise PluginError(f"covariance: shape {np.shape(covariance)} for {len(claimed)} parameters.")
    variances = np.diag(covariance)
    if (variances < 0.0).any():
        raise PluginError("covariance: a variance is at least 0.")
    deviations = np.sqrt(variances)
    physical = _physical_standard_errors(outcome, claimed, deviations, np.asarray(covariance, dtype=np.float64))
    return physical | dict(zip(claimed, deviations.tolist(), strict=True))


def _physical_standard_errors(
    outcome: Outcome, claimed: Mapping[str, float], deviations: FloatArray, covariance: FloatArray
) -> dict[str, float]:
    names = list(physical_parameters(outcome, claimed))
    if not names:
        return {}
    spread = np.zeros((len(names), len(claimed)))
    for column, (name, deviation) in enumerate(zip(claimed, deviations.tolist(), strict=True)):
        above, below = (
            physical_parameters(outcome, {**claimed, name: claimed[name] + sign * STEP * deviation})
            for sign in (1.0, -1.0)
        )
        spread[:, column] = [(above[item] - below[item]) / (2.0 * STEP) for item in names]
    scale = np.where(deviations > 0.0, deviations, 1.0)
    correlation = covariance / np.outer(scale, scale)
    variances = np.maximum(np.einsum("ij,jk,ik->i", spread, correlation, spread), 0.0)
    return dict(zip(names, np.sqrt(variances).tolist(), strict=True))
