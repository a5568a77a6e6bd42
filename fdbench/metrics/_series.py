"""Series of an outcome: what the estimate claims for each row, the window of rows, the disturbance and its truth."""

from typing import NamedTuple

import numpy as np

from fdbench.errors import PluginError
from fdbench.metrics._metric import Outcome
from fdbench.regression import FloatArray


class Disturbance(NamedTuple):
    """Disturbance force in the window, N: claimed and true, (n_window,) each."""

    estimate: FloatArray
    truth: FloatArray


def not_claimed(outcome: Outcome, name: str) -> str | None:
    """Return that the estimate lacks the series ``name``, or None if it has it."""
    return f"the estimate claims no {name}" if getattr(outcome.estimate, name) is None else None


def claimed(outcome: Outcome, name: str) -> FloatArray:
    """Return the series ``name`` of the estimate, (n_rows,).

    Raises
    ------
    PluginError
        If it is missing, has another shape, or holds NaN, an infinite value (a variance may be infinite) or a
        negative variance.
    """
    expected = np.shape(outcome.regression.target)
    values = np.asarray(getattr(outcome.estimate, name), dtype=np.float64)
    if values.shape != expected:
        raise PluginError(f"{name}: shape {values.shape}, expected {expected}, one value for each row.")
    is_variance = "variance" in name
    bad = np.isnan(values) | (values < 0.0) if is_variance else ~np.isfinite(values)
    if bad.any():
        row = int(np.argmax(bad))
        allowed = "a variance is at least 0" if is_variance else "a finite number is expected"
        raise PluginError(f"{name}: {values[row]:g} in row {row}; {allowed}.")
    return values


def in_window(outcome: Outcome) -> slice:
    """Return the rows within the scenario's ``window_s``, both ends included; all rows where it has none."""
    time_s, window_s = outcome.regression.time_s, outcome.scenario.estimation.window_s
    if window_s is None:
        return slice(0, len(time_s))
    first, last = np.searchsorted(time_s, window_s[0]), np.searchsorted(time_s, window_s[1], side="right")
    return slice(int(first), int(last))


def true_disturbance(outcome: Outcome) -> FloatArray | None:
    """Return the true disturbance force in the window, N, (n_window,), or None where the scenario has none."""
    if outcome.truth.disturbance_N is None:
        return None
    return outcome.truth.disturbance_N[outcome.regression.rows[in_window(outcome)]]


def no_disturbance(outcome: Outcome) -> str | None:
    """Return why there is no disturbance to be compared, or None if there is one."""
    truth = true_disturbance(outcome)
    if truth is None:
        return "the true disturbance is not known"
    if len(truth) < 3:
        return "fewer than 3 rows in the window"
    if np.ptp(truth) == 0.0:
        return "the true disturbance does not vary"
    return not_claimed(outcome, "disturbance_N")


def alternating_disturbance(outcome: Outcome) -> Disturbance:
    """Return claimed and true disturbance in the window, each without its mean over the window."""
    truth = true_disturbance(outcome)
    if truth is None:
        raise PluginError("disturbance_N: asked for although the true disturbance is not known.")
    estimate = claimed(outcome, "disturbance_N")[in_window(outcome)]
    return Disturbance(estimate - estimate.mean(), truth - truth.mean())


def no_white_floor(outcome: Outcome) -> str | None:
    """Return why the scenario's noise is not that of a white equation error, or None if it is.

    It is where the model is ``velocity_loop``, the equation noise is above 0 and no reading is noisy: a noisy velocity
    is regressor and target at once.
    """
    noise = outcome.scenario.reality.noise
    if outcome.scenario.estimation.model != "velocity_loop" or noise.equation_velocity_m_per_s == 0.0:
        return "the equation noise of the model is not known"
    if noise.motor_position_m > 0.0 or noise.table_position_m > 0.0 or noise.velocity_m_per_s > 0.0:
        return "noisy readings colour the equation error"
    return None
