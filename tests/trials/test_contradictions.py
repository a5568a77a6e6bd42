"""No answer contradicts itself; an answer that is made to is caught."""

import dataclasses
from collections.abc import Callable

import pytest
from axis_lab import case

from fdbench.diagnosis.answer import Answer
from fdbench.diagnosis.diagnose import diagnose
from fdbench.effects import effects
from fdbench.trials.contradictions import contradictions

Changed = Callable[[Answer], Answer]


@pytest.fixture(scope="module")
def answer() -> Answer:
    cogging = effects.get("cogging").typical(cogging_force_N=30.0)
    return diagnose(*case((cogging,), 3)).answer


def of_cause(**changes: float) -> Changed:
    def changed(answer: Answer) -> Answer:
        first, *others = answer.causes
        return dataclasses.replace(answer, causes=(dataclasses.replace(first, **changes), *others))

    return changed


def of_step(answer: Answer) -> Answer:
    step = dataclasses.replace(answer.shrinkage.steps[0], reduction=-0.2)
    return dataclasses.replace(answer, shrinkage=dataclasses.replace(answer.shrinkage, steps=(step,)))


def of_channels(answer: Answer) -> Answer:
    channels = {
        name: dataclasses.replace(own, repaired=3.0 * own.recalibrated) for name, own in answer.gap.channels.items()
    }
    return dataclasses.replace(answer, gap=dataclasses.replace(answer.gap, channels=channels))


def test_an_answer_agrees_with_itself(answer: Answer) -> None:
    assert answer.causes[0].effect == "cogging"
    assert list(contradictions(answer)) == []


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda own: dataclasses.replace(own, unknown_probability=0.8, no_gap_probability=0.6), "no gap 0.6"),
        (lambda own: dataclasses.replace(own, no_gap_probability=0.9), "cogging with probability"),
        (of_cause(share=0.0, unique_share=0.0), "explains 0 of the gap"),
        (of_cause(share=0.2, unique_share=0.4), "share 0.2, of its own 0.4"),
        (of_cause(probability=1.2), "cogging with probability 1.2"),
        (of_step, "is left of"),
        (of_channels, "times the mean square"),
    ],
)
def test_what_cannot_hold_together_is_told(answer: Answer, changed: Changed, told: str) -> None:
    assert any(told in text for text in contradictions(changed(answer)))
