"""No answer contradicts itself; an answer that is made to is caught."""

import dataclasses
from collections.abc import Callable

import pytest
from axis_lab import case

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.diagnose import diagnose
from fdbench.effects import effects
from fdbench.report.diagnosis_text import summary
from fdbench.trials.contradictions import contradictions, contradictions_in_words

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
    assert list(contradictions_in_words(summary(answer))) == []


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


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Cause: cogging. Not all: 112 % of the mean squared gap is neither explained nor noise.", "112 %"),
        ("in its place backlash would remove 79 % instead of 110 % of\n  the held-out misfit", "instead of 110 %"),
        ("in its place backlash would remove 109 % instead of 98 % of the held-out misfit", "remove 109 %"),
        ("Verdict Something else is missing too, with probability 0.97", "nothing before"),
        ("Verdict Perhaps backlash too, probability 0.20", "nothing before"),
        (
            "No cause is named; dead_time and coulomb_friction fitted a little of it. Causes dead_time: share 4 %, "
            "coulomb_friction, a nominal parameter: share 99 %",
            "coulomb_friction fitted a little, and its share is 99 %",
        ),
    ],
)
def test_words_that_cannot_stand_together_are_told(text: str, told: str) -> None:
    (found,) = contradictions_in_words(text)
    assert told in found


def test_words_that_can_stand_together_are_left_alone() -> None:
    text = (
        "Cause: cogging, probability 0.9; it explains 100 % of the mean squared gap. Something else is missing too. No "
        "cause is named; dead_time fitted a little of it. dead_time: share 4 %. "
        "re-calibration alone: 265 to 561, 112 % more"
    )
    assert list(contradictions_in_words(text)) == []
