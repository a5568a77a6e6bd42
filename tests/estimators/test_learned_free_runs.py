"""Learned corrections of a nominal free run: gradients, stopping, bounds, processors, and what they are good for."""

from collections.abc import Callable

import numpy as np
import pytest
from fdbench_baselines._example import example_drive, example_milling
from fdbench_baselines._free_run_training import Trainable, stopped_early, train
from fdbench_baselines._nominal_runs import nominal_runs
from fdbench_baselines._recurrent_kernels import tanh
from fdbench_baselines.gated_recurrent_unit import GatedNetwork, GatedRecurrentUnit
from fdbench_baselines.narx_frols import NarxFrols
from fdbench_baselines.neural_state_space import FeedbackNetwork, NeuralStateSpace
from fdbench_baselines.rff_krls import RffKrls

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Estimator
from fdbench.scenario import load_scenario

NETWORKS = [GatedNetwork(3), FeedbackNetwork(np.array([0.1, 0.4]), np.array([0.3, 0.0]), 3)]
ESTIMATORS = [GatedRecurrentUnit, NeuralStateSpace, RffKrls]

networks = pytest.mark.parametrize("network", NETWORKS, ids=["gated", "feedback"])
learned = pytest.mark.parametrize("make", ESTIMATORS, ids=lambda make: make.__name__)


def test_our_tanh_is_tanh() -> None:
    x = np.linspace(-30.0, 30.0, 2001)
    assert np.allclose([tanh(value) for value in x], np.tanh(x), rtol=0.0, atol=1e-13)


@networks
def test_gradient_is_that_of_central_differences(network: Trainable) -> None:
    rng = np.random.default_rng(0)
    inputs, target = rng.standard_normal((40, 2)), rng.standard_normal(40)
    theta = network.start(2, rng)
    theta = theta + 0.5 * rng.standard_normal(theta.size)

    def cost(shifted: np.ndarray) -> float:
        return float(0.5 * np.sum((network.run(shifted, inputs) - target) ** 2))

    outputs, pull = network.run_and_slopes(theta, inputs)
    steps = 1e-6 * np.eye(theta.size)
    numeric = np.array([(cost(theta + step) - cost(theta - step)) / 2e-6 for step in steps])
    assert np.allclose(pull(outputs - target), numeric, rtol=0.0, atol=1e-8 * np.abs(numeric).max())


@networks
def test_a_network_starts_as_the_data_sheet(network: Trainable) -> None:
    rng = np.random.default_rng(0)
    assert not network.run(network.start(2, rng), rng.standard_normal((40, 2))).any()


def test_a_gated_unit_is_the_recursion_of_its_equations() -> None:
    rng, units, m = np.random.default_rng(1), 2, 3
    theta, inputs = rng.standard_normal(3 * units * (m + 1 + units) + units + m + 1), rng.standard_normal((20, m))
    W, rest = theta[: 3 * units * (m + 1)].reshape(m + 1, 3 * units), theta[3 * units * (m + 1) :]
    R, outer = rest[: 3 * units**2].reshape(3 * units, units), rest[3 * units**2 :]
    h, expected = np.zeros(units), []
    for u in inputs:
        a, q = np.append(u, 1.0) @ W, R @ h
        z, r = np.split(1.0 / (1.0 + np.exp(-(a + q)[: 2 * units])), 2)
        h = z * h + (1.0 - z) * np.tanh(a[2 * units :] + r * q[2 * units :])
        expected.append(outer[:units] @ h + outer[units:] @ np.append(u, 1.0))
    assert np.allclose(GatedNetwork(units).run(theta, inputs), expected, rtol=0.0, atol=1e-11)


def test_a_network_in_feedback_is_the_recursion_of_its_equations() -> None:
    rng, m, decays, tangents, neurons = np.random.default_rng(2), 2, np.array([0.1]), np.array([0.2]), 3
    network = FeedbackNetwork(decays, tangents, neurons)
    start = network.start(m, rng)
    theta, inputs = start + 0.3 * rng.standard_normal(start.size), rng.standard_normal((30, m))
    rho, tau = theta[:2]
    B = theta[2 : 2 + 2 * (m + 1 + neurons)].reshape(m + 1 + neurons, 2)
    Z = theta[2 + B.size : 2 + B.size + neurons * (m + 3)].reshape(m + 3, neurons)
    D = theta[2 + B.size + Z.size :]
    angle, size = 2.0 * np.arctan(0.2 + 0.1 * tau), 1.0 / (1.0 + 1e-4 + 0.1 * rho**2)
    A = size * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x, expected = np.zeros(2), []
    for u in inputs:
        w = np.tanh(np.concatenate((u, [1.0], x)) @ Z)
        driven = np.concatenate((u, [1.0], w))
        expected.append(x[0] + driven @ D)
        x = A @ x + 0.1 / 1.1 * (driven @ B)
    assert np.allclose(network.run(theta, inputs), expected, rtol=0.0, atol=1e-11)


@networks
def test_no_weights_make_a_free_run_diverge(network: Trainable) -> None:
    rng, inputs = np.random.default_rng(3), np.random.default_rng(4).standard_normal((20_000, 2))
    start = network.start(2, rng)
    for _ in range(5):
        theta = 10.0 * rng.standard_normal(start.size)
        outputs = network.run(theta, inputs)
        # Each state of the linear part forgets by 1e-4 of itself in a row at least.
        most = 1e4 * np.sum(np.abs(theta)) * (np.abs(inputs).max() + 1.0)
        assert np.abs(outputs).max() < most


@networks
def test_training_stops_where_the_withheld_error_is_least(network: Trainable) -> None:
    rng = np.random.default_rng(5)
    inputs = rng.standard_normal((300, 2))
    target = np.tanh(inputs[:, 0]) + 0.5 * rng.standard_normal(300)
    weight = np.append(np.ones(200), np.zeros(100))
    start = network.start(2, rng)
    found = [stopped_early(network, start, inputs, target, weight, count) for count in (1, 5, 20, 60)]
    errors = [error for _, error in found]
    assert errors == sorted(errors, reverse=True)
    for theta, error in found:
        assert error == pytest.approx(np.mean((target - network.run(theta, inputs))[200:] ** 2))
    assert errors[-1] < 0.6 * np.mean(target[200:] ** 2)


@networks
def test_noise_alone_teaches_nothing(network: Trainable) -> None:
    rng = np.random.default_rng(6)
    inputs, target = rng.standard_normal((600, 2)), rng.standard_normal(600)
    assert train(network, network.start(2, rng), inputs, target, 50).thetas == []


@networks
def test_what_is_below_single_precision_changes_no_weight(network: Trainable) -> None:
    rng = np.random.default_rng(7)
    inputs = rng.standard_normal((200, 2)).astype(np.float32).astype(np.float64)
    target = np.tanh(inputs[:, 0] + inputs[:, 1]).astype(np.float32).astype(np.float64)
    start = network.start(2, rng)
    here = train(network, start, inputs, target, 30).thetas
    there = train(network, start, inputs * (1.0 + 1e-15), target * (1.0 - 1e-15), 30).thetas
    assert here
    assert all(np.array_equal(one, other) for one, other in zip(here, there, strict=True))


@pytest.mark.linear_algebra
@pytest.mark.parametrize(
    ("name", "make", "share"),
    [
        ("ServoStaircase-v1", NarxFrols, 0.9),
        ("BallScrewAxis-v2", NarxFrols, 0.8),
        ("MillingAir-v2", NarxFrols, 0.1),
        ("ServoSpiral-v1", GatedRecurrentUnit, 0.5),
        ("ServoSpiral-v1", NeuralStateSpace, 0.6),
        ("ServoSpiral-v1", RffKrls, 0.5),
        ("ShakerConstant-v2", GatedRecurrentUnit, 0.5),
        ("ShakerConstant-v2", NeuralStateSpace, 0.7),
        ("ShakerConstant-v2", RffKrls, 0.2),
    ],
)
def test_it_predicts_a_motion_that_it_has_not_seen_better_than_the_sheet(
    name: str, make: Callable[[], Estimator], share: float
) -> None:
    scenario = load_scenario(name)
    context, command, errors = scenario.context(), scenario.command(), []
    assert command is not None
    for seed in (101, 102):
        record, truth = scenario.observe(seed)
        estimator = make()
        found = estimator.predict(context, estimator.fit(context, record), command)
        nominal = np.concatenate([run.target for run in nominal_runs(context, command, "sheet")])
        assert found is not None
        assert truth.response is not None
        errors.append((np.std(found - truth.response), np.std(nominal - truth.response)))
    found_error, sheet_error = np.mean(errors, axis=0)
    assert found_error < share * sheet_error


@learned
def test_the_same_seed_gives_the_same_run_and_another_one_another(make: type[Estimator]) -> None:
    context, record = example_drive(mass_ratio=1.25)

    def run(seed: int) -> np.ndarray:
        estimator = make(seed=seed)  # type: ignore[call-arg]
        found = estimator.predict(context, estimator.fit(context, record), record)
        assert found is not None
        return found

    assert np.array_equal(run(1), run(1))
    assert make is RffKrls or not np.array_equal(run(1), run(2))


@learned
def test_ratios_tell_what_was_learnt(make: type[Estimator]) -> None:
    estimator = make()
    estimator.fit(*example_drive(mass_ratio=1.25))
    assert estimator.ratios[0] < 0.1  # type: ignore[attr-defined]


@learned
def test_bad_input_is_refused(make: type[Estimator]) -> None:
    with pytest.raises(SpecError, match="seed = -1 must be an integer from 0 to"):
        make(seed=-1)  # type: ignore[call-arg]
    with pytest.raises(SpecError, match="predicts nothing from a command alone"):
        make().fit(*example_milling())
    context, record = example_drive()
    with pytest.raises(PluginError, match="must come before predict"):
        make().predict(context, None, record)  # type: ignore[arg-type]


def test_sizes_out_of_bounds_are_refused() -> None:
    with pytest.raises(SpecError, match="gated_recurrent_unit: units = 0 must be an integer from 1 to 100"):
        GatedRecurrentUnit(units=0)
    with pytest.raises(SpecError, match="neural_state_space: neurons = 101"):
        NeuralStateSpace(neurons=101)
    with pytest.raises(SpecError, match="neural_state_space: iterations = 0"):
        NeuralStateSpace(iterations=0)
    with pytest.raises(SpecError, match="rff_krls: stride = 0"):
        RffKrls(stride=0)
    with pytest.raises(SpecError, match="rff_krls: regularisation = 0"):
        RffKrls(regularisation=0.0)
