"""Long series, thinned: extremes, span and gaps are kept."""

from collections.abc import Iterator

import numpy as np

from fdbench.report._series import envelope, thinned


def blocks(rng: np.random.Generator) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for n in (1, 2, 2999, 3000, 3001, 54321):
        yield 0.25 + 1e-3 * np.arange(n), rng.standard_normal(n)


def test_thinned_series_keeps_extremes_and_span() -> None:
    for time_s, values in blocks(np.random.default_rng(3)):
        t, y = thinned(time_s, values, 3000)
        assert len(t) == len(y) <= 3002
        assert (y.min(), y.max()) == (values.min(), values.max())
        assert (np.diff(t) > 0.0).all()
        assert t[0] == time_s[0]
        assert abs(t[-1] - time_s[-1]) <= 2.0 * np.ptp(time_s) / 1500.0
        assert abs(t[np.argmax(y)] - time_s[np.argmax(values)]) <= 2.0 * np.ptp(time_s) / 1500.0


def test_thinned_series_breaks_at_gaps() -> None:
    time_s = np.concatenate((np.arange(0.0, 10.0, 1e-3), np.arange(50.0, 60.0, 1e-3)))
    t, y = thinned(time_s, np.ones(len(time_s)), 3000)
    (gap,) = np.flatnonzero(np.isnan(y))
    assert t[gap] < 10.02  # a group of rows
    assert t[gap + 1] == 50.0
    assert len(y) < 3010


def test_gaps_that_cannot_be_seen_cut_nothing() -> None:
    for gap, cuts in ((3.0, 0), (6.0, 1)):  # 0.075 and 0.15 % of the width
        time_s = np.arange(4000.0)
        time_s[1000:] += gap - 1.0
        assert np.isnan(thinned(time_s, np.ones(4000), 100)[1]).sum() == cuts


def test_envelope_holds_every_bound() -> None:
    for time_s, values in blocks(np.random.default_rng(4)):
        half = np.abs(values)
        t, lower, upper = envelope(time_s, -half, half, 1000)
        rows = np.searchsorted(t, time_s, side="right") - 1
        assert (lower[rows] <= -half).all()
        assert (upper[rows] >= half).all()
