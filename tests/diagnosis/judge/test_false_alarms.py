"""The guarantee on false alarms holds whatever the probabilities of axes without a cause are distributed like."""

import numpy as np
import pytest

from fdbench.diagnosis.judge.false_alarms import AxesWithoutCause, axes_without_cause, false_alarms


@pytest.mark.parametrize("exponent", [0.1, 1.0, 20.0])
def test_an_axis_like_those_without_a_cause_is_rarely_said_to_be_unlike_them(exponent: float) -> None:
    rng = np.random.default_rng(1)
    values = rng.random((4000, 60)) ** exponent
    p = np.array(
        [
            false_alarms(float(own[0]), 0.1, AxesWithoutCause(source="", surest=tuple(own[1:]), unknown=(0.2,))).at_most
            for own in values
        ]
    )
    for level in (0.05, 0.1, 0.5):
        assert np.mean(p <= level) <= level + 3.0 * np.sqrt(level / len(p))
        assert np.mean(p <= level) >= level - 1.0 / 60 - 3.0 * np.sqrt(level / len(p))


def test_no_probability_is_smaller_than_the_axes_allow() -> None:
    axes = AxesWithoutCause(source="", surest=(0.2, 0.3), unknown=(0.1, 0.4))
    assert false_alarms(0.9, 0.4, axes).at_most == pytest.approx(1.0 / 3.0)
    assert false_alarms(0.0, 0.4, axes).at_most == 1.0


def test_an_axis_on_which_more_is_unknown_than_on_any_other_is_not_like_them() -> None:
    axes = AxesWithoutCause(source="", surest=(0.2, 0.3), unknown=(0.1, 0.4))
    assert false_alarms(0.9, 0.4, axes).exchangeable
    assert not false_alarms(0.9, 0.5, axes).exchangeable


def test_the_axes_that_are_shipped_are_as_many_in_both_columns() -> None:
    axes = axes_without_cause()
    assert len(axes.surest) == len(axes.unknown) >= 50
    assert all(0.0 <= value <= 1.0 for value in (*axes.surest, *axes.unknown))
