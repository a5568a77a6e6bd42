"""State-space Gaussian process: the dense one as slow twin, closed forms, and scenarios against other estimators."""

import numpy as np
import pytest
from fdbench_baselines._disturbance_gain import disturbance_gain
from fdbench_baselines._locally_periodic_force import posterior
from fdbench_baselines._locally_periodic_states import (
    Amplitudes,
    LikeliestProcess,
    NoisyRows,
    designs,
    likeliest_process,
    restricted,
    start_values,
    transitions,
)
from fdbench_baselines._state_space_gp import Transition, transition
from fdbench_baselines.kalman import Kalman
from fdbench_baselines.state_space_gp import StateSpaceGp

from fdbench.errors import SpecError
from fdbench.estimator import Estimator, FloatArray
from fdbench.scenario import load_scenario

pytestmark = pytest.mark.linear_algebra

STEP_S, PERIOD_S, N = 0.003, 0.018, 90
PLACE = np.array([0.4, -0.7, -0.3, -0.2, -1.5, 0.3])
RANDOM = np.random.default_rng(7)
TIME_S = STEP_S * np.arange(N)
ANGLE = 2.0 * np.pi * (TIME_S / PERIOD_S + 0.5 * TIME_S**2)
FEED = 0.01 + 0.005 * (TIME_S > 0.1)
Z = np.column_stack((FEED, RANDOM.standard_normal(N)))
LEFT = Z @ [3.0, 0.5] + np.cos(ANGLE) + 0.3 * RANDOM.standard_normal(N)


def dense_kernel(order: int, lag_s: FloatArray, length_s: float) -> FloatArray:
    """Return exp(-t / l), or Matern of order 3/2 as printed in Rasmussen and Williams (2006), eq. 4.17."""
    if order == 1:
        return np.asarray(np.exp(-lag_s / length_s))
    r = np.sqrt(3.0) * lag_s / length_s
    return np.asarray((1.0 + r) * np.exp(-r))


def two_spindles(index: int) -> Amplitudes:
    """Return the amplitudes of one spindle beside those of another, whose angle is no multiple of the first's."""
    first, second = designs(ANGLE, 3, None, True)[index], designs(np.sqrt(2.0) * ANGLE, 2, None, True)[index]
    waves = second.harmonics > 0
    return Amplitudes(
        np.ascontiguousarray(np.hstack((first.H, second.H[:, waves]))),
        np.append(first.harmonics, second.harmonics[waves]),
        np.append(first.grows, second.grows[waves]),
        np.append(first.own, second.own[waves]),
        first.order,
    )


def dense_covariance(design: Amplitudes, fresh: FloatArray) -> FloatArray:
    """Return cov(f) from the kernel's formula, with rows of different parts independent."""
    variance = transitions(design, STEP_S, PLACE).P[:, 0, 0]
    lag_s = np.abs(TIME_S[:, None] - TIME_S)
    together = np.cumsum(fresh)[:, None] == np.cumsum(fresh)
    total = np.zeros((N, N))
    for i, harmonic in enumerate(design.harmonics):
        length_s = float(np.exp(PLACE[4] if harmonic == 0 else PLACE[1]))
        h = design.H[:, i]
        total += variance[i] * np.outer(h, h) * dense_kernel(design.order, lag_s, length_s)
    return total * together


def noisy_rows(is_broken: bool) -> NoisyRows:
    """Return the rows, also with missing ones, of different noise, and with a part that begins anew."""
    fresh, loud = np.zeros(N, dtype=np.bool_), np.ones(N)
    if is_broken:
        fresh[40] = True
        loud[[10, 11, 40, 70]] = np.inf
        loud[20] = 9.0
    return NoisyRows(np.column_stack((Z, LEFT)), loud, fresh)


CASES = [(0, False, False), (1, False, False), (0, True, False), (0, False, True), (1, False, True)]


@pytest.mark.parametrize(("index", "is_fed", "is_broken"), CASES)
def test_likelihood_and_force_are_those_of_the_dense_process(index: int, is_fed: bool, is_broken: bool) -> None:
    check_beside_dense(designs(ANGLE, 3, FEED if is_fed else None, True)[index], is_broken)


@pytest.mark.parametrize(("index", "is_broken"), [(0, False), (1, True)])
def test_two_spindles_at_once_are_those_of_the_dense_process(index: int, is_broken: bool) -> None:
    check_beside_dense(two_spindles(index), is_broken)


def check_beside_dense(design: Amplitudes, is_broken: bool) -> None:
    """Hold likelihood, force and variance to those of the whole covariance."""
    rows = noisy_rows(is_broken)
    loud, fresh = rows.loud, rows.fresh
    seen = np.isfinite(loud)
    move = transitions(design, STEP_S, PLACE)
    value, s2 = restricted(rows, design, move)

    K = dense_covariance(design, fresh)
    A = K[np.ix_(seen, seen)] + np.diag(loud[seen])
    inverse = np.linalg.inv(A)
    information = Z[seen].T @ inverse @ Z[seen]
    beta = np.linalg.solve(information, Z[seen].T @ inverse @ LEFT[seen])
    residual = LEFT[seen] - Z[seen] @ beta
    degrees = int(seen.sum()) - 2
    expected_s2 = float(residual @ inverse @ residual) / degrees
    expected = -0.5 * (degrees * np.log(expected_s2) + np.linalg.slogdet(A)[1] + np.linalg.slogdet(information)[1])
    assert value == pytest.approx(expected, abs=1e-8)
    assert s2 == pytest.approx(expected_s2, rel=1e-10)

    V = np.array([[0.3, 0.1], [0.1, 0.2]])
    found = posterior(LikeliestProcess(design, move, loud, fresh, s2, value), LEFT, Z, V, STEP_S, False)
    gain = K[:, seen] @ inverse
    np.testing.assert_allclose(found.force, gain @ LEFT[seen], atol=1e-9)
    moved = gain @ Z[seen]
    spread = s2 * np.diag(K - gain @ K[seen]) + np.einsum("ij,jk,ik->i", moved, V, moved)
    np.testing.assert_allclose(found.variance, spread, atol=1e-9)


@pytest.mark.parametrize(("index", "is_fed", "is_broken"), CASES)
def test_likelihood_of_a_start_is_that_of_the_rows_with_it(index: int, is_fed: bool, is_broken: bool) -> None:
    rows, design = noisy_rows(is_broken), designs(ANGLE, 3, FEED if is_fed else None, True)[index]
    move = transitions(design, STEP_S, PLACE)
    found = start_values(rows, design, move)
    for row in (1, 2, 11, 39, 40, 41, 70, 88, 89):
        fresh = rows.fresh.copy()
        fresh[row] = True
        assert found[row] == pytest.approx(restricted(rows._replace(fresh=fresh), design, move)[0], abs=1e-8)


def test_outlier_is_neither_start_nor_white_force() -> None:
    """At row 300 one sample stands out as the wave grows by a tenth; the wave itself is known from all other rows."""
    n, random = 600, np.random.default_rng(0)
    angle = 2.0 * np.pi * np.arange(n) / 6.0
    force = np.cos(angle) * np.where((np.arange(n) >= 300) & (np.arange(n) < 360), 1.1, 1.0)
    left = force + 0.03 * random.standard_normal(n)
    left[300] += 1.0
    empty, trusted = np.empty((n, 0)), np.ones(n, dtype=np.bool_)
    process = likeliest_process(left, empty, STEP_S, designs(angle, 1, None, True), trusted, True)
    assert process.loud[300] > 10.0
    assert not process.fresh[[300, 301]].any()
    found = posterior(process, left, empty, np.empty((0, 0)), STEP_S, True).force
    assert np.sqrt(np.mean((found - force) ** 2)) < 0.015


def test_a_steady_process_keeps_its_covariance() -> None:
    for order in (1, 2):
        F, Q, P = transition(order, 0.01, 0.2)
        np.testing.assert_allclose(F @ P @ F.T + Q, P, atol=1e-15)
        np.testing.assert_allclose(np.linalg.matrix_power(F, 50), transition(order, 0.5, 0.2).F, atol=1e-13)


def test_the_level_is_left_out_where_it_is_no_force() -> None:
    """All that a level explains then stays in what is left."""
    design = designs(np.zeros(N), 0, None, False)[0]
    move = transitions(design, STEP_S, PLACE)
    process = LikeliestProcess(design, move, np.ones(N), np.zeros(N, np.bool_), 1.0, 0.0)
    found = posterior(process, LEFT, Z, np.zeros((2, 2)), STEP_S, False)
    np.testing.assert_array_equal(found.force, np.zeros(N))
    np.testing.assert_array_equal(found.left, LEFT)


def test_variance_is_calibrated_on_the_process_itself() -> None:
    """95 % intervals hold 95 % of a force that is drawn from the process, as 40 draws can tell."""
    design = designs(ANGLE, 1, None, True)[0]
    move: Transition = transitions(design, STEP_S, PLACE)
    root = np.linalg.cholesky(_covariance(design.H, design.harmonics, move) + 1e-12 * np.eye(N))
    inside = []
    for _ in range(40):
        force = root @ RANDOM.standard_normal(N)
        process = LikeliestProcess(design, move, np.ones(N), np.zeros(N, np.bool_), 1.0, 0.0)
        empty = np.empty((N, 0))
        found = posterior(process, force + RANDOM.standard_normal(N), empty, np.empty((0, 0)), STEP_S, False)
        inside.append(np.mean(np.abs(found.force - force) < 1.96 * np.sqrt(found.variance)))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def _covariance(H: FloatArray, harmonics: FloatArray, move: Transition) -> FloatArray:
    lag_s = np.abs(TIME_S[:, None] - TIME_S)
    total = np.zeros((N, N))
    for i, harmonic in enumerate(harmonics):
        length_s = float(np.exp(PLACE[4] if harmonic == 0 else PLACE[1]))
        total += move.P[i, 0, 0] * np.outer(H[:, i], H[:, i]) * np.exp(-lag_s / length_s)
    return total


def error(estimator: type[Estimator], scenario: str, seed: int, first: int, last: int) -> float:
    """Return the error of the force without its mean, over the force's own size."""
    record, truth = load_scenario(scenario).observe(seed)
    found = estimator().fit(load_scenario(scenario).context(), record).disturbance_N
    assert found is not None
    assert truth.disturbance_N is not None
    true = truth.disturbance_N[first:last]
    return float(np.std(found[first:last] - true) / np.std(true))


@pytest.mark.parametrize(
    ("scenario", "first", "last", "seeds", "largest"),
    [("ShakerConstant-v1", 800, 3200, (211,), 1.0), ("DriveCurrentOpen-v1", 100, 1990, (211,), 0.5)],
)
def test_force_is_nearer_than_that_of_the_kalman_observer(
    scenario: str, first: int, last: int, seeds: tuple[int, ...], largest: float
) -> None:
    """A shaker whose phase law is found, and a step whose row is; on these seeds together."""
    ours, theirs = (sum(error(one, scenario, seed, first, last) for seed in seeds) for one in (StateSpaceGp, Kalman))
    assert ours < largest * theirs


def test_gain_is_nearer_than_on_paper() -> None:
    """The mass is known to 5 %, and to about 2 % once beta_1 is known; at 40 machines."""
    scenario = load_scenario("MillingUpDown-v1")
    context, record = scenario.context(), scenario.record(0)
    regression = context.regression(record)
    ours, paper = [], []
    for seed in range(200, 240):
        drawn = scenario.drawn(seed)
        beta = np.array(list(drawn.linear_model.nominal_parameters(context.sampling_time_s).values()))
        true = drawn.context().regression(record).disturbance_gain
        ours.append(np.log(disturbance_gain(context, regression, beta).gain / true))
        paper.append(np.log(regression.disturbance_gain / true))
    assert np.std(ours) < 0.55 * np.std(paper)


def test_bad_harmonics_are_refused() -> None:
    with pytest.raises(SpecError, match="state_space_gp: harmonics = -1 must be an integer of at least 0"):
        StateSpaceGp(harmonics=-1)
