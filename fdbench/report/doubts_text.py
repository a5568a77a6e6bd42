"""The doubts of a diagnosis: what speaks against its answer."""

import math
import re
from collections.abc import Iterator, Sequence

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.cause import EFFECT, CauseSet, FalseAlarms
from fdbench.diagnosis.answer.quantity import Quantity
from fdbench.report._text import (
    LIKELY,
    MOSTLY,
    MOVED,
    UNEXPLAINED,
    WORTH_SAYING,
    is_since_baseline,
    part_text,
    plain,
    scales_all,
    signed,
)
from fdbench.report._virtual_machines import unlike
from fdbench.rotary import spoken_words
from fdbench.wording import less, percent

SURE = 0.9
DISSENT = 0.1  # by which the force balances must prefer another effect
COUNTED = 20.0  # standard deviations beyond which those that a baseline leaves say nothing
NUMBER = re.compile(r"[-+]?\d[\d.e+-]*")


def doubts(answer: Answer) -> Iterator[str]:
    """Yield what speaks against the answer: warnings of the records, assumptions, values that moved far."""
    yield from map(spoken_words, _doubts(answer))


def _doubts(answer: Answer) -> Iterator[str]:
    yield from _once(answer.warnings)
    assumed = [name for name, floor in answer.noise_floor.items() if not floor.measured_from_repeats]
    if assumed:
        yield (
            f"The noise floor of {', '.join(assumed)} is assumed, from what the model leaves all the time: nothing was "
            "repeated. All sizes and probabilities depend on it; record each motion three times."
        )
    yield from _other_times(answer)
    if answer.shrinkage.judged_on != "held-out":
        words = answer.shrinkage.judged_on_words
        yield f"Judged on {words}: nothing is shown for other motions; give a record of one with --holdout."
    yield from _moved(answer)
    nominal, size = answer.sizes()
    if size > 1.05 * nominal > 0.0:
        yield (
            f"Re-calibration enlarges the gap that is judged on ({less(1.0 - size / nominal)}): the effects are "
            "measured from there, not from the nominal model."
        )
    found = answer.parametric
    moves = (found.moved_in_standard_deviations, found.moved_beside_effects)
    alone, beside = (math.hypot(*by.values()) for by in moves)
    named = [cause for cause in answer.causes if cause.kind == EFFECT]
    if size < (1.0 - UNEXPLAINED) * nominal and beside < 0.5 * alone and named:
        yield (
            "Re-calibration alone takes up part of what the effects do: beside them the nominal parameters hardly "
            "move, so the effects explain more of the nominal gap than re-calibration leaves to them."
        )
    for cause in (item for item in answer.causes if item.probability >= WORTH_SAYING):
        balances = cause.force_balances
        if balances and (rival := balances.instead) and rival.reduction > max(balances.reduction, 0.0) + DISSENT:
            yield (
                f"The forces that the gap asks for, whatever the controller is, speak for {rival.effect} (it "
                f"removes {part_text(rival.reduction)} of their squares) rather than for {cause.effect} "
                f"({part_text(balances.reduction)}): the controller may not be the nominal one."
            )
    sure = {cause.effect for cause in answer.causes if cause.probability >= SURE}
    for step in answer.shrinkage.steps:
        if step.beside_changes:
            yield (
                f"What friction changes by from run to run hides what {step.added} adds to one model for all: its "
                "share and its step are beside that."
            )
        elif (
            step.ci95[0] <= 0.0
            and step.added in sure
            and not scales_all(step.added)
            and step is not answer.shrinkage.steps[-1]
        ):
            yield f"What {step.added} adds shows beside what follows it: the interval of its own step includes none."
        elif step.ci95[0] <= 0.0 and not scales_all(step.added):
            yield f"What {step.added} adds may be chance: the interval of its reduction includes none."
    for name, channel in answer.gap.channels.items():
        if channel.repaired > 1.02 * channel.recalibrated:
            yield f"The gap of {plain(name)} grows with the effects; they fit the other channels."
    for cause in named:
        if typical := [plain(name) for name in cause.typical]:
            yield f"{cause.effect}: not found from the data but taken as typical: {', '.join(typical)}."
        for name in cause.at_bound:
            yield f"{cause.effect}: {name} lies on the bound of what the library allows."
    yield from unlike(answer)
    if source := answer.probabilities_from:
        tiers = sorted(set(re.findall(r"\btier ([A-Z])\b", source)))
        known = f"of tiers {', '.join(tiers)}" if tiers else f"({source})"
        yield f"Probabilities were learned on simulated axes {known}."
    if answer.false_alarms and any(cause.probability > LIKELY for cause in answer.causes):
        yield _as_sure(answer.false_alarms)
    if answer.cause_set and answer.chances():
        yield _among(answer.cause_set)
    nearly = [
        cause.effect
        for cause in answer.causes
        if not cause.parametric and all(p.ci95 is None for p in cause.parameters.values())
    ]
    if nearly:
        yield f"No intervals of the parameters of {' and '.join(nearly)}; take their digits as a guide."


def _once(warnings: Sequence[str]) -> Iterator[str]:
    """Yield each warning; what is said of several records in the same words, of the first with their number."""
    groups: dict[str, list[str]] = {}
    for text in warnings:
        groups.setdefault(NUMBER.sub("", text.partition(": ")[2] or text), []).append(text)
    for first, *others in groups.values():
        n = len(others)
        yield first + (f" The same of {n} other record{'s' if n > 1 else ''}." if others else "")


def _other_times(answer: Answer) -> Iterator[str]:
    """Yield where noise is mostly slow within the runs: sensors and loops have little of it there."""
    floor = answer.noise_floor.get("motor_force_N")
    if floor is None or not floor.measured_from_repeats or not floor.frequency:
        return
    slow, within, between = floor.frequency[0], floor.within_a_run or 0.0, floor.from_run_to_run or 0.0
    if slow.value**2 - between**2 > MOSTLY * within**2:
        yield (
            f"Most of what repeats of motor_force_N differ by is slower than {slow.band_Hz[1]:g} Hz: something acts at "
            "other times in each, such as a brake, a process or another axis, and counts as noise here. Records in "
            "which it acts at the same time would show it."
        )


def _moved(answer: Answer) -> Iterator[str]:
    """Yield which nominal parameters moved far; in their units where a baseline leaves hardly any deviation.

    Beside what is named, if there is anything: alone they may stand in for it.
    """
    beside = answer.parametric.moved_beside_effects
    is_named = any(cause.kind == EFFECT and cause.probability > LIKELY for cause in answer.causes)
    moved = beside if is_named and beside else answer.parametric.moved_in_standard_deviations
    is_since = is_since_baseline(answer.recorded)
    far = [name for name, shift in moved.items() if is_since and abs(shift) > COUNTED]
    counted = [f"{name} by {shift:+.1f}" for name, shift in moved.items() if abs(shift) > MOVED and name not in far]
    if counted:
        meaning = ": the nominal value or its [uncertainty] is doubtful"
        if is_since:
            meaning = " from one day to another: they have changed, or stand in for what has"
        yield (
            f"Re-calibration {'beside the effects ' if moved is beside else ''}moved {', '.join(counted)} standard "
            f"deviations{meaning}."
        )
    if far:
        changes = ", ".join(f"{name} by {_change(answer.parametric.changes.get(name))}" for name in far)
        yield f"Since the baseline re-calibration moved {changes}: far more than the baseline leaves in doubt."


def _change(change: Quantity | None) -> str:
    if change is None:
        return f"more than {COUNTED:.0f} standard deviations"
    return signed(change)


def _as_sure(found: FalseAlarms) -> str:
    if not found.exchangeable:
        return (
            f"More is left unexplained than on any of {found.axes} simulated axes without a cause, so how seldom these "
            "are given one says nothing of this axis."
        )
    return (
        f"Of {found.axes} simulated axes without a cause {found.as_sure} were given one as sure as the surest here. On "
        f"one that is like them this happens with a probability of at most {found.at_most:.2g}."
    )


def _among(found: CauseSet) -> str:
    if not found.exchangeable:
        return (
            f"More is left unexplained than on any of {found.axes} simulated axes with one cause, so no set of causes "
            "is promised to hold that of this axis."
        )
    held = f"with a probability of {percent(found.holds)} at least, on axes like {found.axes} simulated ones"
    if found.everything:
        return f"No effect can be left out {held}."
    if not found.causes:
        return f"One effect of the library as the cause would be among those named or suspected {held}."
    among = "among " if len(found.causes) > 1 else ""
    return f"If one effect of the library is the cause, it is {among}{', '.join(found.causes)} {held}."
