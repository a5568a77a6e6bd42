"""Every registered effect holds the shared checks; one stepper of the whole library serves them all."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import final

import pytest

from fdbench.checks import _own_record
from fdbench.checks._own_record import is_named_first
from fdbench.checks._report import NotApplicable, run_checks
from fdbench.checks.check_effect import CHECKS, CheckedEffect, EffectBench, check_effect, is_documented
from fdbench.effects._effect import Effect, Port, effects, kernel, parameter
from fdbench.errors import PluginError

NAMES = effects.names()


@pytest.fixture(scope="module")
def bench() -> EffectBench:
    return EffectBench([effects.get(name) for name in NAMES])


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", NAMES)
def test_effect(name: str, check: Callable[[CheckedEffect], None], bench: EffectBench) -> None:
    case = CheckedEffect(effects.get(name), bench)
    if check.__name__ in case.cls.expected_failures:
        with pytest.raises(PluginError):
            check(case)
    else:
        check(case)


def test_expected_failures_are_checks_and_have_reasons() -> None:
    known = {*(check.__name__ for check in CHECKS), is_named_first.__name__}
    for name in NAMES:
        for check, reason in effects.get(name).expected_failures.items():
            assert check in known, name
            assert reason.strip(), name


def test_effects_that_are_confused_with_each_other_name_each_other() -> None:
    for name in NAMES:
        for other in effects.get(name).confusable_with:
            assert name in effects.get(other).confusable_with, f"{other} does not name {name}"


def test_an_effect_can_be_checked_alone() -> None:
    lines = check_effect(effects.get("constant_force"))
    assert [line.split(":")[0] for line in lines] == [*(check.__name__ for check in CHECKS), "is_named_first"]
    assert lines[-1] == "is_named_first: ok"


def test_what_a_diagnosis_does_not_look_for_is_said() -> None:
    with pytest.raises(NotApplicable, match="a process force of unknown course"):
        is_named_first(effects.get("step_force"))
    assert run_checks("x", [("own", partial(is_named_first, effects.get("step_force")))]) == [
        "own: does not apply (a diagnosis does not look for it: it is a process force of unknown course)"
    ]


@pytest.mark.parametrize(
    ("causes", "message"),
    [
        ((), r"it is not named; probabilities: none; unknown cause 0\.30; no gap 0\.60\."),
        (((0.2, "cogging", ()),), r"it is not named; probabilities: cogging 0\.20; unknown"),
        (
            ((0.9, "cogging", ("lead_error",)), (0.8, "backlash", ())),
            r"cogging comes first; probabilities: cogging 0\.9",
        ),
        (((0.9, "cogging", ("backlash",)),), None),
        (((0.9, "backlash", ()), (0.9, "cogging", ())), None),
    ],
)
def test_what_came_first_instead_is_said(
    causes: tuple[tuple[float, str, tuple[str, ...]], ...], message: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = [SimpleNamespace(probability=p, effect=name, indistinguishable_from=same) for p, name, same in causes]
    answer = SimpleNamespace(causes=said, unknown_probability=0.3, no_gap_probability=0.6)
    monkeypatch.setattr(_own_record, "recorded", lambda *_: ([], []))
    monkeypatch.setattr(_own_record, "diagnose", lambda *_: SimpleNamespace(answer=answer))
    with nullcontext() if message is None else pytest.raises(PluginError, match=message):
        is_named_first(effects.get("backlash"))


@final
@dataclass(frozen=True, kw_only=True)
class Faulty(Effect):
    """Says too little."""

    name = "faulty"
    port = Port.TABLE_FORCE
    amplitude = "pull_N"

    pull_N: float = parameter("P", low=0.0, high=1.0, typical=2.0)
    reach_mm: float = parameter("R", low=1.0, high=2.0, typical=1.0)

    @kernel
    def kernel(t, h, x, v, u, P, R):
        return 1.0 + P / (v - v), -R


@final
@dataclass(frozen=True, kw_only=True)
class Misnamed(Effect):
    """Says nothing about p."""

    name = "misnamed"
    port = Port.TABLE_FORCE
    amplitude = "push_N"

    pull_N: float = parameter("P", low=0.0, high=1.0, typical=1.0)

    @kernel
    def kernel(t, h, x, v, u, p):
        return 0.0, 0.0


@pytest.mark.parametrize(
    ("cls", "check", "message"),
    [
        (Misnamed, "declares_what_the_kernel_takes", r"the kernel takes \(t, h, x, v, u, p\), but .* u, P\)"),
        (Faulty, "has_bounds_around_its_typical_size", r"pull_N: 2 is outside its bounds \[0, 1\]"),
        (Faulty, "carries_units", "reach_mm looks as if it had a unit"),
        (Faulty, "is_documented", "the docstring lacks '.. math::'"),
        (Faulty, "returns_finite_values", "the kernel returns"),
    ],
)
def test_a_faulty_effect_is_told_what_is_wrong(cls: type[Effect], check: str, message: str, bench: EffectBench) -> None:
    with pytest.raises(PluginError, match=message):
        next(item for item in CHECKS if item.__name__ == check)(CheckedEffect(cls, bench))


def test_a_wrong_example_is_shown(monkeypatch: pytest.MonkeyPatch, bench: EffectBench) -> None:
    text = "\n".join((".. math:: F = 0", "Source: none.", "", ">>> 1 + 1", "3"))
    monkeypatch.setattr(Misnamed, "__doc__", text)
    with pytest.raises(PluginError, match=r"the example in the docstring is wrong(.|\n)*Expected:\s+3\s+Got:\s+2"):
        is_documented(CheckedEffect(Misnamed, bench))
