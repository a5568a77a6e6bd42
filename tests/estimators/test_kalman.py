"""Kalman filters against 60-digit reference data, naive twins, closed forms, and each other."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pytest
from conftest import shared_file
from fdbench_baselines import _kalman_filter as kf
from fdbench_baselines._kalman_kernels import run_nodes, run_parallel
from fdbench_baselines._sensor_fusion import FusionFilter, Network, network
from fdbench_baselines.kalman import Kalman
from fdbench_baselines.kalman_central import KalmanCentral
from fdbench_baselines.kalman_consensus import KalmanConsensus
from fdbench_baselines.kalman_distributed import KalmanDistributed
from fdbench_baselines.kalman_parallel import KalmanParallel
from fdbench_baselines.kalman_weighted import KalmanWeighted, alternate

from fdbench.effects import effects
from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, Sample, samples
from fdbench.plants import NetworkPlant, StateSpace, StateSpacePlant
from fdbench.record import FloatArray, Record
from fdbench.scenario import Scenario, load_scenario

pytestmark = pytest.mark.linear_algebra

FORMS = ("varying", "steady", "continuous")
NODE_FILTERS = (KalmanDistributed, KalmanConsensus, KalmanWeighted)


# ---- the reference data ----


@dataclass(frozen=True)
class Drive7:
    """A stiff drive of seven states with its record and what 60 digits make of it."""

    model: kf.Observer
    u: FloatArray
    y: FloatArray
    data: Mapping[str, FloatArray]

    def run(self, stop: int = 2000) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Return estimates, x, P and log-likelihood after ``stop`` samples; the first reading needs no time to pass."""
        still = self.model._replace(A=np.eye(7), B=np.zeros((7, 1)), Q=np.zeros((7, 7)))
        x, P = np.zeros(7), self.model.P.copy()
        first, likelihood = kf.filter_readings(still, x, P, self.u[:1], self.y[:1])
        rest, more = kf.filter_readings(self.model, x, P, self.u[: stop - 1], self.y[1:stop])
        return np.vstack((first, rest)), x, P, likelihood + more


@pytest.fixture(scope="module")
def drive7() -> Drive7:
    data = dict(np.load(shared_file("oracles", "kalman", "drive7_oracle.npz")))
    model = kf.Observer(data["A"], data["B"], data["C"], data["Q"], data["R"].ravel(), data["P0"])
    return Drive7(model, data["u"][:, None], data["y"][:, None], data)


def test_states_and_covariances_equal_the_oracle(drive7: Drive7) -> None:
    checkpoints = drive7.data["checkpoints"]
    assert len(checkpoints) == 40
    for row in checkpoints:
        _, x, P, _ = drive7.run(int(row[0]) + 1)
        np.testing.assert_allclose(x, row[1:8], rtol=1e-11)
        np.testing.assert_allclose(np.diag(P), row[8:], rtol=1e-11)


def test_predictions_and_likelihood_equal_the_oracle(drive7: Drive7) -> None:
    out, _, _, likelihood = drive7.run()
    innovation, variance, force = drive7.data["innov_S_dist"].T
    found = drive7.y[:, 0] - out[:, kf.PREDICTION]
    np.testing.assert_allclose(found, innovation, rtol=0, atol=1e-11 * np.abs(innovation).max())
    np.testing.assert_allclose(out[:, kf.PREDICTION_VARIANCE], variance, rtol=1e-11)
    np.testing.assert_allclose(out[:, kf.FORCE], force, rtol=0, atol=1e-11 * np.abs(force).max())
    assert likelihood == pytest.approx(float(drive7.data["loglik"]), rel=1e-12)


def test_steady_gains_equal_the_oracle(drive7: Drive7) -> None:
    P = kf.steady_covariance(drive7.model)
    K = kf.gain(P, drive7.model.C, drive7.model.R)[:, 0]
    np.testing.assert_allclose(P, drive7.data["P_pred_steady"], rtol=1e-12)
    np.testing.assert_allclose(K, drive7.data["K_filter_steady"], rtol=1e-12)
    np.testing.assert_allclose(drive7.model.A @ K, drive7.data["K_predictor_steady"], rtol=1e-12)


def test_constant_gain_is_where_the_varying_one_settles(drive7: Drive7) -> None:
    out = kf.run_constant_filter(kf.steady_filter(drive7.model), np.zeros(7), drive7.u[:-1], drive7.y[1:])
    varying = drive7.run()[0][1:]
    for column in range(kf.OUT_COLUMNS):
        size = np.abs(varying[1000:, column]).max()
        np.testing.assert_allclose(out[1000:, column], varying[1000:, column], rtol=0, atol=1e-10 * size)


# ---- numerics ----


def random_model(seed: int, n: int, inputs: int, outputs: int) -> kf.Observer:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    root, start = rng.standard_normal((2, n, n))
    B, C = rng.standard_normal((n, inputs)), rng.standard_normal((outputs, n))
    return kf.Observer(A, B, C, root @ root.T, rng.uniform(0.1, 2.0, outputs), start @ start.T)


def naive(model: kf.Observer, u: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return what the filter claims, x, P and log-likelihood, with all readings of a row at once."""
    x, P, rows, likelihood = np.zeros(len(model.A)), model.P, [], 0.0
    for inputs, readings in zip(u, y, strict=True):
        x, P = model.A @ x + model.B @ inputs, model.A @ P @ model.A.T + model.Q
        S = model.C @ P @ model.C.T + np.diag(model.R)
        error = readings - model.C @ x
        K = P @ model.C.T @ np.linalg.inv(S)
        row = [(model.C @ x)[0], S[0, 0]]
        likelihood -= 0.5 * (np.linalg.slogdet(2 * np.pi * S)[1] + error @ np.linalg.solve(S, error))
        x, P = x + K @ error, P - K @ model.C @ P
        rows.append([*row, x[-1], P[-1, -1]])
    return np.array(rows), x, P, likelihood


@pytest.mark.parametrize(("n", "inputs", "outputs"), [(3, 0, 1), (7, 2, 3), (9, 1, 2)])
def test_filter_equals_a_naive_twin(n: int, inputs: int, outputs: int) -> None:
    model = random_model(n, n, inputs, outputs)
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal((40, inputs)), rng.standard_normal((40, outputs))
    expected, x, P, likelihood = naive(model, u, y)
    state, covariance = np.zeros(n), model.P.copy()
    out, found = kf.filter_readings(model, state, covariance, u, y)
    np.testing.assert_allclose(out, expected, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(state, x, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(covariance, P, rtol=1e-8, atol=1e-9)
    assert found == pytest.approx(likelihood, rel=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_steady_covariance_solves_its_equation(seed: int) -> None:
    model = random_model(seed, 6, 0, 2)
    P = kf.steady_covariance(model)
    K = kf.gain(P, model.C, model.R)
    after = (np.eye(6) - K @ model.C) @ P
    np.testing.assert_allclose(model.A @ after @ model.A.T + model.Q, P, rtol=1e-10, atol=1e-11)


def test_no_steady_state_is_an_error() -> None:
    blind = kf.Observer(
        np.array([[1.0, 0.0], [0.0, 0.5]]), np.empty((2, 0)), np.array([[0.0, 1.0]]), np.eye(2), np.ones(1), np.eye(2)
    )
    with pytest.raises(SpecError, match="no steady gain"):
        kf.steady_covariance(blind)


def space_of(name: str, sampling_time_s: float = 1e-3) -> StateSpace:
    plant = load_scenario(name).plant
    assert isinstance(plant, StateSpacePlant)
    return plant.state_space(sampling_time_s)


def test_force_may_drift_within_a_sample_or_step_at_its_end() -> None:
    """Covariances by the trapezoidal rule, of the walk and of the noise of a held current."""
    from scipy.linalg import expm

    period, q = 1e-3, 1e4
    space = space_of("DriveCurrentClosed-v0")
    A, B, _ = kf.with_force(space)
    times = np.linspace(0.0, period, 2001)
    flows = np.array([expm(A * t) for t in times])
    walk = np.trapezoid([q * np.outer(flow[:, -1], flow[:, -1]) for flow in flows], times, axis=0)
    held = np.asarray(np.trapezoid(flows @ B, times, axis=0))
    current = held @ held.T * 0.01**2
    drifting = kf.observer(space, period, q, 100.0, True)
    stepping = kf.observer(space, period, q, 100.0, False)
    np.testing.assert_allclose(drifting.Q, walk + current, rtol=1e-6)
    expected = current.copy()
    expected[-1, -1] += q * period
    np.testing.assert_allclose(stepping.Q, expected, rtol=1e-6, atol=1e-30)
    np.testing.assert_allclose(drifting.B, held, rtol=1e-6)
    np.testing.assert_allclose(drifting.A, flows[-1], rtol=1e-13)
    np.testing.assert_array_equal(np.diag(drifting.P), [0.25, 0.25, 1e4])


def test_continuous_gain_solves_its_equation() -> None:
    """SA2: 1.14 N and 2517 Hz are figures of the reproduction; here the Riccati equation itself."""
    space, period = space_of("SpindleStep-v0"), 1e-4
    A, _, C = kf.with_force(space)
    for q in (1e2, 1e6, 1e10):
        K, P = kf.continuous_gain(space, period, q)
        Q = np.zeros((7, 7))
        Q[-1, -1] = q
        R = space.output_variances[0] * period
        size = np.sqrt(np.diag(P))
        residual = A @ P + P @ A.T + Q - np.outer(P @ C[0], P @ C[0]) / R
        scale = np.abs(A @ P).max(axis=1).max() / (size.max() * size)
        assert np.abs(residual / np.outer(size, size)).max() < 1e-6 * np.abs(scale).max()
        np.testing.assert_allclose(K[:, 0], P @ C[0] / R, rtol=1e-12)
        assert np.linalg.eigvals(A - K @ C).real.max() < 0.0


def test_continuous_filter_tends_to_the_discrete_one() -> None:
    """With 10 us the gains of both differ little; (3.9) and the discrete recursion share nothing else."""
    space = space_of("DriveCurrentClosed-v0")
    period = 1e-5
    outputs, inputs = 100.0 * space.output_variances, 100.0 * space.input_variances
    space = replace(space, output_variances=outputs, input_variances=inputs)
    rng = np.random.default_rng(0)
    u = rng.standard_normal((4000, 1)).cumsum(axis=0) * 0.01
    y = np.column_stack((1e-5 * rng.standard_normal(4000).cumsum(), 1e-8 * rng.standard_normal(4000).cumsum()))
    continuous = kf.run_constant_filter(kf.continuous_filter(space, period, 1e4), np.zeros(3), u, y)
    discrete = kf.run_constant_filter(kf.steady_filter(kf.observer(space, period, 1e4, 1.0, True)), np.zeros(3), u, y)
    force = discrete[:, kf.FORCE]
    np.testing.assert_allclose(continuous[:, kf.FORCE], force, rtol=0, atol=0.01 * np.abs(force).max())
    np.testing.assert_allclose(continuous[-1, kf.FORCE_VARIANCE], discrete[-1, kf.FORCE_VARIANCE], rtol=0.01)


# ---- the estimator ----


@pytest.fixture(scope="module")
def drive() -> tuple[Context, Record]:
    scenario = load_scenario("DriveCurrentClosed-v0")
    return scenario.context(), scenario.record(0)


def equal_bits(a: Estimate, b: Estimate) -> None:
    for name in ("disturbance_N", "disturbance_variance_N2", "output", "output_variance"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@pytest.mark.parametrize("form", FORMS)
def test_streaming_gives_the_bits_of_fit(drive: tuple[Context, Record], form: Any) -> None:
    context, record = drive
    whole = Kalman(form=form).fit(context, record)
    estimator = Kalman(form=form)
    estimator.start(context)
    for sample in samples(context.regression(record)):
        estimator.update(sample)
    equal_bits(estimator.estimate(), whole)


@pytest.mark.parametrize("form", FORMS)
def test_a_row_depends_on_the_past_only(drive: tuple[Context, Record], form: Any) -> None:
    context, record = drive
    whole, part = (Kalman(form=form).fit(context, piece) for piece in (record, record.slice(0, 901)))
    assert whole.disturbance_N is not None
    assert part.disturbance_N is not None
    np.testing.assert_array_equal(part.disturbance_N, whole.disturbance_N[:900])


@dataclass(frozen=True, kw_only=True)
class Rescaled:
    """A plant whose outputs are read in other units."""

    plant: Any
    factor: float

    def state_space(self, sampling_time_s: float) -> StateSpace:
        space: StateSpace = self.plant.state_space(sampling_time_s)
        return replace(
            space, C=self.factor * space.C, output_variances=self.factor**2 * space.output_variances
        )  # fmt: skip

    def linear_model(self, name: str) -> "Rescaled":
        return self

    def regression(self, record: Record) -> Any:
        regression = self.plant.linear_model("state_space").regression(record)
        return replace(regression, readings=self.factor * regression.readings)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("factor", [1e-9, 1e6])
def test_units_do_not_matter(form: Any, factor: float) -> None:
    """Nothing absolute is added to a covariance: readings in Gm or um give the same force."""
    scenario = load_scenario("SpindleMilling-v0")
    context, record = scenario.context(), scenario.record(0)
    other = replace(context, plant=Rescaled(plant=context.plant, factor=factor))  # type: ignore[arg-type]
    first, second = (Kalman(form=form).fit(case, record).disturbance_N for case in (context, other))
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(second, first, rtol=0, atol=1e-6 * np.abs(first).max())


def test_claimed_variances_are_those_of_the_errors() -> None:
    """Records drawn from the model itself: the squared error over its variance has mean 1."""
    scenario = load_scenario("DriveCurrentOpen-v0")
    context = scenario.context()
    q, n, period = 1e4, 4000, 1e-3
    model = kf.observer(space_of("DriveCurrentOpen-v0"), period, q, 100.0, True)
    space = space_of("DriveCurrentOpen-v0")
    clean = kf.observer(replace(space, input_variances=np.zeros(1)), period, q, 100.0, True)
    rng = np.random.default_rng(5)
    root = np.linalg.cholesky(clean.Q + 1e-12 * np.diag(np.diag(clean.Q)))
    ratios, predicted = [], []
    for _ in range(12):
        x, states = np.zeros(3), np.empty((n, 3))
        current = 0.05 * np.sin(np.arange(n) * 0.01)
        for k in range(n):
            states[k] = x
            x = model.A @ x + model.B[:, 0] * current[k] + root @ rng.standard_normal(3)
        noise = rng.standard_normal((n, 3)) * np.sqrt([*space.output_variances, 0.01**2])
        record = Record(
            {
                "time_s": np.asarray(period * np.arange(n), dtype=np.float64),
                "velocity_m_per_s": states[:, 1] + noise[:, 0],
                "motor_position_m": states[:, 0] + noise[:, 1],
                "motor_current_A": current + noise[:, 2],
            }
        )
        claim = Kalman(q_N2_per_s=q).fit(context, record)
        assert claim.disturbance_N is not None
        assert claim.disturbance_variance_N2 is not None
        assert claim.output is not None
        assert claim.output_variance is not None
        ratios.append(np.mean((claim.disturbance_N - states[1:, 2])[200:] ** 2 / claim.disturbance_variance_N2[200:]))
        reading = record["velocity_m_per_s"][1:]
        predicted.append(np.mean((claim.output - reading)[200:] ** 2 / claim.output_variance[200:]))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.06)
    assert np.mean(predicted) == pytest.approx(1.0, abs=0.02)


def test_force_without_process_noise_stays_where_it_is(drive: tuple[Context, Record]) -> None:
    """SA6, and that a first guess is kept: with a prior the force is averaged over the whole record."""
    context, record = drive
    steady = Kalman(q_N2_per_s=0.0, form="steady").fit(context, record).disturbance_N
    assert steady is not None
    np.testing.assert_array_equal(steady, 0.0)
    fixed = Kalman(q_N2_per_s=0.0, initial_force_N=0.0).fit(context, record).disturbance_N
    assert fixed is not None
    np.testing.assert_array_equal(fixed, 0.0)
    averaged = Kalman(q_N2_per_s=0.0, initial_force_N=100.0).fit(context, record).disturbance_N
    assert averaged is not None
    assert 1.0 < averaged[-1] < 99.0


def with_friction(scenario: Scenario, force_N: float) -> Scenario:
    friction = effects.get("coulomb_friction").typical(coulomb_force_N=force_N, transition_velocity_m_per_s=1e-5)
    plant: Any = scenario.plant
    return replace(scenario, plant=replace(plant, effects=(friction,)))


def test_friction_biases_the_force() -> None:
    """A drive that slides backwards under 100 N is held by 20 N of friction, which no one told the filter."""
    scenario = with_friction(load_scenario("DriveCurrentOpen-v0"), 20.0)
    force = Kalman(q_N2_per_s=1e4, form="steady").fit(scenario.context(), scenario.record(0)).disturbance_N
    assert force is not None
    assert force[1000:].mean() == pytest.approx(80.0, abs=0.5)


def test_closed_and_open_loop_give_the_same_force() -> None:
    """SA5: what is known of the current cancels."""
    forces = []
    for name in ("DriveCurrentClosed-v0", "DriveCurrentOpen-v0"):
        scenario = load_scenario(name)
        force = Kalman().fit(scenario.context(), scenario.record(7)).disturbance_N
        assert force is not None
        forces.append(force)
    np.testing.assert_allclose(forces[0], forces[1], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"q_N2_per_s": -1.0}, "q_N2_per_s = -1.0 must be at least 0"),
        ({"q_N2_per_s": float("nan")}, "q_N2_per_s"),
        ({"initial_force_N": float("inf")}, "initial_force_N"),
        ({"form": "stedy"}, "unknown choice 'stedy'. Did you mean steady"),
        ({"force_noise": "vanloan"}, "Did you mean van_loan"),
    ],
)
def test_bad_arguments_are_refused(arguments: Mapping[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=f"kalman: .*{message}"):
        Kalman(**arguments)


def test_other_plants_and_rows_without_readings_are_refused(drive: tuple[Context, Record]) -> None:
    context, _ = drive
    shaker = load_scenario("ServoStaircase-v0").context()
    assert Kalman().skip(context) is None
    assert Kalman().skip(shaker) == "the scenario's model is neither one in state space nor one of a drive's motion"
    with pytest.raises(SpecError, match="neither one in state space"):
        Kalman().start(shaker)
    estimator = Kalman()
    with pytest.raises(PluginError, match="start"):
        estimator.estimate()
    estimator.start(context)
    with pytest.raises(SpecError, match=r"3 readings a row are expected, .* found 0"):
        estimator.update(Sample(0.0, np.empty(0), 0.0, 1.0))
    force = estimator.estimate().disturbance_N
    assert force is not None
    assert force.shape == (0,)


# ---- the network ----


@pytest.fixture(scope="module")
def nodes() -> tuple[Context, Context, Record]:
    full, line = (load_scenario(f"SensorNetwork{kind}-v0") for kind in ("", "Line"))
    return full.context(), line.context(), full.record(0).slice(0, 3000)


def net_of(context: Context, q: float = 1e5) -> Network:
    assert isinstance(context.plant, NetworkPlant)
    return network(context.plant, context.sampling_time_s, q, 100.0)


def claim(estimator: FusionFilter, context: Context, record: Record) -> FloatArray:
    force = estimator.fit(context, record).disturbance_N
    assert force is not None
    return force


def test_central_filter_is_the_kalman_filter(nodes: tuple[Context, Context, Record]) -> None:
    context, line, record = nodes
    alone = Kalman(q_N2_per_s=1e5).fit(context, record)
    central = KalmanCentral().fit(context, record)
    assert alone.disturbance_N is not None
    assert central.disturbance_N is not None
    assert alone.disturbance_variance_N2 is not None
    assert central.disturbance_variance_N2 is not None
    np.testing.assert_allclose(central.disturbance_N, alone.disturbance_N, rtol=0, atol=1e-6)
    np.testing.assert_allclose(central.disturbance_variance_N2, alone.disturbance_variance_N2, rtol=1e-7)
    np.testing.assert_array_equal(KalmanCentral().fit(line, record).disturbance_N, central.disturbance_N)


@pytest.mark.parametrize(
    "estimator",
    [
        KalmanDistributed(),
        KalmanDistributed(form="information"),
        KalmanConsensus(),
        KalmanParallel(),
        *(kind(node=node) for kind in NODE_FILTERS for node in (1, 3)),
    ],
    ids=lambda estimator: f"{type(estimator).__name__}-{estimator.node}-{getattr(estimator, 'form', '')}",
)
def test_all_nodes_linked_is_the_central_filter(
    nodes: tuple[Context, Context, Record], estimator: FusionFilter
) -> None:
    """SA7; the gains of the weighted filter are steady, so that it needs some time."""
    context, _, record = nodes
    difference = claim(estimator, context, record) - claim(KalmanCentral(), context, record)
    settled = slice(2000 if isinstance(estimator, KalmanWeighted) else 0, None)
    assert np.abs(difference[settled]).max() < 1e-3


def test_nodes_alone_filter_their_own_reading(nodes: tuple[Context, Context, Record]) -> None:
    context, _, record = nodes
    plant: Any = context.plant
    alone = replace(context, plant=replace(plant, links=()))
    space = plant.state_space(1e-4)
    model = kf.observer(space, 1e-4, 1e5, 100.0, True)
    readings = context.regression(record).readings
    assert readings is not None
    for node in range(3):
        one = model._replace(C=model.C[[node]], R=model.R[[node]])
        out, _ = kf.filter_readings(one, np.zeros(9), model.P.copy(), np.empty((2999, 0)), readings[:, [node]].copy())
        estimate = KalmanDistributed(node=node + 1).fit(alone, record)
        assert estimate.disturbance_N is not None
        assert estimate.disturbance_variance_N2 is not None
        np.testing.assert_allclose(estimate.disturbance_N, out[:, kf.FORCE], rtol=0, atol=1e-5)
        np.testing.assert_allclose(estimate.disturbance_variance_N2, out[:, kf.FORCE_VARIANCE], rtol=1e-6)
    average = np.mean([claim(KalmanDistributed(node=node), alone, record) for node in (1, 2, 3)], axis=0)
    np.testing.assert_allclose(claim(KalmanDistributed(), alone, record), average, rtol=0, atol=1e-9)


def naive_nodes(net: Network, gamma: float, exchanges: int, y: FloatArray) -> FloatArray:
    """Return the nodes' last states by the published equations, in information form."""
    states = [np.zeros(len(net.A)) for _ in net.C]
    covariances = [net.P for _ in net.C]
    rows = []
    for readings in y:
        for i in range(len(net.C)):
            x, P = net.A @ states[i], net.A @ covariances[i] @ net.A.T + net.Q
            hears = np.flatnonzero(net.heard[i])
            information = np.linalg.inv(P) + sum(np.outer(net.C[j], net.C[j]) / net.R[j] for j in hears)
            vector = np.linalg.solve(P, x) + sum(net.C[j] * readings[j] / net.R[j] for j in hears)
            covariances[i] = np.linalg.inv(information)
            states[i] = covariances[i] @ vector
        for _ in range(exchanges):
            states = [
                x + gamma * sum((states[j] - x for j in np.flatnonzero(net.heard[i])), np.zeros(len(x)))
                for i, x in enumerate(states)
            ]
        rows.append([x[-1] for x in states])
    return np.array(rows)


@pytest.mark.parametrize("information", [None, True])
def test_nodes_of_a_line_equal_a_naive_twin(
    nodes: tuple[Context, Context, Record], information: Literal[True] | None
) -> None:
    _, context, record = nodes
    net, readings = net_of(context), context.regression(record).readings
    assert readings is not None
    y = np.ascontiguousarray(readings[:200])
    expected = naive_nodes(net, 0.3, 2, y)
    found, _ = run_nodes(net.size, *net[:6], information, 0.3, 2, y)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_combined_estimates_equal_a_naive_twin(nodes: tuple[Context, Context, Record]) -> None:
    context, _, record = nodes
    net, readings = net_of(context), context.regression(record).readings
    assert readings is not None
    y = np.ascontiguousarray(readings[:100])
    states, covariances = [np.zeros(9)] * 3, [net.P] * 3
    expected = []
    for row in y:
        information, vector = np.zeros((9, 9)), np.zeros(9)
        for i, c in enumerate(net.C):
            x, P = net.A @ states[i], net.A @ covariances[i] @ net.A.T + net.Q
            covariances[i] = np.linalg.inv(np.linalg.inv(P) + np.outer(c, c) / net.R[i])
            states[i] = x + covariances[i] @ c / net.R[i] * (row[i] - c @ x)
            weight = 1.0 / np.trace(covariances[i])
            information = information + weight * np.linalg.inv(covariances[i])
            vector = vector + weight * np.linalg.solve(covariances[i], states[i])
        expected.append(np.linalg.solve(information, vector)[-1])
    found, _ = run_parallel(net.size, *net[:5], np.ones(9), False, True, y)
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_exchanges_keep_the_mean_and_shrink_the_spread(nodes: tuple[Context, Context, Record]) -> None:
    _, context, record = nodes
    distributed = KalmanConsensus(exchanges=0)
    np.testing.assert_array_equal(claim(distributed, context, record), claim(KalmanDistributed(), context, record))
    spreads = []
    for exchanges in (0, 1, 5, 20):
        forces = [claim(KalmanConsensus(exchanges=exchanges, node=node), context, record) for node in (1, 2, 3)]
        spreads.append(float(np.ptp(forces, axis=0)[1000:].mean()))
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[3] < 0.02 * spreads[0]


def test_weighted_averaging_is_a_steady_joint_filter(nodes: tuple[Context, Context, Record]) -> None:
    """The covariance repeats itself, weights add up to I, no node hears a stranger, and the filter is stable."""
    _, context, _ = nodes
    net = net_of(context)
    design = alternate(net, 600, 1e-7)
    n = len(net.A)
    radius = float(np.abs(np.linalg.eigvals(design.F)).max())
    assert radius == pytest.approx(0.9937, abs=5e-5)
    # If all nodes are right about x, all of them still are after a sample without noise: F 1 x = 1 A x - L H A x.
    H = np.zeros((3, 3 * n))
    for i in range(3):
        H[i, i * n : (i + 1) * n] = net.C[i]
    ones, A = np.tile(np.eye(n), (3, 1)), np.kron(np.eye(3), net.A)
    np.testing.assert_allclose(design.F @ ones + design.L @ H @ A @ ones, A @ ones, rtol=0, atol=1e-8)
    assert np.abs(design.F[:n, 2 * n :]).max() == 0.0
    assert np.abs(design.L[2 * n :, 0]).max() == 0.0
    # The errors e of the next sample: F e + (process noise that L does not see) + L (noise of the readings).
    process = ones - design.L @ H @ ones
    rest = design.F @ design.P @ design.F.T + process @ net.Q @ process.T + (design.L * net.R) @ design.L.T
    forces = np.diag(rest)[n - 1 :: n] / np.diag(design.P)[n - 1 :: n]
    np.testing.assert_allclose(forces, 1.0, rtol=1e-5)
    deviations = net.scale[-1] * np.sqrt(np.diag(design.P)[n - 1 :: n])
    np.testing.assert_allclose(deviations, [3.47, 3.47, 4.70], atol=5e-3)


@pytest.mark.parametrize("linked", ["every node", "a line"])
def test_weighted_averaging_forgets_where_it_started(
    nodes: tuple[Context, Context, Record], linked: Literal["every node", "a line"]
) -> None:
    """Nodes that know the same at first differ by few readings; the ridge must not drown in what nobody knows yet."""
    net = net_of(nodes[0 if linked == "every node" else 1])
    design, vague = (alternate(net._replace(P=factor * net.P), 600, 1e-7) for factor in (1.0, 1e4))
    deviations, expected = (np.sqrt(np.diag(item.P)[len(net.A) - 1 :: len(net.A)]) for item in (vague, design))
    np.testing.assert_allclose(deviations, expected, rtol=1e-6)


def test_weighted_averaging_helps_the_blind_node(nodes: tuple[Context, Context, Record]) -> None:
    """SA8."""
    full, line, record = nodes
    errors = {}
    truth = load_scenario("SensorNetwork-v0").observe(0)[1].disturbance_N
    assert truth is not None
    for name, estimator, context in (
        ("central", KalmanCentral(), full),
        ("distributed", KalmanDistributed(node=3), line),
        ("weighted", KalmanWeighted(node=3), line),
    ):
        errors[name] = np.std(claim(estimator, context, record)[1000:] - truth[1000:2999])
    assert errors["central"] < errors["weighted"] < 0.5 * errors["distributed"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: KalmanCentral(q_N2_per_s=0.0), "q_N2_per_s = 0.0 must be above 0"),
        (lambda: KalmanCentral(initial_force_N=-1.0), "initial_force_N"),
        (lambda: KalmanDistributed(node=0), "node = 0 must be 1 or more"),
        (lambda: KalmanDistributed(form="gains"), "form = 'gains' must be gain or information"),  # type: ignore[arg-type]
        (lambda: KalmanParallel(form="weighted"), "exact, printed or sum"),  # type: ignore[arg-type]
        (lambda: KalmanConsensus(gamma=0.0), "gamma = 0.0 must be above 0"),
        (lambda: KalmanConsensus(exchanges=-1), "exchanges"),
        (lambda: KalmanWeighted(sweeps=0), "sweeps"),
        (lambda: KalmanWeighted(ridge=0.0), "ridge"),
    ],
)
def test_bad_arguments_of_fusion_are_refused(make: Any, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        make()


def test_what_a_network_cannot_do_is_refused(nodes: tuple[Context, Context, Record]) -> None:
    context, _, record = nodes
    drive = load_scenario("DriveCurrentClosed-v0")
    assert KalmanCentral().skip(drive.context()) == "the plant is no network of sensors"
    with pytest.raises(SpecError, match="no network of sensors"):
        KalmanCentral().fit(drive.context(), drive.record(0))
    with pytest.raises(SpecError, match=r"node = 4 is too large; the filter has 3"):
        KalmanDistributed(node=4).fit(context, record)
    with pytest.raises(SpecError, match=r"gamma = 0.6 must be below 1/2"):
        KalmanConsensus(gamma=0.6).fit(context, record)
