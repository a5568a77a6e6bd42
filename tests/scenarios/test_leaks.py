"""Readings from which parameters or the disturbance follow without estimation.

The way of a sample in a velocity loop, the equation of a cascade, and a force without noise.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from fdbench_baselines.least_squares import LeastSquares
from scipy.optimize import brentq, least_squares

from fdbench.catalogue import newest_ids
from fdbench.estimator import Context, FloatArray, Regression
from fdbench.plants._controllers import Cascade
from fdbench.plants._velocity_loop import held_time_s
from fdbench.plants.feed_drive import FeedDrive
from fdbench.plants.slot_milling import SlotMilling
from fdbench.record import Record
from fdbench.scenario import Reality, load_scenario, simulate

BARELY_MOVING_M_PER_S = 2e-3
LOOPS = [name for name in newest_ids() if load_scenario(name).estimation.model == "velocity_loop"]


def ways(record: Record, regression: Regression, *, summed: bool) -> FloatArray:
    r"""Return beta from position alone: x_{k+1} - x_k = (g - K h) v_k + K h v_r - ..., which no noise enters.

    K is the gain over the mass, g and h are the integrals of the pole's response over a sample. Summed, errors of the
    reading are white.
    """
    Z, steady = regression.regressors, np.ones(len(regression.target), np.bool_)
    if Z.shape[1] > 2:
        steady = np.minimum(np.abs(Z[:, 1]), np.abs(regression.target)) > BARELY_MOVING_M_PER_S
        steady &= Z[:, 1] * regression.target > 0.0
    x = record["motor_position_m"]
    X, y = Z[steady], np.diff(x)[steady]
    if summed:
        run = np.cumsum(~steady)[steady]
        levels = (run[:, None] == np.unique(run)).astype(float)
        X, y = np.hstack((np.cumsum(Z * steady[:, None], axis=0)[steady], levels)), x[1:][steady]
    scale = np.linalg.norm(X, axis=0)
    theta = np.linalg.lstsq(X / scale, y, rcond=None)[0] / scale
    period_s, g = record.sampling_time_s, theta[0] + theta[1]
    pole = brentq(lambda p: held_time_s(p, period_s) - g, -500.0, 500.0)
    h = (g - period_s) / pole
    beta_1 = theta[0] / h * g
    others = theta[2 : Z.shape[1]] / h * g
    return np.array([beta_1, math.exp(pole * period_s) - beta_1, *others])


def errors(name: str, seed: int) -> tuple[float, float, float]:
    """Return errors in the parameters: of the ways, of their sums and of least squares."""
    scenario = load_scenario(name)
    record, truth = scenario.observe(seed)
    context = scenario.context()
    regression = context.regression(record)
    size = np.sqrt(np.mean(regression.regressors**2, axis=0))
    true = np.array([truth.parameters[key] for key in regression.names])
    found = LeastSquares().fit(context, record).parameters
    claims = (
        ways(record, regression, summed=False),
        ways(record, regression, summed=True),
        np.array([found[key] for key in regression.names]),
    )
    return tuple(float(np.linalg.norm(size * (claim - true))) for claim in claims)  # type: ignore[return-value]


@pytest.mark.parametrize("name", ["MillingAir-v1", "ShakerControl-v1"])
def test_an_exact_position_gave_the_parameters_away(name: str) -> None:
    ways_alone, _, equation = errors(name, 100)
    assert ways_alone < 1e-3 * equation


@pytest.mark.parametrize("name", ["MillingAir", "ShakerControl"])
def test_a_scale_tells_less_than_the_equation(name: str) -> None:
    newest = next(found for found in LOOPS if found.startswith(f"{name}-"))
    assert min(errors(newest, 100)[:2]) > 1.5 * errors(newest, 100)[2]


@pytest.mark.parametrize("name", LOOPS)
def test_no_position_is_read_exactly(name: str) -> None:
    """A scale of 3 um leaves 1 mm/s in the way of a 3 ms sample, 50 times the noise of any loop's equation."""
    scenario = load_scenario(name)
    noise = scenario.reality.noise
    assert scenario.timing is not None
    assert noise.motor_position_m / scenario.timing.sampling_time_s > 20.0 * noise.equation_velocity_m_per_s


# ---- the equation of a cascade ----

SETTLED_S = 0.95


def step_N(context: Context, record: Record) -> float:
    """Return the force that has stepped on, from the motor's force as gains in newtons and readings give it."""
    drive, period_s = context.plant, record.sampling_time_s
    assert isinstance(drive, FeedDrive)
    assert isinstance(drive.controller, Cascade)
    assert drive.sensors is not None
    gains, t = drive.controller, record["time_s"]
    x, v = record["motor_position_m"], record["velocity_m_per_s"]
    error = gains.position_gain_per_s * (record["reference_position_m"] - x) - v
    integral = period_s * np.concatenate(([0.0], np.cumsum(error)[:-1]))
    force = gains.velocity_gain_N_s_per_m * error + gains.integral_gain_N_per_m * integral
    moved_v = period_s * np.concatenate(([0.0], np.cumsum(force)[:-1]))
    moved_x = period_s * np.concatenate(([0.0], np.cumsum(moved_v + 0.5 * period_s * force)[:-1]))
    steady, ones = t > SETTLED_S, np.ones_like(t)
    of_x = np.column_stack((moved_x, -0.5 * t**2, t, ones))[steady] / drive.sensors.position_noise_m
    of_v = np.column_stack((moved_v, -t, ones, 0.0 * ones))[steady] / drive.sensors.velocity_noise_m_per_s
    rows = np.vstack((of_x, of_v))
    read = np.concatenate(
        (x[steady] / drive.sensors.position_noise_m, v[steady] / drive.sensors.velocity_noise_m_per_s)
    )
    scale = np.linalg.norm(rows, axis=0)
    per_mass, deceleration = (np.linalg.lstsq(rows / scale, read, rcond=None)[0] / scale)[:2]
    return float(deceleration / per_mass)


def error_of_step(name: str, seed: int) -> float:
    scenario = load_scenario(name)
    record, truth = scenario.observe(seed)
    assert truth.disturbance_N is not None
    return abs(step_N(scenario.context(), record) / float(truth.disturbance_N[-1]) - 1.0)


def test_exact_gains_in_newtons_gave_the_disturbance_away() -> None:
    assert error_of_step("DriveCurrentClosed-v1", 100) < 1e-5


def test_gains_in_amperes_leave_the_torque_constant_open() -> None:
    assert error_of_step("DriveCurrentClosed-v2", 100) > 1e-2


# ---- a force without noise ----


def error_of_fit(name: str, seed: int) -> float:
    """Return the largest relative error of the parameters of a simulation fitted to the force."""
    scenario = load_scenario(name)
    record, truth = scenario.observe(seed)
    plant = scenario.plant
    assert isinstance(plant, SlotMilling)

    def process(factors: FloatArray) -> SlotMilling:
        return replace(
            plant,
            specific_cutting_force_N=plant.specific_cutting_force_N * factors[0],
            damping_ratio=plant.damping_ratio * factors[1],
            natural_frequency_rad_per_s=plant.natural_frequency_rad_per_s * factors[2],
        )

    def missing_N(factors: FloatArray) -> FloatArray:
        own = replace(scenario, plant=process(factors), draw=(), reality=Reality())
        return simulate(own, 0)[0]["force_N"] - record["force_N"]

    found = process(least_squares(missing_N, np.ones(3), xtol=1e-15, ftol=1e-15, gtol=1e-15).x)
    values = found.linear_model("arx").nominal_parameters(record.sampling_time_s)
    return max(abs(values[key] / true - 1.0) for key, true in truth.parameters.items())


def test_a_force_without_noise_gave_the_parameters_away() -> None:
    assert error_of_fit("SlotMilling-v1", 100) < 1e-8


def test_a_noisy_dynamometer_leaves_an_error() -> None:
    assert error_of_fit("SlotMilling-v2", 100) > 1e-4


@pytest.mark.parametrize("name", [name for name in newest_ids() if load_scenario(name).plant.name == "slot_milling"])
def test_no_force_is_read_exactly(name: str) -> None:
    assert load_scenario(name).reality.noise.force_N > 0.0
