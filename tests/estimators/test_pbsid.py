"""Subspace identification finds the modes that made the data, and sees a run-out beside the process."""

from dataclasses import replace

import numpy as np
import pytest
from fdbench_baselines._example import example_drive, example_milling
from fdbench_baselines.least_squares import LeastSquares
from fdbench_baselines.pbsid import Pbsid, ahead, free_run, model_of, states_of
from scipy.signal import dlsim

from fdbench.errors import PluginError, SpecError
from fdbench.record import Record
from fdbench.scenario import load_scenario


def poles(A: np.ndarray) -> np.ndarray:
    return np.sort_complex(np.linalg.eigvals(A))


def in_loop(gain: float, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, input and output of two modes whose input follows the noisy output."""
    rng = np.random.default_rng(0)
    A = np.array([[1.6, -0.8, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.5]])
    B, C, K = np.array([1.0, 0.0, 1.0]), np.array([0.3, 0.2, -0.4]), np.array([0.5, 0.2, 0.1])
    x, u, y = np.zeros(3), np.zeros(n), np.zeros(n)
    for k in range(n):
        e = 0.2 * rng.standard_normal()
        y[k] = C @ x + e
        u[k] = rng.standard_normal() - gain * y[k]
        x = A @ x + B * u[k] + K * e
    return A, u, y


@pytest.mark.linear_algebra
@pytest.mark.parametrize("gain", [0.0, 0.3])
def test_a_feedback_of_noise_does_not_move_the_modes(gain: float) -> None:
    A, u, y = in_loop(gain, 20_000)
    model = model_of(states_of(u, y, 40), u, y, 3)
    assert model is not None
    assert np.allclose(poles(model.A), poles(A), rtol=0.0, atol=0.02)
    # Noise of 0.2 is all that a forecast leaves; what a free run leaves is more.
    left, left_free = np.std(y - ahead(model, u, y)), np.std(y - free_run(model, u))
    assert left == pytest.approx(0.2, rel=0.02)
    assert left_free > 1.05 * left


def test_a_free_run_is_that_of_the_system_from_rest() -> None:
    _, u, y = in_loop(0.0, 2000)
    model = model_of(states_of(u, y, 20), u, y, 3)
    assert model is not None
    held = np.concatenate((np.full(500, u[0]), u))
    slow = dlsim((model.A, model.B[:, None], model.C[None], np.array([[model.D]]), 1.0), held)[1][500:, 0]
    assert np.allclose(free_run(model, u), slow, rtol=0.0, atol=1e-9)


@pytest.mark.linear_algebra
def test_a_held_feedrate_without_noise_tells_the_process_exactly() -> None:
    context = example_milling().context
    plant = replace(context.plant, hold_input=True)  # type: ignore[type-var]
    context = replace(context, plant=plant)
    a_1, a_2, b_0, b_1 = context.nominal.values()
    n = 2000
    u, y = 1e-5 * np.random.default_rng(0).standard_normal(n), np.zeros(n)
    for k in range(2, n):
        y[k] = -a_1 * y[k - 1] - a_2 * y[k - 2] + b_0 * u[k - 1] + b_1 * u[k - 2]
    columns = {
        "time_s": context.sampling_time_s * np.arange(n),
        "feedrate_m_per_s": plant.operating_feedrate_m_per_s + u - u.mean(),  # type: ignore[attr-defined]
        "force_N": plant.steady_force_N + y - y.mean(),  # type: ignore[attr-defined]
    }
    found = Pbsid().fit(context, Record(columns)).parameters
    assert found == pytest.approx(dict(context.nominal), rel=1e-5)


@pytest.mark.linear_algebra
def test_a_runout_is_a_mode_that_nothing_feeds() -> None:
    scenario = load_scenario("SlotMillingRunout200Rpm50N-v2")
    context = scenario.context()
    assert context.disturbance_period_s is not None
    record, truth = scenario.observe(11)
    true = np.array([truth.parameters[name] for name in context.nominal])
    # That something runs out is used, and not at which period.
    other = replace(context, disturbance_period_s=2.0 * context.disturbance_period_s)
    found = [np.array(list(Pbsid().fit(each, record).parameters.values())) for each in (context, other)]
    assert np.array_equal(*found)
    assert np.max(np.abs(found[0] / true - 1.0)) < 0.03
    biased = np.array(list(LeastSquares().fit(context, record).parameters.values()))
    assert np.max(np.abs(biased / true - 1.0)) > 0.5


@pytest.mark.linear_algebra
def test_the_mode_of_a_servo_stage_is_found_and_predicts_another_motion() -> None:
    scenario = load_scenario("ServoStaircase-v1")
    context, command = scenario.context(), scenario.command()
    assert command is not None
    for seed in (11, 12):
        record, truth = scenario.observe(seed)
        estimator = Pbsid()
        found = estimator.predict(context, estimator.fit(context, record), command)
        assert found is not None
        assert truth.response is not None
        nominal = context.plant.nominal_response(command)  # type: ignore[attr-defined]
        assert np.std(found - truth.response) < 0.6 * np.std(nominal - truth.response)


def test_where_the_sheet_is_exact_it_stays() -> None:
    scenario = load_scenario("ServoStaircase-v0")
    context, record = scenario.context(), scenario.record()
    columns = {name: record[name] for name in record.columns}
    columns["position_m"] = context.plant.nominal_response(record)  # type: ignore[attr-defined]
    estimator = Pbsid()
    estimate = estimator.fit(context, Record(columns))
    found = estimator.predict(context, estimate, record)
    assert found is not None
    assert np.array_equal(found, columns["position_m"])


def test_bad_input_is_refused() -> None:
    with pytest.raises(SpecError, match="pbsid: longest_past = 9 must be an integer of at least 10"):
        Pbsid(longest_past=9)
    with pytest.raises(SpecError, match="neither a servo stage nor slot milling"):
        Pbsid().fit(*example_drive())
    scenario = load_scenario("ServoStaircase-v0")
    with pytest.raises(PluginError, match="must come before predict"):
        Pbsid().predict(scenario.context(), None, scenario.record())  # type: ignore[arg-type]
    with pytest.raises(SpecError, match="30 samples; at least 40 are needed"):
        states_of(np.ones(30), np.ones(30), 80)
