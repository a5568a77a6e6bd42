"""KRLS-T against independent implementations, a batch Gaussian process, a naive twin, and its own stream."""

import tracemalloc
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, Literal, cast

import numpy as np
import pytest
from conftest import shared_file
from fdbench_baselines._krls_t_recursion import (
    FEWEST,
    FloatArray,
    empty_tracker,
    locally_periodic_inputs,
    track,
    track_beside,
)
from fdbench_baselines.krls_t import KRLST
from fdbench_baselines.pl_lssvm import PLLSSVM

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, Regression, samples
from fdbench.plants._plant import Plant
from fdbench.record import Record
from fdbench.scenario import load_scenario

pytestmark = pytest.mark.linear_algebra

TS = 1.0 / 333.0
PSI = 1.0 / 55.0


def times_s(n: int) -> FloatArray:
    return np.asarray(TS * np.arange(n), dtype=np.float64)


def gaussian(x: FloatArray, z: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * ((x[:, None] - z[None]) ** 2).sum(axis=2)))


def naive(
    x: FloatArray, y: FloatArray, s2: float, lam: float, jitter: float, budget: int, mode: str
) -> tuple[FloatArray, FloatArray]:
    """Return mean, variance / s0^2 and s0^2, and who left, by the published recursion in mu, Sigma and Q."""
    predictions, removed = np.empty((len(y), 3)), np.full(len(y), -1)
    members: list[int] = []
    mu, sigma, q_matrix = np.empty(0), np.empty((0, 0)), np.empty((0, 0))
    numerator = denominator = 0.0
    for n in range(len(y)):
        k = gaussian(x[members], x[n : n + 1])[:, 0]
        q = q_matrix @ k
        g2 = 1.0 + jitter - k @ q
        predictions[n, :2] = q @ mu, g2 + q @ sigma @ q
        if mode == "B2P":
            mu = np.sqrt(lam) * mu
            sigma = lam * sigma + (1.0 - lam) * (gaussian(x[members], x[members]) + jitter * np.eye(len(members)))
        else:
            sigma = sigma / lam
        h = np.append(sigma @ q, g2 + q @ sigma @ q)
        error, sv2 = y[n] - q @ mu, s2 + h[-1]
        weight = lam if n > 0 else 1.0
        numerator, denominator = numerator + weight * error**2 / sv2, denominator + weight
        predictions[n, 2] = numerator / denominator

        old = q_matrix
        direction = np.append(q, -1.0)
        q_matrix = np.pad(q_matrix, (0, 1)) + np.outer(direction, direction) / g2
        sigma = np.block([[sigma, h[:-1, None]], [h]]) - np.outer(h, h) / sv2
        mu = np.append(mu, q @ mu) + error / sv2 * h
        members.append(n)
        if g2 < jitter or len(members) > budget:
            size = len(members)
            i = size - 1 if g2 < jitter else int(np.argmin(np.abs(q_matrix @ mu / np.diag(q_matrix))))
            removed[n] = members.pop(i)
            rest = np.delete(np.arange(size), i)
            column = q_matrix[rest, i]
            q_matrix = q_matrix[np.ix_(rest, rest)] - np.outer(column, column) / q_matrix[i, i]
            if i == size - 1:
                q_matrix = old
            mu, sigma = mu[rest], sigma[np.ix_(rest, rest)]
    return predictions, removed


SETS = {"iid": ("kafB2P", "kmB2P", "kmUI", "mpB2P", "mpUI"), "drive": ("kafB2P", "mpB2P", "mpUI")}
RUNS = [
    (data, kind, budget, lam)
    for data, kinds in SETS.items()
    for kind in kinds
    for budget, lam in ((30, "0.995"), (30, "1"), (50, "0.999"), (50, "1"))
]


@pytest.mark.parametrize(("data", "kind", "budget", "lam"), RUNS)
def test_recursion_equals_oracle(data: str, kind: str, budget: int, lam: str) -> None:
    def table(name: str) -> FloatArray:
        return np.loadtxt(shared_file("oracles", "krlst", f"{name}.csv"), delimiter=",", skiprows=1)

    run = f"{data}_{kind}_M{budget}_lam{lam}"
    inputs, steps, final = table(f"{data}_input"), table(f"{run}_steps"), table(f"{run}_final")
    mean_tolerance, variance_tolerance = (1e-9, 1e-9) if data == "iid" else (1e-6, 5e-6)
    jitter = 1e-10 if kind.startswith("km") else 1e-6
    x, y = inputs[:, :-1].copy(), inputs[:, -1].copy()

    tracker = empty_tracker(x.shape[1], budget)
    predictions, removed = track(tracker, x, y, 0.01, float(lam), jitter, kind.endswith("UI"))
    mean, variance, power = predictions.T
    np.testing.assert_array_equal(removed, steps[:, 3])
    np.testing.assert_allclose(mean, steps[:, 0], rtol=0, atol=mean_tolerance * y.std())
    np.testing.assert_allclose(power[:-1] * (0.01 + variance[1:]), steps[1:, 1], rtol=variance_tolerance)
    np.testing.assert_allclose(power, steps[:, 2], rtol=variance_tolerance)

    order = np.argsort(tracker.members)
    members, alpha = tracker.members[order], tracker.alpha[order]
    q, r = (matrix[np.ix_(order, order)] for matrix in np.hsplit(tracker.QR, 2))
    kernel = gaussian(x[members], x[members]) + jitter * np.eye(budget)
    np.testing.assert_array_equal(members, final[:, 0])
    np.testing.assert_allclose(kernel @ alpha, final[:, 1], rtol=0, atol=mean_tolerance * y.std())
    np.testing.assert_allclose(np.diag(kernel - kernel @ r @ kernel), final[:, 2], rtol=variance_tolerance)
    np.testing.assert_allclose(np.diag(q), final[:, 3], rtol=variance_tolerance)


def test_every_oracle_is_used() -> None:
    files = shared_file("oracles", "krlst").glob("*_steps.csv")
    assert {path.name for path in files} == {f"{d}_{k}_M{budget}_lam{lam}_steps.csv" for d, k, budget, lam in RUNS}


@pytest.mark.parametrize("mode", ["B2P", "UI"])
@pytest.mark.parametrize(("dimension", "budget"), [(1, 3), (2, 17), (4, 40)])
def test_recursion_equals_naive_twin(mode: str, dimension: int, budget: int) -> None:
    rng = np.random.default_rng(dimension)
    x = 2.0 * rng.standard_normal((150, dimension))
    y = np.sin(x).sum(axis=1) + 0.1 * rng.standard_normal(150)
    expected, left = naive(x, y, 0.05, 0.98, 1e-6, budget, mode)
    predictions, removed = track(empty_tracker(dimension, budget), x, y, 0.05, 0.98, 1e-6, mode == "UI")
    np.testing.assert_array_equal(removed, left)
    np.testing.assert_allclose(predictions, expected, rtol=1e-9, atol=1e-9)


def test_repeated_input_does_not_become_a_member() -> None:
    x, y = np.zeros((3, 1)), np.array([1.0, 2.0, 6.0])
    predictions, removed = track(empty_tracker(1, 5), x, y, 1.0, 1.0, 0.0, False)
    np.testing.assert_array_equal(removed, [-1, 1, 2])
    np.testing.assert_allclose(predictions[:, :2], [[0.0, 1.0], [0.5, 0.5], [1.0, 1.0 / 3.0]], rtol=1e-15)


def test_free_slots_stay_free_under_uncertainty_injection() -> None:
    tracker = empty_tracker(1, 3)
    predictions, _ = track(tracker, np.zeros((8000, 1)), np.ones(8000), 1.0, 0.9, 0.0, True)
    np.testing.assert_array_equal(tracker.members, [0, -1, -1])
    np.testing.assert_array_equal(tracker.QR[1:, 1:3], np.eye(2))
    np.testing.assert_array_equal(tracker.QR[1:, 3:], 0.0)
    # The variance S of one input settles where S / lam, less its square over (S / lam + s2), is S again: 1 - lam.
    np.testing.assert_allclose(predictions[-1, :2], [1.0, 0.1], rtol=1e-9)


def test_inputs_have_the_locally_periodic_kernel() -> None:
    t = times_s(400)
    tau = t[:, None] - t
    expected = np.exp(-(tau**2) / (2 * 1.2**2)) * np.exp(-(np.sin(np.pi * tau / PSI) ** 2) / (2 * 0.99**2))
    x = locally_periodic_inputs(t, 1.2, 0.99, PSI)
    np.testing.assert_allclose(gaussian(x, x), expected, rtol=0, atol=1e-13)


def test_without_pruning_forgetting_and_jitter_it_is_a_batch_gaussian_process() -> None:
    n, s2 = 120, 1.0 / 5.85
    x = locally_periodic_inputs(times_s(n), 0.02, 0.99, PSI)
    v = np.random.default_rng(7).standard_normal(n)
    predictions, _ = track(empty_tracker(3, n), x, v, s2, 1.0, 0.0, False)
    kernel = gaussian(x, x)
    for i in range(n):
        weights = np.linalg.solve(kernel[:i, :i] + s2 * np.eye(i), np.column_stack((v[:i], kernel[:i, i])))
        mean, explained = kernel[i, :i] @ weights
        assert predictions[i, 0] == pytest.approx(mean, rel=0, abs=1e-12)
        assert predictions[i, 1] == pytest.approx(1.0 - explained, rel=0, abs=1e-12)


def test_state_keeps_its_size_and_its_accuracy() -> None:
    rng = np.random.default_rng(3)
    tracker = empty_tracker(3, 50)
    arrays = [id(array) for array in tracker]
    t = times_s(60_000)
    x = locally_periodic_inputs(t, 1.2, 0.99, PSI)
    v = np.sin(2 * np.pi * t / PSI) + 0.1 * rng.standard_normal(len(t))
    track(tracker, x, v, 1.0 / 5.85, 0.996, 1e-6, False)
    assert [id(array) for array in tracker] == arrays
    kernel = gaussian(x[tracker.members], x[tracker.members]) + 1e-6 * np.eye(50)
    np.testing.assert_allclose(tracker.QR[:, :50] @ kernel, np.eye(50), rtol=0, atol=1e-4)


class Toy:
    """What a context asks of a plant: v(k+1) = a v(k) + b u(k) + gain d(k)."""

    truth: ClassVar[Mapping[str, float]] = {"a": 0.2, "b": 0.7}
    gain = 3e-3

    def linear_model(self, name: str) -> "Toy":
        return self

    def regression(self, record: Record) -> Regression:
        v, u = record["velocity_m_per_s"], record["command_m_per_s"]
        return Regression(
            regressors=np.column_stack((v[:-1], u[:-1])),
            target=v[1:],
            names=("a", "b"),
            target_name="velocity_m_per_s",
            time_s=record["time_s"][:-1],
            rows=np.arange(len(v) - 1),
            disturbance_gain=self.gain,
        )

    def nominal_parameters(self, sampling_time_s: float) -> Mapping[str, float]:
        return self.truth


def context(period_s: float | None = PSI) -> Context:
    plant = cast(Plant, Toy())
    return Context(sampling_time_s=TS, plant=plant, model="toy", disturbance_period_s=period_s)


class Paper(Toy):
    """The toy as its data sheet has it."""

    truth: ClassVar[Mapping[str, float]] = {"a": 0.3, "b": 0.5}


def toy_record(n: int = 400) -> Record:
    rng = np.random.default_rng(5)
    t = times_s(n)
    u, d = rng.standard_normal(n), 20.0 * np.cos(2 * np.pi * t / PSI)
    v = np.zeros(n)
    for k in range(n - 1):
        v[k + 1] = 0.2 * v[k] + 0.7 * u[k] + Toy.gain * d[k] + 1e-3 * rng.standard_normal()
    return Record({"time_s": t, "velocity_m_per_s": v, "command_m_per_s": u})


def stream(estimator: KRLST, record: Record) -> Estimate:
    estimator.start(context())
    for sample in samples(context().regression(record)):
        estimator.update(sample)
    return estimator.estimate()


def assert_same(left: Estimate, right: Estimate) -> None:
    assert left.parameters == right.parameters
    for name in ("output", "output_variance", "disturbance_N", "disturbance_variance_N2"):
        np.testing.assert_array_equal(getattr(left, name), getattr(right, name))


@pytest.mark.parametrize("mode", ["B2P", "UI"])
def test_estimate_is_the_recursion_on_the_residual(mode: Literal["B2P", "UI"]) -> None:
    linear = {"b": 0.69, "a": 0.21}
    record = toy_record(200)
    estimator = KRLST(linear_parameters=linear, mode=mode, budget=20, gamma=4.0)
    estimate = estimator.fit(context(), record)
    regression = context().regression(record)
    modelled = regression.regressors @ [0.21, 0.69]
    x = locally_periodic_inputs(regression.time_s, 1.2, 0.99, PSI)
    mean, variance, power = naive(x, regression.target - modelled, 0.25, 0.996, 1e-6, 20, mode)[0].T
    before = np.concatenate((power[:1], power[:-1]))
    expected = {
        "output": modelled + mean,
        "output_variance": before * (0.25 + variance),
        "disturbance_N": mean / Toy.gain,
        "disturbance_variance_N2": before * variance / Toy.gain**2,
    }
    assert estimate.parameters == linear
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(estimate, name), values, rtol=1e-6, atol=1e-6 * np.abs(values).max())


@pytest.mark.parametrize("mode", ["B2P", "UI"])
def test_stream_equals_whole_record_bit_for_bit(mode: Literal["B2P", "UI"]) -> None:
    record = toy_record()
    whole = KRLST(linear_parameters=Toy.truth, mode=mode).fit(context(), record)
    estimator = KRLST(linear_parameters=Toy.truth, mode=mode)
    assert_same(stream(estimator, record), whole)
    assert_same(stream(estimator, record), whole)  # start has forgotten everything


def test_without_given_parameters_stream_and_record_agree_too() -> None:
    record = toy_record()
    assert_same(stream(KRLST(), record), KRLST().fit(context(), record))
    assert_same(KRLST(period_s=PSI).fit(context(period_s=None), record), KRLST().fit(context(), record))


def test_parameters_are_found_on_the_way_and_are_no_batch_solution() -> None:
    record = toy_record(2000)
    wrong = replace(context(), plant=cast(Plant, Paper()))
    found = KRLST().fit(wrong, record).parameters
    batch = PLLSSVM().fit(wrong, record).parameters
    for name, truth in Toy.truth.items():
        assert abs(found[name] - truth) < 0.02 * abs(Paper.truth[name] - truth)
        assert found[name] != pytest.approx(batch[name], rel=1e-9)


def test_one_sample_by_hand() -> None:
    """The first sample: s0^2 = (1 - 0.5)^2 / (s2 + 1), S = 0.25 + s0^2 (s2 + 1) = 0.5, beta = 0.5 + 0.25 / S * 0.5."""
    tracker, beta, P = empty_tracker(1, 5, 1), np.array([0.5]), np.array([[0.25]])
    one = np.ones((1, 1))
    out = track_beside(tracker, one, one, np.ones(1), np.ones(1, np.bool_), beta, P, 1.0, 1.0, 0.0, False)
    np.testing.assert_allclose(out, [[0.5, 0.0, 1.0, 0.125]])
    np.testing.assert_allclose(beta, 0.75)
    np.testing.assert_allclose(P, 0.125)


def test_held_parameters_make_it_the_tracker() -> None:
    random = np.random.default_rng(0)
    x, Z, y = random.standard_normal((60, 2)), random.standard_normal((60, 2)), random.standard_normal(60)
    beta = np.array([0.3, -2.0])
    expected, _ = track(empty_tracker(2, 20), x, y - Z @ beta, 0.1, 0.99, 1e-6, False)
    held, P = beta.copy(), np.zeros((2, 2))
    out = track_beside(empty_tracker(2, 20, 2), x, Z, y, np.ones(60, np.bool_), held, P, 0.1, 0.99, 1e-6, False)
    np.testing.assert_allclose(out[:, 1:3], expected[:, :2], rtol=1e-9)
    np.testing.assert_allclose(out[1:, 3], expected[:-1, 2], rtol=1e-9)
    np.testing.assert_array_equal(held, beta)


def test_a_first_error_of_nearly_nothing_makes_nothing_sure() -> None:
    random = np.random.default_rng(4)
    x, Z, noise = random.standard_normal((40, 1)), random.standard_normal((40, 2)), random.standard_normal(40)
    noise[0] = 1e-9
    beta, P = np.zeros(2), np.eye(2)
    tracker, learnt = empty_tracker(1, 20, 2), np.ones(40, np.bool_)
    track_beside(tracker, x, Z, Z @ [0.5, -0.5] + 3.0 * noise, learnt, beta, P, 100.0, 1.0, 0.0, False)
    deviations = np.sqrt(np.diag(P))
    assert np.all(deviations > 0.2)
    assert np.all(np.abs(beta - [0.5, -0.5]) < 3.0 * deviations)


def test_linear_part_is_that_of_whitened_rows() -> None:
    """Innovations by Cholesky's factor of the whole kernel matrix, beta by recursion on them."""
    n, s2 = 80, 0.05
    random = np.random.default_rng(2)
    x, Z = 0.7 * np.arange(n)[:, None], random.standard_normal((n, 2))
    K = np.exp(-0.5 * (x - x.T) ** 2) + s2 * np.eye(n)
    L = np.linalg.cholesky(K)
    y = Z @ [0.3, -2.0] + L @ random.standard_normal(n)
    innovations = np.linalg.solve(L, np.column_stack((y, Z))) * np.diag(L)[:, None]
    beta, P, numerator, scale = np.zeros(2), 100.0 * np.eye(2), 0.0, 0.0
    for seen, (row, variance) in enumerate(zip(innovations, np.diag(L) ** 2, strict=True), 1):
        z, error = row[1:], row[0] - row[1:] @ beta
        doubt = z @ P @ z
        numerator += error**2 / (variance + (doubt / scale if seen > 1 else 0.0))
        noise = variance * (scale if seen > 1 else numerator)
        S = doubt + max(noise, error**2 if seen <= FEWEST else 0.0)
        beta = beta + P @ z * error / S
        P = P - np.outer(P @ z, z @ P) / S
        scale = numerator / seen
    found, covariance = np.zeros(2), 100.0 * np.eye(2)
    track_beside(empty_tracker(1, n, 2), x, Z, y, np.ones(n, np.bool_), found, covariance, s2, 1.0, 0.0, False)
    np.testing.assert_allclose(found, beta, rtol=1e-8)
    np.testing.assert_allclose(covariance, P, rtol=1e-8)


@pytest.mark.parametrize("injection", [False, True])
def test_samples_that_are_not_learnt_from_leave_no_trace(injection: bool) -> None:
    random = np.random.default_rng(4)
    x, Z, y = random.standard_normal((60, 1)), random.standard_normal((60, 2)), random.standard_normal(60)
    learnt = np.ones(60, np.bool_)
    learnt[[0, 1, 20, 41, 59]] = False
    rows, parameters = [], []
    for chosen in (slice(None), learnt):
        beta, P, tracker = np.zeros(2), np.eye(2), empty_tracker(1, 10, 2)
        rows.append(
            track_beside(tracker, x[chosen], Z[chosen], y[chosen], learnt[chosen], beta, P, 0.1, 0.99, 1e-6, injection)
        )
        parameters.append(beta)
    np.testing.assert_array_equal(rows[0][learnt], rows[1])
    np.testing.assert_array_equal(*parameters)
    assert (rows[0][~learnt][:, 2:] > 0.0).all()


def test_a_tracker_for_other_regressors_is_refused() -> None:
    with pytest.raises(ValueError, match="another number of regressors"):
        track_beside(
            empty_tracker(1, 5),
            np.ones((1, 1)),
            np.ones((1, 1)),
            np.ones(1),
            np.ones(1, np.bool_),
            np.ones(1),
            np.eye(1),
            1.0,
            1.0,
            0.0,
            False,
        )


def test_rows_depend_on_earlier_samples_only() -> None:
    record = toy_record()
    shorter = Record({name: column[:300] for name, column in record.items()})
    estimator = KRLST(linear_parameters=Toy.truth)
    whole, part = (estimator.fit(context(), data) for data in (record, shorter))
    for name in ("output", "output_variance", "disturbance_N", "disturbance_variance_N2"):
        np.testing.assert_array_equal(getattr(whole, name)[:299], getattr(part, name))


def test_disturbance_and_its_variances_are_right() -> None:
    record = toy_record(4000)
    true_N = 20.0 * np.cos(2 * np.pi * record["time_s"][:-1] / PSI)
    estimate = KRLST(linear_parameters=Toy.truth, gamma=100.0).fit(context(), record)
    assert estimate.output is not None
    assert estimate.output_variance is not None
    assert estimate.disturbance_N is not None
    assert estimate.disturbance_variance_N2 is not None
    error_N = estimate.disturbance_N - true_N
    error_m_per_s = estimate.output - record["velocity_m_per_s"][1:]
    assert error_N[1000:].std() < 0.03 * true_N.std()
    assert 0.8 < np.mean(error_m_per_s[1000:] ** 2 / estimate.output_variance[1000:]) < 1.25
    assert 0.8 < np.mean(error_N[1000:] ** 2 / estimate.disturbance_variance_N2[1000:]) < 1.25


def test_estimate_before_data_is_empty_and_before_start_an_error() -> None:
    estimator = KRLST()
    with pytest.raises(PluginError, match="start"):
        estimator.estimate()
    with pytest.raises(PluginError, match="start"):
        estimator.update(samples(context().regression(toy_record(3)))[0])
    estimator.start(context())
    estimate = estimator.estimate()
    assert estimate.parameters == Toy.truth
    assert estimate.output is not None
    assert estimate.output.shape == (0,)


def test_a_stream_keeps_six_numbers_a_sample() -> None:
    estimator = KRLST(budget=10)
    rows = samples(context().regression(toy_record(4001)))
    estimator.start(context())
    for sample in rows[:2000]:
        estimator.update(sample)
    tracemalloc.start()
    for sample in rows[2000:]:
        estimator.update(sample)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # array("d") is moved when it grows, so that all of its 4000 rows may be counted, and an eighth to spare.
    assert grown < 4000 * 48 * 9 / 8 + 20_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sigma_1_s": 0.0}, "sigma_1_s = 0.0 must be above 0"),
        ({"sigma_2": -1.0}, "sigma_2"),
        ({"gamma": float("inf")}, "gamma"),
        ({"smooth_s": 0.0}, "smooth_s"),
        ({"period_s": float("nan")}, "period_s"),
        ({"forgetting": 0.0}, "forgetting"),
        ({"forgetting": 1.01}, "at most 1"),
        ({"budget": 0}, "budget"),
        ({"budget": 50.0}, "integer"),
        ({"jitter": 1e-7}, "jitter = 1e-07 must be at least 1e-06"),
        ({"mode": "b2p"}, "B2P"),
        ({"linear_parameters": {"a": float("nan")}}, r"linear_parameters\[a\]"),
    ],
)
def test_bad_arguments_are_refused(arguments: Mapping[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=f"krls_t: .*{message}"):
        KRLST(**arguments)


def test_names_of_linear_parameters_are_checked() -> None:
    for run in (stream, lambda estimator, record: estimator.fit(context(), record)):
        with pytest.raises(SpecError, match=r"no linear parameter aa\. Did you mean a"):
            run(KRLST(linear_parameters={"aa": 0.2, "b": 0.7}), toy_record(10))
        with pytest.raises(SpecError, match="linear_parameters for a, b too"):
            run(KRLST(linear_parameters={}), toy_record(10))


def test_without_a_period_the_force_is_smooth() -> None:
    n = 3000
    random = np.random.default_rng(8)
    t = times_s(n)
    u, d = random.standard_normal(n), 20.0 * np.sin(2.0 * np.pi * 0.7 * t)
    v = np.zeros(n)
    for k in range(n - 1):
        v[k + 1] = 0.2 * v[k] + 0.7 * u[k] + Toy.gain * d[k] + 1e-2 * random.standard_normal()
    estimate = KRLST().fit(context(period_s=None), Record({"time_s": t, "velocity_m_per_s": v, "command_m_per_s": u}))
    assert KRLST().skip(context(period_s=None)) is None
    assert estimate.disturbance_N is not None
    assert (estimate.disturbance_N - d[:-1])[500:].std() < 0.2 * d.std()


def test_the_force_on_a_drive_with_current_input_is_that_of_its_equation() -> None:
    scenario = load_scenario("DriveCurrentClosed-v0")
    drive, (record, truth) = scenario.context(), scenario.observe(0)
    estimate = KRLST().fit(drive, record)
    assert dict(estimate.parameters) == {}
    assert estimate.disturbance_N is not None
    assert truth.disturbance_N is not None
    settled = slice(800, 1999)
    np.testing.assert_allclose(estimate.disturbance_N[settled].mean(), 100.0, atol=5.0)  # it shrinks by what it forgets
    assert (estimate.disturbance_N - truth.disturbance_N[:-1])[settled].std() < 15.0


def test_divergence_is_an_error() -> None:
    with pytest.raises(SpecError, match=r"diverged .* mode UI"):
        KRLST(linear_parameters=Toy.truth, mode="UI", forgetting=0.9).fit(context(), toy_record(3000))
