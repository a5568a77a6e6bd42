"""A plant in state space under a force that is a random walk, at the densities that make its readings likeliest."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import Context, FloatArray
from fdbench.plants import StateSpacePlant
from fdbench.record import Record
from fdbench_baselines._kalman_filter import Observer, observer
from fdbench_baselines._steady_smoother import filtered

FIRST_STEPS, CLOSE = (3.0, 5.0), 0.05  # of logarithms of densities
NOISE_DOUBT = math.log(100.0)  # deviation of the logarithm of a variance: a sheet's noise holds within a factor of ten


class ForceStart(NamedTuple):
    """Where the search begins, and the force's deviation at the start."""

    q_N2_per_s: float
    process_factor: float
    initial_force_N: float


class Likeliest(NamedTuple):
    """The model found, the inputs (n, n_inputs) and outputs (n, n_outputs) that were read."""

    model: Observer
    u: FloatArray
    y: FloatArray


def declined(context: Context) -> str | None:
    """Return why the plant's model is not one in state space, or None."""
    if context.model == "state_space" and isinstance(context.plant, StateSpacePlant):
        return None
    return "the scenario's model is not one in state space"


def likeliest(name: str, context: Context, record: Record, begin: ForceStart) -> Likeliest:
    """Return the model of greatest likelihood; ``name`` is that of the estimator that asks.

    Raises
    ------
    SpecError
        If there is no model in state space, no reading, or no steady gain.
    """
    from scipy.optimize import minimize

    plant, readings, reason = context.plant, context.regression(record).readings, declined(context)
    if not isinstance(plant, StateSpacePlant) or readings is None or reason is not None:
        raise SpecError(f"{name}: {reason or 'the regression has no readings'}.")
    period_s = context.sampling_time_s
    space = plant.state_space(period_s)
    u, y = (np.ascontiguousarray(part) for part in np.split(readings, [len(space.inputs)], axis=1))

    def at(logarithms: FloatArray) -> Observer:
        q, *factor = np.exp(logarithms)
        known = replace(space, process_variances=space.process_variances * (factor or [1.0])[0])
        return observer(known, period_s, q, begin.initial_force_N, True)

    sought = 1 + int(space.process_variances.any())
    start: FloatArray = np.log([begin.q_N2_per_s, begin.process_factor])[:sought]
    simplex = np.vstack((start, start + np.diag(FIRST_STEPS)[:sought, :sought]))

    def loss(logarithms: FloatArray) -> float:
        likely = filtered(at(logarithms), u, y)
        return 0.5 * (math.log(likely.scale) / NOISE_DOUBT) ** 2 - likely.log_likelihood

    options: Any = {"initial_simplex": simplex, "xatol": CLOSE, "fatol": 10.0 * CLOSE}
    return Likeliest(at(minimize(loss, start, method="Nelder-Mead", options=options).x), u, y)
