"""Forward regression picks the terms that made the data, and a free run of them knows the command alone."""

import itertools

import numpy as np
import pytest
from fdbench_baselines._example import example_drive, example_milling
from fdbench_baselines._forward_regression import forward_regression, free_run, select
from fdbench_baselines.narx_frols import NarxFrols

from fdbench.errors import PluginError, SpecError


def test_each_term_is_the_one_that_least_squares_would_add() -> None:
    rng = np.random.default_rng(0)
    P = rng.standard_normal((200, 8)) @ rng.standard_normal((8, 8))
    y = P @ [0.0, 3.0, 0.0, 0.0, -1.0, 0.0, 0.5, 0.0] + 0.1 * rng.standard_normal(200)

    def left(columns: list[int]) -> float:
        return float(np.sum((y - P[:, columns] @ np.linalg.lstsq(P[:, columns], y, rcond=None)[0]) ** 2))

    chosen = forward_regression(P, y, 5)
    for count in range(5):
        before = chosen[:count]
        assert chosen[count] == min((j for j in range(8) if j not in before), key=lambda j: left([*before, j]))
    Q, R = np.linalg.qr(P)
    assert forward_regression(R, Q.T @ y, 5) == chosen


def test_a_column_that_others_make_up_is_not_chosen() -> None:
    P = np.random.default_rng(0).standard_normal((50, 3))
    P = np.column_stack((P, P[:, 0] + P[:, 1]))
    assert len(forward_regression(P, P.sum(axis=1) + 1.0, 4)) == 3


def test_select_finds_the_terms_and_a_free_run_is_the_recursion() -> None:
    rng, n = np.random.default_rng(1), 1000
    known = rng.standard_normal((n, 5))
    y = np.zeros(n)
    for k in range(2, n):
        y[k] = 2.0 * known[k, 1] - 0.5 * known[k, 3] + 1.2 * y[k - 1] - 0.5 * y[k - 2]
    outputs = np.column_stack((np.append(0.0, y[:-1]), np.append([0.0, 0.0], y[:-2])))
    own = np.array([5, 6])
    found = select(known, outputs, [np.arange(5), np.append(np.arange(5), own)], y, 6)
    weights = dict(zip(found.columns, found.weights.tolist(), strict=True))
    assert weights == pytest.approx({1: 2.0, 3: -0.5, 5: 1.2, 6: -0.5}, abs=0.02)
    run = free_run(known, found.columns, found.weights)
    assert run is not None
    slow = np.zeros(n)
    for k, (j, weight) in itertools.product(range(n), weights.items()):
        slow[k] += weight * (known[k, j] if j < 5 else slow[k - j + 4] if k >= j - 4 else 0.0)
    assert np.allclose(run, slow, rtol=0.0, atol=1e-9)


def test_a_run_that_would_grow_is_none() -> None:
    assert free_run(np.ones((10, 1)), [0, 1], np.array([1.0, 1.01])) is None


def test_noise_alone_teaches_nothing() -> None:
    rng = np.random.default_rng(2)
    known, y = rng.standard_normal((2000, 10)), rng.standard_normal(2000)
    assert select(known, np.empty((2000, 0)), [np.arange(10)], y, 8).columns == []


def test_bad_input_is_refused() -> None:
    with pytest.raises(SpecError, match="stride = 0 must be an integer from 1 to 100"):
        NarxFrols(stride=0)
    with pytest.raises(SpecError, match="degree = 4"):
        NarxFrols(degree=4)
    with pytest.raises(SpecError, match="predicts nothing from a command alone"):
        NarxFrols().fit(*example_milling())
    context, record = example_drive()
    with pytest.raises(PluginError, match="must come before predict"):
        NarxFrols().predict(context, None, record)  # type: ignore[arg-type]
