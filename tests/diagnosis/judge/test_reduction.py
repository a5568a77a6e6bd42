"""How far the gap shrinks: means over segments and channels, resampling, and shares of effects, by hand."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from axis_lab import as_built, case, other_friction, protocol, record

from fdbench.diagnosis import diagnose as diagnosis
from fdbench.diagnosis.judge.reduction import Reductions, reductions_of, shapley
from fdbench.diagnosis.judge.shares import Parts, Shares
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import effects


def reductions() -> Reductions:
    """Two stretches of time with two channels each, of the model and one effect."""
    return Reductions(
        subsets=[(), (0,)],
        by_segment=np.array([[40.0, 10.0], [8.0, 4.0], [60.0, 30.0], [12.0, 4.0]]),
        counts=np.array([10.0, 4.0, 10.0, 4.0]),
        groups=np.array([0.0, 0.0, 1.0, 1.0]),
        channel=np.array([0, 1, 0, 1]),
        implausible=[0.0, 0.0],
    )


def test_means_are_weighted_by_samples() -> None:
    found = reductions()
    assert found.of_channel(0).tolist() == [5.0, 2.0]
    assert found.of_channel(1).tolist() == [2.5, 1.0]
    assert found.mean() == pytest.approx([120.0 / 28.0, 48.0 / 28.0])


def test_a_stretch_of_time_is_drawn_whole() -> None:
    found = reductions()
    draws = found.draws()
    assert draws.shape == (JUDGE.resamples, 4)
    np.testing.assert_array_equal(draws[:, 0], draws[:, 1])
    np.testing.assert_array_equal(draws[:, 2], draws[:, 3])
    assert (draws[:, 0] + draws[:, 2] == 2.0).all()
    first_alone = found.mean(np.array([[2.0, 2.0, 0.0, 0.0]]))
    assert first_alone[0] == pytest.approx([48.0 / 14.0, 14.0 / 14.0])
    np.testing.assert_array_equal(draws, found.draws())


def test_shares_of_effects_add_up_and_are_fair() -> None:
    rng = np.random.default_rng(0)
    subsets = [c for n in range(4) for c in itertools.combinations(range(3), n)]
    values = {subset: float(rng.uniform()) for subset in subsets} | {(): 0.0}
    assert sum(shapley(values, 3)) == pytest.approx(values[0, 1, 2])
    orders = list(itertools.permutations(range(3)))
    by_order = [
        [values[tuple(sorted(order[: order.index(p) + 1]))] - values[tuple(sorted(order[: order.index(p)]))]
         for p in range(3)]
        for order in orders
    ]  # fmt: skip
    assert shapley(values, 3) == pytest.approx(np.mean(by_order, axis=0))


def test_what_is_worse_alone_still_has_its_share() -> None:
    """The second effect of itself leaves more than the base, with the first it leaves less than that."""
    found = Reductions(
        subsets=[(), (0,), (1,), (0, 1)],
        by_segment=np.array([[100.0, 10.0, 150.0, 4.0]]),
        counts=np.array([10.0]),
        groups=np.array([0.0]),
        channel=np.array([0]),
        implausible=[0.0] * 4,
    )
    closed = found.closed_in_channel(0)
    assert closed == pytest.approx({(): 0.0, (0,): 9.0, (1,): 0.0, (0, 1): 9.6})
    assert shapley(closed, 2) == pytest.approx([9.3, 0.3])


def test_no_subset_is_credited_with_more_than_all() -> None:
    gaps = {(): 10.0, (0,): 1.0, (1,): 12.0, (0, 1): 3.0}
    found = Reductions(
        subsets=list(gaps),
        by_segment=np.array([list(gaps.values())]),
        counts=np.array([1.0]),
        groups=np.array([0.0]),
        channel=np.array([0]),
        implausible=[0.0] * 4,
    )
    closed = found.closed_in_channel(0)
    assert closed == {(): 0.0, (0,): 7.0, (1,): 0.0, (0, 1): 7.0}


@pytest.mark.parametrize(("implausible", "is_better"), [(0.0, False), (30.0, True)])
def test_what_implausible_values_close_does_not_count(implausible: float, is_better: bool) -> None:
    found = Reductions(
        subsets=[(), (0,)],
        by_segment=np.array([[10.0, 11.0]]),
        counts=np.array([10.0]),
        groups=np.array([0.0]),
        channel=np.array([0]),
        implausible=[implausible, 0.0],
    )
    assert (found.loses_by(0) < 0.0) is is_better


@pytest.mark.parametrize(("with_effect", "is_worse"), [(2.0, False), (4.4, True)])
def test_what_makes_a_channel_far_worse_stands_in_there(with_effect: float, is_worse: bool) -> None:
    """Though it takes more of another one, and far less noise than that is none."""
    found = Reductions(
        subsets=[(), (0,)],
        by_segment=np.array([[20.0, 10.0 * with_effect], [900.0, 10.0]]),
        counts=np.array([10.0, 10.0]),
        groups=np.array([0.0, 0.0]),
        channel=np.array([0, 1]),
        implausible=[0.0, 0.0],
    )
    gaps = np.array([found.of_channel(place)[0] for place in (0, 1)])
    parts = Parts(found, Shares(gaps, np.zeros(2)), ["motor_force_N", "position_m"])
    assert found.loses_by(0) < 0.0
    assert parts.is_worse_in_a_channel(0) is is_worse


def test_what_stands_in_for_something_is_as_probably_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    nominal, fitted, judged = case((effects.get("cogging").typical(),), seed=1)
    plain = diagnosis.diagnose(nominal, fitted[2:], judged[1:]).answer
    monkeypatch.setattr(Parts, "is_worse_in_a_channel", lambda self, index: True)
    doubted = diagnosis.diagnose(nominal, fitted[2:], judged[1:]).answer
    before, after = (
        next(cause.probability for cause in answer.causes if cause.effect == "cogging") for answer in (plain, doubted)
    )
    assert after <= JUDGE.named < before
    assert doubted.unknown_probability > 0.2 > plain.unknown_probability


def test_what_the_written_model_is_no_better_with_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def worse(*given: Any) -> Reductions:
        found = reductions_of(*given)
        by_segment = found.by_segment.copy()
        by_segment[:, -1] = 1.1 * by_segment[:, 0]
        return dataclasses.replace(found, by_segment=by_segment)

    monkeypatch.setattr(diagnosis, "reductions_of", worse)
    nominal, fitted, judged = case((effects.get("cogging").typical(),), seed=1)
    answer = diagnosis.diagnose(nominal, fitted[2:], judged[1:]).answer
    assert "cogging" in [cause.effect for cause in answer.causes]
    assert [cause.effect for cause in answer.causes if cause.probability > JUDGE.named] == []


@pytest.mark.parametrize("by", [0.5, 2.0])
def test_what_friction_changes_by_from_run_to_run_hides_no_effect(by: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may make one model for all a little worse with it, not far worse."""

    def hidden(readings: Any, split: Any, *given: Any) -> Reductions:
        found = reductions_of(readings, split, *given)
        if split.changes:
            return found
        by_segment = found.by_segment.copy()
        by_segment[:, -1] = by_segment[:, 0] + by * found.counts
        return dataclasses.replace(found, by_segment=by_segment, implausible=[0.0, 0.0])

    monkeypatch.setattr(diagnosis, "reductions_of", hidden)
    cogging, axis, nominal = effects.get("cogging").typical(), as_built(1), case((), seed=1)[0]
    fitted, judged = (
        [
            record(other_friction(axis, friction), (cogging,), *motion, seed=place)
            for place, (motion, friction) in enumerate(itertools.product(protocol(factor).values(), changes))
        ]
        for factor, changes in ((1.0, (0.97, 1.03)), (1.3, (1.0,)))
    )
    answer = diagnosis.diagnose(nominal, fitted, judged).answer
    cause = next(cause for cause in answer.causes if cause.effect == "cogging")
    (step,) = (step for step in answer.shrinkage.steps if step.added == "cogging")
    assert cause.beside_changes is step.beside_changes is (cause.probability > JUDGE.named) is (by < 1.0)
    assert (cause.share > 0.0) is (step.reduction > 0.0) is (by < 1.0)
    assert answer.left() == pytest.approx(answer.sizes()[1] + by)
