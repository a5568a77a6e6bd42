"""The bootstrap against slow loops, and what five modules draw with it against what each of them wrote out before."""

import numpy as np
import pandas as pd
import pytest

from fdbench.benchmark import statistics
from fdbench.diagnosis.judge import localise, reduction
from fdbench.diagnosis.settings import JUDGE
from fdbench.statistics import drawn_counts, drawn_rows, percentile_interval
from fdbench.trials import score
from fdbench.trials.diagnosers.sparse_regression import SparseRegression

SIZES = (1, 2, 37, 400)


def parts(n: int, n_cells: int = 3) -> np.ndarray:
    return np.random.default_rng(n).normal(1.0, 2.0, (n, n_cells))


@pytest.mark.parametrize("n", SIZES)
def test_rows_of_a_group_are_drawn_together(n: int) -> None:
    groups = np.random.default_rng(n).integers(0, 1 + n // 3, n)
    counts = drawn_counts(groups, 200)
    for name in np.unique(groups):
        own = counts[:, groups == name]
        assert (own == own[:, :1]).all()
    first = [np.flatnonzero(groups == name)[0] for name in np.unique(groups)]
    assert (counts[:, first].sum(axis=1) == len(first)).all()


def test_counts_have_the_moments_of_a_multinomial() -> None:
    counts = drawn_counts(np.arange(10), 20_000)
    assert counts.mean() == 1.0
    assert counts.var(axis=0) == pytest.approx(np.full(10, 0.9), rel=0.05)


def test_rows_stay_in_their_stratum() -> None:
    strata = np.array([3, 1, 3, 1, 1, 2])
    rows = drawn_rows(strata, 500)
    assert (strata[rows] == strata).all()
    assert {*rows[:, 0].tolist()} == {0, 2}
    assert {*rows[:, 1].tolist()} == {1, 3, 4}


def test_another_seed_is_another_draw() -> None:
    for draw in (drawn_counts, drawn_rows):
        assert np.array_equal(draw(np.arange(50) % 5, 9, 1), draw(np.arange(50) % 5, 9, 1))
        assert not np.array_equal(draw(np.arange(50) % 5, 9, 1), draw(np.arange(50) % 5, 9, 2))


# ---- the same bits as before, module by module ----


@pytest.mark.parametrize("n", SIZES)
def test_reductions_draw_as_before(n: int) -> None:
    groups = np.random.default_rng(n).integers(0, 1 + n // 3, n).astype(np.float64)
    found = reduction.Reductions(
        subsets=[(), (0,)],
        by_segment=np.abs(parts(n, 2)),
        counts=np.full(n, 5.0),
        groups=groups,
        channel=np.zeros(n, dtype=np.intp),
        implausible=[0.0, 0.0],
    )
    names, place = np.unique(groups, return_inverse=True)
    picked = np.random.default_rng(0).multinomial(len(names), np.full(len(names), 1.0 / len(names)), size=1000)
    draws = np.asarray(picked[:, place], dtype=np.float64)
    expected = (draws @ found.by_segment) / (draws @ found.counts)[:, None]
    assert found.mean(found.draws()).tobytes() == expected.tobytes()
    share = 1.0 - expected[:, 1] / expected[:, 0]
    assert reduction._interval(share) == tuple(np.percentile(share, [2.5, 97.5]).tolist())


@pytest.mark.parametrize("n", SIZES)
def test_partitions_draw_as_before(n: int) -> None:
    picked = np.random.default_rng(0).multinomial(n, np.full(n, 1.0 / n), size=1000)
    assert np.array_equal(drawn_counts(np.arange(n), JUDGE.resamples), picked)
    bounds = np.percentile(localise.shares(picked @ parts(n)), [2.5, 97.5], axis=0).T
    # The same product of a matrix that lies otherwise in memory: the library of linear algebra may round its sums anew.
    np.testing.assert_allclose(localise.Partition(parts(n)).ci95, bounds, rtol=1e-13)


@pytest.mark.parametrize("n", SIZES)
def test_sheets_of_trials_draw_as_before(n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(n)
    table = score.AnswerTable(
        effects=["a", "b"],
        types=["x", "y"],
        chances=rng.random((n, 2)),
        present=(rng.random((n, 2)) > 0.5).astype(np.float64),
        unknown=rng.random(n),
        none=rng.random(n),
        has_unknown=(rng.random(n) > 0.7).astype(np.float64),
        closure=rng.random(n),
        oracle_closure=rng.random(n),
    )
    rng = np.random.default_rng(0)
    draws = [table.rows(rng.integers(0, n, n)) for _ in range(1000)]
    monkeypatch.setattr(score, "QUANTITIES", {"brier": score.QUANTITIES["brier"]})
    values = np.array([score.brier(draw) for draw in draws])
    found = score.sheet(table)["brier"]
    assert found["ci95"] == np.quantile(values, [0.025, 0.975]).tolist()
    # The level was written as 0.5 -/+ 0.95 / 2 before, which is 0.025 but for the last bit.
    assert found["ci95"] == pytest.approx(np.quantile(values, [0.5 - 0.95 / 2.0, 0.5 + 0.95 / 2.0]).tolist(), rel=1e-14)


@pytest.mark.parametrize("seeds", [(1,), (2, 5, 1), (10, 10, 10, 10)])
def test_rankings_draw_as_before(seeds: tuple[int, ...]) -> None:
    runs = [(f"S{place}", seed) for place, n in enumerate(seeds) for seed in range(n)]
    index = pd.MultiIndex.from_tuples(runs[::-1], names=["scenario", "seed"])
    values = pd.DataFrame({"x": parts(len(runs), 1)[:, 0]}, index=index)
    rng = np.random.default_rng(statistics.SEED)
    scenario = values.index.get_level_values("scenario").to_numpy()
    weights = np.empty(len(values))
    drawn = np.empty((statistics.RESAMPLES, len(values)), dtype=np.intp)
    for name in np.unique(scenario):
        own = np.flatnonzero(scenario == name)
        weights[own] = 1.0 / len(own)
        drawn[:, own] = rng.choice(own, size=(statistics.RESAMPLES, len(own)))
    column = values["x"].to_numpy()
    expected = statistics.interquartile_mean(column[drawn], np.broadcast_to(weights, drawn.shape))
    value, resampled = statistics.bootstrap(values)["x"]
    assert value == float(statistics.interquartile_mean(column, weights))
    assert resampled.tobytes() == expected.tobytes()
    tail = 50.0 * (1.0 - statistics.LEVEL)  # 2.5 but for the last bits
    before = np.percentile(resampled, [tail, 100.0 - tail]).tolist()
    assert percentile_interval(resampled).tolist() == pytest.approx(before, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("n", SIZES)
def test_sparse_regression_draws_as_before(n: int) -> None:
    pieces = parts(n)
    sums = pieces[:, :, None] * pieces[:, None, :]
    rng, before = np.random.default_rng(0), []
    for _ in range(SparseRegression().resamples):
        weights = rng.multinomial(len(sums), np.full(len(sums), 1.0 / len(sums)))
        before.append(np.tensordot(weights.astype(np.float64), sums, axes=1))
    after = [np.tensordot(counts, sums, axes=1) for counts in drawn_counts(np.arange(n), SparseRegression().resamples)]
    assert np.array(after).tobytes() == np.array(before).tobytes()
