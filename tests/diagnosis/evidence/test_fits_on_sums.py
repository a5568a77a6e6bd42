"""Fits on sums: priors of any weight, and coefficients within their limits."""

import numpy as np
import pytest

from fdbench.diagnosis.evidence.evidence import Evidence
from fdbench.diagnosis.evidence.least_squares import Scores


def evidence_of(gap: np.ndarray, columns: np.ndarray) -> Evidence:
    """Return the evidence of one fitted segment, in which columns (n_columns, n_samples) are to explain a gap."""
    signals = np.vstack((gap, columns))
    one, zero = np.ones(1), np.zeros(1, dtype=np.intp)
    return Evidence(
        products=(signals @ signals.T)[None],
        band=np.empty((1, 1, 0)),
        counts=np.array([float(len(gap))]),
        weights=one,
        held_out=np.zeros(1, dtype=np.bool_),
        group=zero,
        run=zero,
        channel=zero,
        lost=np.zeros(len(signals), dtype=np.bool_),
    )


def test_a_prior_counts_by_its_weight() -> None:
    """One column of squares 100 whose fit is 3, already moved by 1: (300 - w) / (100 + w)."""
    column = np.full((1, 100), 1.0)
    for weight in (0.5, 25.0):
        found = Scores(evidence_of(3.0 * column[0], column), {1: (1.0, weight)}, {}).fit([1])
        assert found.coefficients == pytest.approx([(300.0 - weight) / (100.0 + weight)])


def test_what_is_held_at_a_limit_leaves_the_rest_to_the_others() -> None:
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((3, 400))
    columns[1] += 0.8 * columns[0]
    gap = np.array([2.0, 1.0, -1.5]) @ columns
    found = Scores(evidence_of(gap, columns), {}, {1: (-0.5, 0.5), 3: (-9.0, 9.0)}).fit([1, 2, 3])
    others = columns[1:].T
    expected = np.linalg.lstsq(others, gap - 0.5 * columns[0], rcond=None)[0]
    assert found.coefficients == pytest.approx([0.5, *expected])
    assert found.squares == pytest.approx(float(np.sum((gap - 0.5 * columns[0] - others @ expected) ** 2)))


def test_limits_that_nothing_reaches_change_nothing() -> None:
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((2, 50))
    gap = columns.sum(axis=0)
    free, limited = (Scores(evidence_of(gap, columns), {}, limits).fit([1, 2]) for limits in ({}, {1: (-2.0, 2.0)}))
    assert limited.coefficients.tolist() == free.coefficients.tolist()
