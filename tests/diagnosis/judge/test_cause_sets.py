"""The set of causes holds the true one as often as promised, whatever the probabilities are worth."""

import numpy as np
import pytest

from fdbench.diagnosis.judge.cause_sets import AxesWithOneCause, axes_with_one_cause, cause_set
from fdbench.diagnosis.settings import JUDGE

MISSED = 1.0 - JUDGE.level


@pytest.mark.parametrize("exponent", [0.1, 1.0, 20.0])
def test_the_set_of_an_axis_like_the_others_lacks_its_cause_no_more_often_than_promised(exponent: float) -> None:
    values = np.random.default_rng(1).random((4000, 60)) ** exponent
    sets = [
        cause_set({"backlash": own[0]}, 0.0, AxesWithOneCause(source="", truth=tuple(own[1:]), unknown=(0.1,)))
        for own in values.tolist()
    ]
    lacking = [not found.causes for found in sets]
    chance = 3.0 * np.sqrt(MISSED / len(lacking))
    assert MISSED - 1.0 / 60 - chance <= np.mean(lacking) <= MISSED + chance


def test_where_causes_are_overlooked_too_often_none_can_be_left_out() -> None:
    axes = AxesWithOneCause(source="", truth=(0.0, 0.0, 0.0, 0.0, *[0.9] * 16), unknown=(0.1,))
    found = cause_set({"backlash": 0.95}, 0.0, axes)
    assert found.everything
    assert found.causes == ("backlash",)


def test_few_axes_leave_nothing_out() -> None:
    axes = AxesWithOneCause(source="", truth=(0.9,) * 4, unknown=(0.1,))
    assert cause_set({}, 0.0, axes).everything


def test_effects_are_in_the_order_of_their_probability() -> None:
    axes = AxesWithOneCause(source="", truth=(0.2,) * 5 + (0.9,) * 15, unknown=(0.1, 0.4))
    found = cause_set({"dead_time": 0.3, "backlash": 0.8, "cogging": 0.01}, 0.2, axes)
    assert found.causes == ("backlash", "dead_time")
    assert not found.everything
    assert found.exchangeable
    assert not cause_set({}, 0.5, axes).exchangeable


def test_the_axes_that_are_shipped_are_as_many_in_both_columns() -> None:
    axes = axes_with_one_cause()
    assert len(axes.truth) == len(axes.unknown) >= 50
    assert all(0.0 <= value <= 1.0 for value in (*axes.truth, *axes.unknown))
