"""The hybrid model by region: a slow twin, stake and interval by hand, and drawn stages."""

from typing import Any

import numpy as np
import pytest
from fdbench_baselines._example import example_drive
from fdbench_baselines._hybrid_drive import DriveHybrid
from fdbench_baselines._regional_correction import (
    KEPT,
    REGIONS,
    fill,
    follow,
    interval,
    learn,
    means,
    quadrant,
    staked,
)
from fdbench_baselines.hybrid_regions import NARROWER, HybridRegions, share
from fdbench_baselines.hybrid_rls import HybridRLS
from fdbench_baselines.null import Null
from fdbench_baselines.physics_model import PhysicsModel

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Estimate, Estimator, FloatArray
from fdbench.record import Record
from fdbench.reproduce.chou import dwelling
from fdbench.scenario import Scenario, load_scenario

STAIRCASE, SPIRAL = "ServoStaircase-v1", "ServoSpiral-v1"


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def left(estimator: Estimator, scenario: Scenario, record: Record) -> tuple[FloatArray, FloatArray | None]:
    """Return the errors of an estimator's predictions, and their variances."""
    context = scenario.context()
    found = estimator.fit(context, record)
    assert found.output is not None
    return context.regression(record).target - found.output, found.output_variance


def moving(n: int, seed: int = 0, above: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Return a motion on both sides of ``above``, and an error by direction with noise of 0.1."""
    x = above + np.sin(0.05 * np.arange(n))
    rising = np.append(1.0, np.sign(np.diff(x)))
    return x, 0.3 * x + 0.5 * rising + 0.1 * np.random.default_rng(seed).standard_normal(n)


# ---- the recursion ----


def test_regions_by_hand() -> None:
    x = np.array([0.0, 1.0, 1.0, -1.0, -0.5])
    assert [quadrant(x, k) for k in range(5)] == [0, 0, 0, 3, 2]
    phi = np.empty(3 + 2 + REGIONS * 3)
    fill(phi, x, 3, 1, np.array([7.0, 8.0]))
    np.testing.assert_array_equal(phi[:5], [1.0, -1.0, 1.0, 7.0, 8.0])
    np.testing.assert_array_equal(phi[5:], [0.0] * 9 + [1.0, -1.0, 1.0])


def test_weights_and_predictions_are_those_of_a_slow_twin() -> None:
    n, q, p, batch, ridge = 90, 1, 2, 20, 0.5
    x, e = moving(n)
    found, _, theta = learn(x, e, 0, n, q, p, batch, ridge, NARROWER)
    m = (1 + REGIONS) * (2 + q) + p
    rows = np.empty((n, m))
    for k in range(n):
        fill(rows[k], x, k, q, np.array([e[k - 1] if k > 0 else 0.0, e[k - 2] if k > 1 else 0.0]))
    expected, loss = np.zeros(n), np.zeros(len(NARROWER))
    for first in [*range(0, n, batch), n]:
        best, past, top = int(np.argmin(loss)), slice(0, first), np.abs(e[:first]).max(initial=0.0)
        for c, narrower in enumerate(NARROWER):
            keep = np.arange(m) < (2 + q + p if narrower == 0.0 else m)
            prior = np.where(np.arange(m) < 2 + q + p, 1.0, narrower)[keep] / ridge
            A = rows[past][:, keep].T @ rows[past][:, keep] + np.diag(1.0 / prior)
            w = np.zeros(m)
            w[keep] = np.linalg.solve(A, rows[past][:, keep].T @ e[past])
            if first == n:
                np.testing.assert_allclose(theta[c], w, atol=1e-9)
                continue
            before, phi = rows[first, 2 + q : 2 + q + p].copy(), np.empty(m)
            for k in range(first, min(first + batch, n)):
                fill(phi, x, k, q, before)
                value = float(np.clip(phi @ w, -top, top))
                before = np.array([value, before[0]])
                loss[c] += (e[k] - value) ** 2
                if c == best:
                    expected[k] = value
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_region_that_was_never_visited_has_the_common_weights() -> None:
    x, e = moving(400, above=3.0)
    theta = learn(x, e, 0, 400, 1, 2, 50, 1.0, NARROWER)[2]
    own = theta[:, 5:].reshape(len(NARROWER), REGIONS, 3)
    assert np.abs(own[0, :2]).max(axis=1).min() > 1e-3
    np.testing.assert_array_equal(own[:, 2:], 0.0)
    np.testing.assert_array_equal(own[-1], 0.0)
    below = -1.0 - 0.01 * np.arange(30)
    common = np.append(theta[0, :5], np.zeros(4 * 3))
    np.testing.assert_array_equal(follow(theta[0], below, 1, 1e9), follow(common, below, 1, 1e9))
    assert np.abs(follow(theta[0], below + 5.0, 1, 1e9) - follow(common, below + 5.0, 1, 1e9)).max() > 1e-3


def test_a_batch_is_predicted_without_its_measurements() -> None:
    x, e = moving(1000)
    other = e.copy()
    other[920:] += 0.1
    one, two = (staked(learn(x, v, 0, 1000, 3, 5, 50, 1.0, NARROWER)[0], v, 50) for v in (e, other))
    np.testing.assert_array_equal(one[:950], two[:950])
    assert (one[950:] != two[950:]).any()


# ---- stake, interval, share ----


def test_stake_by_hand() -> None:
    """First batch: 1 foretold, 1 found: gain 1. Then 2 foretold: a quarter of its square is all there is to lose."""
    np.testing.assert_allclose(
        staked(np.array([1.0, 0.0, 2.0, 2.0]), np.array([1.0, 0.0, 0.0, 0.0]), 2), [0, 0, 0.5, 0]
    )
    np.testing.assert_array_equal(staked(np.array([2.0, 2.0]), np.array([1.0, 1.0]), 1), 0.0)
    np.testing.assert_array_equal(staked(np.ones(4), np.ones(4), 2), [0.0, 0.0, 1.0, 1.0])


def test_a_batch_cannot_lose_more_than_was_gained() -> None:
    random, batch = np.random.default_rng(1), 10
    e, foretold = (
        random.standard_normal(400),
        random.standard_normal(400) * np.repeat(np.geomspace(0.01, 100.0, 40), 10),
    )
    foretold[:200] += e[:200]
    added = staked(foretold, e, batch)
    gain = np.cumsum(e**2 - (e - foretold) ** 2)
    for first in range(batch, 400, batch):
        assert np.sum(added[first : first + batch] ** 2) <= max(gain[first - 1], 0.0) * (1.0 + 1e-9)
    assert np.abs(added).max() > 0.0
    assert np.sum((e - added) ** 2) <= np.sum(e**2)


def test_interval_by_hand() -> None:
    """Squares 4 in region 0, then 1 in region 1; a region's mean is drawn to that of all by one batch of one sample."""
    found = interval(np.array([2.0, 1.0, 5.0]), np.array([1.0, 1.0, 0.5]), np.array([0, 1, 0]), 1)
    of_all = (4.0 * KEPT + 1.0) / (KEPT + 1.0)
    np.testing.assert_allclose(found, [4.0, 4.0, 0.5 * (4.0 * KEPT + of_all) / (KEPT + 1.0)])


def test_means_by_hand() -> None:
    """With one common row: 0, (0 + 2 / 2) / 1 in a new region, (2 + 6 / 3) / 2 in the first again."""
    np.testing.assert_allclose(means(np.array([2.0, 4.0, 9.0]), np.array([0, 1, 0]), 1), [0.0, 1.0, 2.0])


def test_share_by_hand() -> None:
    """Ten tenths that ask for 0.5 +- 0.3: a variance of 10 * 0.03^2, which is taken off relative to 0.5."""
    run = np.ones(10)
    assert [share(run, factor * run) for factor in (0.5, 2.0, -1.0)] == [0.5, 1.0, 0.0]
    assert share(np.zeros(10), run) == 0.0
    doubted = 0.5 + 0.3 * np.tile([1.0, -1.0], 5)
    assert share(run, doubted) == pytest.approx(0.5 - 10 * 0.03**2 / 0.5)
    assert share(run, 0.1 * doubted - 0.045) == 0.0


def test_intervals_cover_95_per_cent_of_a_linear_error() -> None:
    n, batch = 6000, 50
    x, e = moving(n, seed=4)
    foretold, spread, _ = learn(x, e, 0, n, 2, 3, batch, 1.0, NARROWER)
    rest = e - staked(foretold, e, batch)
    variance = interval(rest, spread, np.array([quadrant(x, k) for k in range(n)]), batch)
    later = slice(1000, None)
    inside = np.abs(rest[later]) <= 1.96 * np.sqrt(variance[later])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.025)
    assert rms(rest[later]) < 0.3 * rms(e[later])


# ---- on scenarios ----


@pytest.mark.parametrize(("name", "seed"), [(STAIRCASE, 7), (SPIRAL, 1), (SPIRAL, 4)])
def test_a_stage_is_predicted_better_than_by_physics(name: str, seed: int) -> None:
    scenario = load_scenario(name)
    record = scenario.observe(seed)[0]
    physics = left(PhysicsModel(), scenario, record)[0]
    own, variance = left(HybridRegions(), scenario, record)
    assert variance is not None
    assert rms(own) < 0.65 * rms(physics)
    assert 0.9 < np.mean(np.abs(own) <= 1.96 * np.sqrt(variance)) < 0.99


def test_where_the_hybrid_model_diverges_for_want_of_an_initialisation_this_one_does_not() -> None:
    scenario = load_scenario(SPIRAL)
    record = scenario.observe(2)[0]
    physics, hybrid, own = (left(e, scenario, record)[0] for e in (PhysicsModel(), HybridRLS(), HybridRegions()))
    assert rms(hybrid) > rms(physics)
    assert rms(own) < 0.4 * rms(physics)


def test_the_first_move_after_a_dwell_is_not_worse_than_physics() -> None:
    scenario = dwelling(load_scenario("ServoStaircase-v0"), 0.857, initial_dwell_s=0.857)
    record = scenario.observe(0)[0]
    physics, hybrid, own = (left(e, scenario, record)[0] for e in (PhysicsModel(), HybridRLS(), HybridRegions()))
    for samples in (slice(900, 1000), slice(857, 1857), slice(None)):
        assert rms(own[samples]) <= rms(physics[samples])
        assert rms(hybrid[samples]) > rms(physics[samples])


def test_nothing_is_added_to_physics_where_there_is_nothing_to_learn() -> None:
    random = np.random.default_rng(5)
    x, e = moving(2000)[0], random.standard_normal(2000)
    added = staked(learn(x, e, 0, 2000, 3, 10, 50, 1.0, NARROWER)[0], e, 50)
    assert rms(e - added) <= 1.005 * rms(e)


@pytest.mark.parametrize(("name", "seed"), [(STAIRCASE, 0), (SPIRAL, 0)])
def test_a_free_run_is_not_worse_than_the_data_sheet(name: str, seed: int) -> None:
    scenario = load_scenario(name)
    context, (record, truth), command = scenario.context(), scenario.observe(seed), scenario.command()
    assert command is not None
    assert truth.response is not None
    errors = []
    for estimator in (HybridRegions(), Null()):
        run = estimator.predict(context, estimator.fit(context, record), command)
        assert run is not None
        errors.append(rms(run - truth.response))
    assert errors[0] <= errors[1]


def test_a_free_run_of_a_drive_takes_only_corrections_that_its_own_command_asks_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sheet: 0.5 and 0.5; the machine: 0.4 and 0.6."""
    context, record = example_drive(mass_ratio=1.25)
    estimator = HybridRegions()
    found = estimator.fit(context, record)
    right = estimator.predict(context, found, record)
    np.testing.assert_allclose(right, record["velocity_m_per_s"][1:], atol=1e-4)
    wrong = Estimate(parameters={"beta_1": 0.6, "beta_2": 0.4})
    monkeypatch.setattr(DriveHybrid, "estimate", lambda self: wrong)
    sheet = context.linear_model.free_run(record, context.nominal)
    np.testing.assert_array_equal(estimator.predict(context, found, record), sheet)


@pytest.mark.parametrize("name", ["LinearMotorCogging-v1", "MillingDecreasing-v2", "BallScrewAxis-v2"])
def test_a_drive_s_free_run_is_not_worse_than_the_data_sheet_s_in_the_mean(name: str) -> None:
    scenario = load_scenario(name)
    context, command = scenario.context(), scenario.command()
    assert command is not None
    errors = np.empty((4, 2))
    for seed in range(4):
        record, truth = scenario.observe(seed)
        assert truth.response is not None
        for column, estimator in enumerate((HybridRegions(), Null())):
            run = estimator.predict(context, estimator.fit(context, record), command)
            assert run is not None
            errors[seed, column] = rms(run - truth.response)
    own, sheet = errors.mean(axis=0)
    assert own <= sheet


@pytest.mark.parametrize("name", ["ShakerControl-v1", "DriveCurrentClosed-v0"])
def test_a_drive_is_predicted_better_than_by_physics(name: str) -> None:
    scenario = load_scenario(name)
    record = scenario.observe(0)[0]
    physics, own = (left(e, scenario, record)[0] for e in (PhysicsModel(), HybridRegions()))
    assert rms(own) < 0.9 * rms(physics)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"response_lags": -1}, r"response_lags = -1 must be an integer of at least 0"),
        ({"error_lags": 2.0}, r"error_lags = 2\.0 must be an integer"),
        ({"batch_samples": 0}, r"batch_samples = 0 must be an integer of at least 1"),
        ({"regularisation_m2": 0.0}, r"regularisation_m2 = 0\.0 must be above 0"),
    ],
)
def test_arguments_out_of_bounds_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        HybridRegions(**arguments)


def test_what_it_does_not_apply_to_is_named() -> None:
    with pytest.raises(SpecError, match="hybrid_regions: the readings of a sample"):
        HybridRegions().start(load_scenario("SpindleStep-v0").context())
    with pytest.raises(PluginError, match=r"start\(context\) must come before"):
        HybridRegions().estimate()
