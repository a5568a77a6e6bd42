"""The answer of a diagnosis in plain words for a terminal; never more certain than the data."""

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from fdbench.diagnosis.answer import EFFECT, Answer, Cause, CauseSet, Cell, FalseAlarms, Quantity
from fdbench.diagnosis.settings import JUDGE
from fdbench.report._virtual_machines import unlike, virtual_machines
from fdbench.rotary import spoken_name, spoken_of, spoken_words
from fdbench.units import split_unit
from fdbench.wording import (
    less,
    number,
    percent,
    probability_text,
    quantity,
    scaled,
    share_interval_text,
    si_text,
    unit_text,
)

WIDTH = 100
LIKELY = 0.5
WORTH_SAYING = 0.1  # probability of a cause that is worth a sentence
UNEXPLAINED = 0.2  # share of the gap that is worth a sentence
DISSENT = 0.1  # by which the force balances must prefer another effect
NOISE_ALONE = 1.1  # mean squared gap in units of the floor that passes for noise
MOVED = 3.0  # standard deviations by which a nominal parameter may move without a remark
ROUNDING = 1e-9  # of a cell, within which an edge is at zero
MOST_CELLS, SMALLEST_SHARE, EVEN = 4, 0.05, 1.5
PARTITIONS = ("motion", "frequency", "position", "velocity", "time", "channel")


def summary(answer: Answer) -> str:
    """Return the answer as text of 15 to 40 lines.

    Parameters
    ----------
    answer : Answer

    Returns
    -------
    str
        Verdict, gap of each channel, where it lies, causes, how far it shrinks, and what speaks against all that.
    """
    with spoken_of(answer.axis):
        lines = [title(answer)]
        sections: Sequence[tuple[str, Iterator[str]]] = (
            ("Verdict", verdict(answer)),
            (f"Gap, root mean square on {answer.shrinkage.judged_on_words}", _gap(answer)),
            ("Where the re-calibrated gap lies (share of what is beyond the noise)", _where(answer)),
            ("Causes (share of the mean squared gap after re-calibration)", _causes(answer)),
            ("How far it shrinks: mean squared gap in units of the noise floor", shrinkage(answer)),
            ("Process forces, by inverse dynamics", process_forces(answer)),
            ("Virtual machines like this one", virtual_machines(answer)),
            ("Doubts", doubts(answer)),
        )
        for heading, content in sections:
            body = list(content)
            lines += [heading, *(line for text in body for line in wrapped(text))] if body else []
        return "\n".join(lines)


def wrapped(text: str) -> list[str]:
    """Return the lines of a text; a number stays with its unit."""
    depth = len(text) - len(text.lstrip())
    joined = re.sub(r"(?<=\d) (?=(?:%|[nµmkM]?(?:m|s|N|Hz)\b))", "\N{NO-BREAK SPACE}", text.strip())
    first, later = " " * (2 + depth), " " * (4 + depth)
    lines = textwrap.wrap(joined, WIDTH, initial_indent=first, subsequent_indent=later, break_on_hyphens=False)
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]


# ---- parts that the page shows too ----


def verdict(answer: Answer) -> Iterator[str]:
    """Yield the answer in one to four sentences."""
    nominal, size = answer.sizes()
    causes, unknown, none = answer.causes, answer.unknown_probability, answer.no_gap_probability
    if answer.warnings:
        yield "Read the warnings under Doubts first: what they speak of may be what is explained here."
    yield from _other_forces(answer)
    measured = any(floor.measured_from_repeats for floor in answer.noise_floor.values())
    if not measured and answer.shrinkage.judged_on != "held-out":
        yield "Nothing was repeated and no other motion held out: a first guess, whatever the probabilities say."
    if none >= LIKELY:
        if size > NOISE_ALONE:
            yield f"Too small to attribute: the mean squared gap is {size:.2f} times the noise, no more."
        elif nominal > max(NOISE_ALONE, 1.2 * size):
            yield "No gap beyond the noise once the nominal parameters are re-calibrated: no effect is missing."
        else:
            yield "No gap beyond the noise: these records show nothing that the model lacks."
        if causes:
            yield f"No cause is named; {_names(causes)} fitted a little of it, which is not to be relied on."
        return
    for cause in causes:
        rivals = cause.indistinguishable_from
        if cause.probability < WORTH_SAYING:
            continue
        share = f"{percent(cause.share)} of the mean squared gap"
        if cause.parametric:
            share = f"{percent(cause.share)} of the mean squared nominal gap"
            chance = probability_text(cause.probability)
            words = "Nominal parameter wrong" if cause.probability >= LIKELY else "Nominal parameter perhaps wrong"
            yield f"{words}: size of {cause.effect}, probability {chance}; its correction removes {share}."
            continue
        if rivals:
            names = " or ".join([cause.effect, *rivals])
            yield f"Cannot be distinguished on these data: {names}. Whichever it is explains {share}."
        else:
            probability = probability_text(cause.probability)
            words = f"Cause: {cause.effect}" if cause.probability >= LIKELY else f"Perhaps {cause.effect}"
            yield f"{words}, probability {probability}; it explains {share}."
    for suspect in answer.suspects:
        if suspect.probability >= WORTH_SAYING:
            chance = probability_text(suspect.probability)
            yield f"Perhaps {suspect.effect} too, probability {chance}: too little on these data to add it."
    if not causes:
        yield f"None of the known effects explains the gap (probability {probability_text(unknown)}).{_nearest(answer)}"
    left = answer.unexplained()
    if causes and unknown >= LIKELY:
        yield (
            f"Something else is missing too, with probability {probability_text(unknown)}: {percent(left)} of the mean "
            "squared gap is neither explained nor noise, and none of the known effects explains it."
        )
    elif causes and left > UNEXPLAINED:
        yield f"Not all: {percent(left)} of the mean squared gap is neither explained nor noise."
    if unknown >= LIKELY and answer.rest_depends_on:
        best = answer.rest_depends_on[0]
        words = best.function_of.replace("_", " ")
        where = ""
        if most := best.most:
            span = f"{most.low:.3g} and {most.high:.3g} {unit_text(most.unit)}"
            force = f"{most.force_N:+.3g} {unit_text('N')}"
            where = f", most of all between {span}, where the motor gives {force} beside the model"
        yield f"What is left depends most on {words}: a function of it would remove {percent(best.share)}{where}."


def _other_forces(answer: Answer) -> Iterator[str]:
    elsewhere = [Path(force.record).name for force in answer.process_forces if force.beside != "nominal"]
    if elsewhere:
        yield f"Of another condition and left out: {' and '.join(elsewhere)}; the force that acts there stands below."
    for force in answer.process_forces:
        if force.beside == "nominal":
            yield (
                f"A force of {si_text(force.rms_N, 'N')} rms acts in {Path(force.record).name} that does not repeat "
                "with the motion; it stands below."
            )


def process_forces(answer: Answer) -> Iterator[str]:
    """Yield what acts in each record of another condition: how large, when, at which frequency, how sure."""
    for force in answer.process_forces:
        condition = f" ({force.condition})" if force.condition else ""
        beside = {
            "repeats": "beside the records of the same command",
            "model": "beside the final model, whose own error is in it",
            "nominal": "beside the nominal model, whose own error is in it",
        }[force.beside]
        left_out = "" if force.beside == "nominal" else " The record is left out of all the rest."
        within = JUDGE.sure_of_force * force.standard_deviation_N
        if force.rms_N <= within:
            yield (f"{force.record}{condition}: no more than {si_text(within, 'N')} acts {beside}.{left_out}")
            continue
        first, last = force.range_s
        line = ""
        if force.frequency_Hz is not None and force.amplitude_N is not None:
            line = f", mostly {si_text(force.amplitude_N, 'N')} at {force.frequency_Hz:.4g} Hz"
        yield (
            f"{force.record}{condition}: a force acts that the model and the other records lack, {beside}: "
            f"{si_text(force.rms_N, 'N')} rms, {si_text(force.mean_N, 'N')} on average, "
            f"{si_text(force.largest_N, 'N')} at most{line}, from {first:.3g} to {last:.3g} s; each value is known to "
            f"{si_text(1.96 * force.standard_deviation_N, 'N')} (95 %).{left_out}"
        )


def _names(causes: Sequence[Cause]) -> str:
    return " and ".join(cause.effect for cause in causes)


def _nearest(answer: Answer) -> str:
    if answer.nearest is None:
        return ""
    reduction = percent(max(answer.nearest.reduction, 0.0))
    return f" The nearest, {answer.nearest.effect}, would remove {reduction} of it."


def title(answer: Answer) -> str:
    """Return what was diagnosed."""
    if answer.recorded is None:
        return "Gap diagnosis"
    n = answer.recorded.records
    period = si_text(answer.recorded.sampling_time_s, "s")
    since = answer.recorded.baseline
    before = (
        f", what changed since {'1 baseline record' if since == 1 else f'{since} baseline records'}" if since else ""
    )
    records = "1 record" if n == 1 else f"{n} records"
    return f"Gap diagnosis: {records}, {answer.recorded.samples} samples of {period}{before}"


def shrinkage(answer: Answer) -> Iterator[str]:
    """Yield the mean squared gap after each step, with intervals."""
    nominal, size = answer.sizes()
    shrunk = answer.shrinkage
    closed = 1.0 - size / nominal if nominal > 0.0 else 0.0
    yield f"re-calibration alone: {number(nominal)} to {number(size)}, {less(closed)}"
    for step in shrunk.steps:
        change = f"{less(step.reduction)} ({share_interval_text(step.ci95)})"
        yield f"+ {step.added}: {number(step.before)} to {number(step.after)}, {change}"
    if shrunk.steps:
        yield (
            f"all effects: {less(shrunk.total)} ({share_interval_text(shrunk.ci95)}); "
            f"{percent(shrunk.reducible_left)} of what is left is not noise"
        )


def doubts(answer: Answer) -> Iterator[str]:
    """Yield what speaks against the answer: warnings of the records, assumptions, values that moved far."""
    yield from map(spoken_words, _doubts(answer))


def _doubts(answer: Answer) -> Iterator[str]:
    yield from answer.warnings
    assumed = [name for name, floor in answer.noise_floor.items() if not floor.measured_from_repeats]
    if assumed:
        yield (
            f"The noise floor of {', '.join(assumed)} is assumed, from what the model leaves all the time: nothing was "
            "repeated. All sizes and probabilities depend on it; record each motion three times."
        )
    judged = answer.shrinkage.judged_on
    if judged != "held-out":
        motion = "the same motion again" if judged in ("held-out repeats", "held-out laps") else "the same record"
        yield f"Judged on {motion}, so nothing is shown for others; give a record of another motion with --holdout."
    moved = answer.parametric.moved_in_standard_deviations
    far = [f"{name} by {shift:+.1f}" for name, shift in moved.items() if abs(shift) > MOVED]
    if far:
        yield (
            f"Re-calibration moved {', '.join(far)} standard deviations: the nominal value or its "
            "[uncertainty] is doubtful."
        )
    nominal, size = answer.sizes()
    if size > 1.05 * nominal > 0.0:
        yield (
            f"Re-calibration enlarges the gap that is judged on ({less(1.0 - size / nominal)}): the effects are "
            "measured from there, not from the nominal model."
        )
    alone, beside = (math.hypot(*by.values()) for by in (moved, answer.parametric.moved_beside_effects))
    named = [cause for cause in answer.causes if cause.kind == EFFECT]
    if size < (1.0 - UNEXPLAINED) * nominal and beside < 0.5 * alone and named:
        yield (
            "Re-calibration alone takes up part of what the effects do: beside them the nominal parameters hardly "
            "move, so the effects explain more of the nominal gap than re-calibration leaves to them."
        )
    for cause in answer.causes:
        balances = cause.force_balances
        if balances and (rival := balances.instead) and rival.reduction > balances.reduction + DISSENT:
            yield (
                f"The forces that the gap asks for, whatever the controller is, speak for {rival.effect} (it "
                f"removes {percent(rival.reduction)} of their squares) rather than for {cause.effect} "
                f"({percent(max(balances.reduction, 0.0))}): the controller may not be the nominal one."
            )
    for step in answer.shrinkage.steps:
        if step.ci95[0] <= 0.0:
            yield f"What {step.added} adds may be chance: the interval of its reduction includes none."
    for name, channel in answer.gap.channels.items():
        if channel.repaired > 1.02 * channel.recalibrated:
            yield f"The gap of {name} grows with the effects; they fit the other channels."
    for cause in named:
        if typical := [split_unit(name)[0].replace("_", " ") for name in cause.typical]:
            yield f"{cause.effect}: not found from the data but taken as typical: {', '.join(typical)}."
        for name in cause.at_bound:
            yield f"{cause.effect}: {name} lies on the bound of what the library allows."
    yield from unlike(answer)
    if source := answer.probabilities_from:
        yield f"Probabilities were learned on simulated axes: {re.sub(', nonce [0-9a-f]+', '', source)}."
    if answer.false_alarms and any(cause.probability >= LIKELY for cause in answer.causes):
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
    held = f"with a probability of {percent(found.holds)} at least, if it is like {found.axes} simulated axes with one"
    if found.everything:
        return f"No effect can be left out {held}."
    if not found.causes:
        return f"An axis with one cause of the library would have left it among those named or suspected {held}."
    return f"One cause of the library is among {', '.join(found.causes)} {held}."


def unique(cause: Cause) -> float:
    """Return the share that a cause has on its own, no more than its share."""
    return min(float(cause.unique_share), float(cause.share))


# ---- lines of the terminal ----


def _gap(answer: Answer) -> Iterator[str]:
    for name, channel in answer.gap.channels.items():
        factor, unit = scaled(channel.unit, channel.before)
        sizes = (channel.before, channel.recalibrated, channel.repaired, channel.noise_floor)
        before, recalibrated, repaired, floor = (f"{factor * size:.3g} {unit}" for size in sizes)
        kind = "measured" if answer.noise_floor[name].measured_from_repeats else "assumed"
        yield (
            f"{split_unit(name)[0].replace('_', ' ')}: {before} nominal, {recalibrated} re-calibrated, {repaired} "
            f"repaired; noise {floor} ({kind})"
        )


def _where(answer: Answer) -> Iterator[str]:
    for words in PARTITIONS:
        cells = cells_of(answer, words)
        shown = sorted((cell for cell in cells if cell[1] >= SMALLEST_SHARE), key=lambda cell: -cell[1])
        if not shown:
            yield f"{words}: nothing beyond the noise"
        elif len(cells) > MOST_CELLS and shown[0][1] < EVEN / len(cells):
            yield f"{words}: spread evenly"
        else:
            yield f"{words}: " + ", ".join(f"{name} {percent(share)}" for name, share in shown[:MOST_CELLS])


def cells_of(answer: Answer, partition: str) -> list[tuple[str, float]]:
    """Return the cells of a partition in words, with their shares."""
    content: Mapping[str, float] | Sequence[Cell] = getattr(answer.where, partition)
    if isinstance(content, Mapping):
        return [(quantity(name)[0].replace("_", " "), share) for name, share in content.items()]
    found = []
    for cell in content:
        width = cell.bounds[1] - cell.bounds[0]
        low, high = (0.0 if abs(edge) < ROUNDING * width else edge for edge in cell.bounds)
        scale, prefixed = scaled(quantity(cell.edges)[1], max(abs(low), abs(high)))
        found.append((f"{scale * low:.3g} to {scale * high:.3g} {prefixed}", cell.share))
    return found


def _causes(answer: Answer) -> Iterator[str]:
    for cause in answer.causes:
        values = [
            parameter_text(name, value) + (" (typical)" if name in cause.typical else "")
            for name, value in cause.parameters.items()
        ]
        share = f"share {percent(cause.share)}, of which no other named effect explains {percent(unique(cause))}"
        yield f"{cause.effect}{', a nominal parameter' if cause.parametric else ''}: {share}"
        yield "  " + "; ".join(values)
        if other := cause.instead:
            removed = f"{percent(max(other.reduction, 0.0))} instead of {percent(other.reduction_of_named or 0.0)}"
            yield f"  in its place {other.effect} would remove {removed} of the held-out misfit"
    experiment = answer.next_experiment
    if experiment is not None:
        yield f"Next experiment, to separate {' from '.join(experiment.to_separate)}: {experiment.trajectory}"


def parameter_text(name: str, entry: Quantity) -> str:
    """Return a parameter of a cause with its unit and, where there is one, its interval."""
    words = split_unit(spoken_name(name))[0].replace("_", " ")
    if entry.ci95 is None:
        return f"{words} {si_text(entry.value, entry.unit)}"
    low, high = entry.ci95
    factor, prefixed = scaled(entry.unit, max(abs(entry.value), 0.5 * (high - low)))
    text = f"{words} {factor * entry.value:.3g} {prefixed}".rstrip()
    return f"{text} (95 %: {factor * low:.3g} to {factor * high:.3g} {prefixed})".replace(" )", ")")
