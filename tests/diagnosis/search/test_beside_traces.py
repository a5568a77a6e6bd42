"""Look-alikes beside traces of all other effects: what is left of them, at which shapes, and what that says."""

import math

import numpy as np
import pytest
import search_lab
from scipy.stats import norm
from search_lab import NOMINAL, search

from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.search.beside_traces import beside_traces
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.search.stage import Rival, log_odds_of_pairs, look_alikes
from fdbench.diagnosis.settings import changed
from fdbench.effects import Effect, effects

LAG, DEAD_TIME = effects.get("current_loop_lag"), effects.get("dead_time")
QUIET = {"motor_force_N": 0.1, "position_m": 1e-8, "motor_minus_table_position_m": 1e-9}


def delays(monkeypatch: pytest.MonkeyPatch, *effects_: Effect) -> tuple[Search, list[Rival]]:
    """Return a search in quiet records of an axis with effects, and its two delays, the closest first."""
    for name, rms in QUIET.items():
        monkeypatch.setitem(search_lab.FLOORS, name, rms)
    own, base = search(*effects_), start(NOMINAL)
    fits = [(kind, own.refinement.refine(base.with_effect(kind.typical())), True) for kind in (LAG, DEAD_TIME)]
    return own, look_alikes(own.compared(base, fits))


def test_what_a_trace_changes_is_left_of_neither(monkeypatch: pytest.MonkeyPatch) -> None:
    trace = effects.get("structural_mode").typical().scaled(0.05)
    lag = LAG.typical(time_constant_s=3e-4, inverter_ratio=0.35)
    own, rivals = delays(monkeypatch, lag, trace)
    squares, imitating = beside_traces(own.refinement, rivals)
    counts = sum(run.n_samples * len(run.channels) for run in own.split.runs)
    left = dict(zip((rival.kind for rival in rivals), squares.sum(axis=0).tolist(), strict=True))
    assert left[LAG] < 1.03 * counts
    assert left[DEAD_TIME] - left[LAG] > 50.0
    assert not imitating.any()


def test_the_shape_of_a_lag_is_sought_beside_traces(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that stopped at another shape is compared at the best one."""
    lag = LAG.typical(time_constant_s=3e-4, inverter_ratio=0.2)
    own, rivals = delays(monkeypatch, lag)
    closest = next(rival for rival in rivals if rival.kind is DEAD_TIME)
    away = next(rival for rival in rivals if rival.kind is LAG)
    bent = search_lab.refined_rival(start(NOMINAL), away.effect.within(inverter_ratio=0.5), away.misfit)
    squares, imitating = beside_traces(own.refinement, [closest, bent])
    assert squares.sum(axis=0)[1] < squares.sum(axis=0)[0] - 30.0
    assert not imitating[1]


def test_a_search_tells_a_lag_from_a_dead_time(monkeypatch: pytest.MonkeyPatch) -> None:
    for true in (LAG.typical(time_constant_s=4e-4, inverter_ratio=0.2), DEAD_TIME.typical(dead_time_s=4e-4)):
        own, _ = delays(monkeypatch, true)
        stage = own.stage(start(NOMINAL))
        assert stage is not None
        first, other = (rival for rival in stage.rivals if rival.kind.cause_type == "delay")
        assert first.kind.declared is type(true)
        assert stage.evidence_of(first) > stage.evidence_of(other) + 0.5


def test_where_much_else_is_missing_traces_tell_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    own, rivals = delays(monkeypatch, LAG.typical(time_constant_s=4e-4, inverter_ratio=0.2))
    stage = own.compared(start(NOMINAL), [(rival.kind, rival.hypothesis, True) for rival in rivals])
    assert own._with_delays_told(stage) is not stage
    with changed({"search.unexplained": 0.5}):
        assert own._with_delays_told(stage) is stage


def test_log_odds_of_pairs_by_hand() -> None:
    squares = np.array([[1.0, 1.5, 0.5], [2.0, 3.5, 1.0], [1.0, 2.0, 0.5]])
    behind = squares[:, 1] - squares[:, 0]
    z = behind.sum() / (math.sqrt(3.0) * behind.std(ddof=1))
    odds = log_odds_of_pairs(squares, np.array([False, False, True]), certainty=0.5, of_imitation=2.0)
    assert odds[0] == 0.0
    assert odds[1] == pytest.approx(norm.logsf(0.5 * z) - norm.logcdf(0.5 * z))
    assert odds[2] == -2.0  # nearer than the closest only by its bound


def test_where_all_imitate_the_first_is_the_closest() -> None:
    squares = np.array([[1.0, 1.5], [2.0, 3.5], [1.0, 2.0]])
    odds = log_odds_of_pairs(squares, np.array([True, True]), certainty=0.5, of_imitation=2.0)
    assert odds[0] == -2.0
    assert odds[1] < -2.0
