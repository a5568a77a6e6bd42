"""The answer of a diagnosis in plain words for a terminal; never more certain than the data."""

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from fdbench.diagnosis.answer import (
    EFFECT,
    Answer,
    Cause,
    CauseSet,
    Cell,
    Dependence,
    FalseAlarms,
    ProcessForce,
    Quantity,
    Recorded,
)
from fdbench.diagnosis.model.known_effects import OFFSET
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import effects
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
SURE = 0.9
MOSTLY = 0.5  # share of the noise within a run that is most of it
WORTH_SAYING = 0.1  # probability of a cause that is worth a sentence
UNEXPLAINED = 0.2  # share of the gap that is worth a sentence
DISSENT = 0.1  # by which the force balances must prefer another effect
UNSEEN = 0.005  # share of the gap that rounds to none
NOISE_ALONE = 1.1  # mean squared gap in units of the floor that passes for noise
MOVED = 3.0  # standard deviations by which a nominal parameter may move without a remark
COUNTED = 20.0  # standard deviations beyond which those that a baseline leaves say nothing
ROUNDING = 1e-9  # of a cell, within which an edge is at zero
MOST_CELLS, SMALLEST_SHARE, EVEN = 4, 0.05, 1.5
AFTER, NOMINAL = "mean squared gap after re-calibration", "mean squared nominal gap"
BESIDE_CHANGES = "beside what friction changes by from run to run"
SMALL = 0.02  # of the motor's force, below which a machine that is well may have as much
NUMBER = re.compile(r"[-+]?\d[\d.e+-]*")
PARTITIONS = ("motion", "frequency", "position", "velocity", "time", "channel")


def summary(answer: Answer) -> str:
    """Return the answer as text of 15 to 45 lines.

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
            (f"Causes (share of the {AFTER})", _causes(answer)),
            (f"Nominal parameters (share of the {NOMINAL})", _nominal_parameters(answer)),
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
    if set(answer.warnings) - set(answer.assumptions):
        yield "Read the warnings under Doubts first: what they speak of may be what is explained here."
    yield from _other_forces(answer)
    measured = any(floor.measured_from_repeats for floor in answer.noise_floor.values())
    if not measured and answer.shrinkage.judged_on != "held-out":
        yield "Nothing was repeated and no other motion held out: a first guess, whatever the probabilities say."
    yield from _set_anew(answer)
    if answer.no_gap_probability >= LIKELY:
        yield from _nothing(answer)
        yield from _changed_values(answer)
        return
    said = [cause for cause in answer.causes if cause.probability >= WORTH_SAYING and not _is_nothing(cause)]
    yield from (_named(cause, answer) for cause in said)
    for suspect in answer.suspects:
        if suspect.probability >= WORTH_SAYING:
            words = (
                f"Perhaps {suspect.effect}{' too' if said else ''}, probability {probability_text(suspect.probability)}"
            )
            yield f"{words}: too little on these data to add it."
    yield from _left(answer) if said else _unknown(answer)
    yield from _changed_values(answer)
    if answer.unknown_probability >= LIKELY and answer.rest_depends_on:
        yield _dependence(answer.rest_depends_on[0])


def _is_nothing(cause: Cause) -> bool:
    """Return whether a cause that is not likely explains nothing to speak of."""
    return cause.probability <= LIKELY and cause.share < UNSEEN


def _nothing(answer: Answer) -> Iterator[str]:
    nominal, size = answer.sizes()
    if size > JUDGE.measurable and all(floor.measured_from_repeats for floor in answer.noise_floor.values()):
        yield (
            f"No cause to tell: the mean squared gap is {size:.2f} times what repeats differed by, which the form of a "
            "model may leave of an axis that is well, and no known effect takes enough of it."
        )
    elif size > NOISE_ALONE:
        yield f"Too small to attribute: the mean squared gap is {size:.2f} times the noise, no more."
    elif nominal > max(NOISE_ALONE, 1.2 * size):
        text = "No gap beyond the noise once the nominal parameters are re-calibrated: no effect is missing"
        yield f"{text}{_unless(answer)}."
    else:
        yield "No gap beyond the noise: these records show nothing that the model lacks."
    values = [cause for cause in answer.causes if cause.parametric and cause.probability >= WORTH_SAYING]
    yield from (_named(cause, answer) for cause in values)
    if answer.causes:
        yield f"No cause is named: what was fitted, {_names(answer.causes)}, is less probable than that."


def _unless(answer: Answer) -> str:
    """Return which values that moved far may stand in for an effect, where none of them is told to be wrong."""
    if _is_since(answer.recorded) or any(cause.parametric and cause.probability > LIKELY for cause in answer.causes):
        return ""
    moved = answer.parametric.moved_in_standard_deviations
    far = [f"{name} by {shift:+.1f}" for name, shift in moved.items() if abs(shift) > MOVED]
    return f", unless what moved far stands in for one: {', '.join(far)} standard deviations" if far else ""


def _set_anew(answer: Answer) -> Iterator[str]:
    """Yield which gains of the controller somebody has changed since the baseline."""
    if gains := answer.parametric.set_anew:
        changes = " and ".join(f"{name} by {_signed(change)}" for name, change in gains.items())
        yield f"The controller was set anew since the baseline: {changes}. All that follows is beside the new setting."


def _changed_values(answer: Answer) -> Iterator[str]:
    """Yield which values have changed since the baseline where that closes most of the gap, and is named by nobody."""
    changed, closed = answer.parametric.values, answer.parametric.closed_by_recalibration
    is_named = any(cause.probability > LIKELY for cause in answer.causes)
    if changed and _is_since(answer.recorded) and closed >= MOSTLY and not is_named:
        sizes = ", ".join(f"{name} by {_signed(change)}" for name, change in changed.items())
        yield f"Most of what has changed is a size: {sizes}. Re-calibration alone closes {percent(closed)} of the gap."


def _is_since(recorded: Recorded | None) -> bool:
    return recorded is not None and recorded.baseline > 0


def _named(cause: Cause, answer: Answer) -> str:
    """Return what is said of a cause, and of what its share is."""
    recorded = answer.recorded
    chance, likely = f"probability {probability_text(cause.probability)}", cause.probability > LIKELY
    if cause.parametric:
        removes = f"its correction removes {percent(cause.share)} of the {NOMINAL}"
        said = f"{_wrong(cause, likely, recorded)}, {chance}; {removes}."
        others = sorted(cause.alternatives.items(), key=lambda item: -item[1])
        words = [f"{name}, probability {probability_text(p)}" for name, p in others if p >= WORTH_SAYING]
        known = "before" if _is_since(recorded) else "on paper"
        return f"{said} Or it is {', or '.join(words)}, and the value as {known}." if words else said
    share = f"{percent(cause.share)} of the {AFTER}{f', {BESIDE_CHANGES}' if cause.beside_changes else ''}"
    if cause.indistinguishable_from:
        names = " or ".join([cause.effect, *cause.indistinguishable_from])
        together = cause.probability + sum(cause.alternatives.get(name, 0.0) for name in cause.indistinguishable_from)
        chance = f"probability together {probability_text(together)}"
        return f"Cannot be distinguished on these data: {names}, {chance}. Whichever it is explains {share}."
    first = "Cause:" if likely else "Perhaps"
    taken_for = f"re-calibration alone takes it for {_sizes(answer)}, beyond which " if _scales(cause.effect) else ""
    return f"{first} {cause.effect}, {chance}; {taken_for}it explains {share}.{_small(cause, recorded)}"


def _scales(effect: str) -> bool:
    """Return whether an effect changes every size of a model alike, so that re-calibration hides it."""
    return effect in effects.names() and effects.get(effect).scales_every_value


def _sizes(answer: Answer) -> str:
    """Return by how much which values seem to have changed."""
    changes = (f"{name} by {_signed(change)}" for name, change in answer.parametric.values.items())
    return f"another size of {', '.join(changes)}" if answer.parametric.values else "other sizes"


def _small(cause: Cause, recorded: Recorded | None) -> str:
    """Return how small a force is beside the motor's, where it is so small that quiet records alone show it."""
    force = None if recorded is None else recorded.force
    own = cause.parameters.get(effects.get(cause.effect).amplitude) if cause.effect in effects.names() else None
    if own is None or force is None or own.unit != force.unit or abs(own.value) >= SMALL * force.value:
        return ""
    return (
        f" It is small, {si_text(abs(own.value), own.unit)} beside {si_text(force.value, force.unit)} of the motor "
        "(root mean square): on a machine that is well these records might show as much."
    )


def _wrong(cause: Cause, likely: bool, recorded: Recorded | None) -> str:
    """Return which nominal parameter is wrong or has changed; a constant force is none that a model must have."""
    change = cause.parameters.get("change")
    if change and cause.effect in effects.names() and effects.get(cause.effect).calibrates == OFFSET:
        words = f"{cause.effect.replace('_', ' ')} of {si_text(change.value, change.unit)}"
        return f"{'A' if likely else 'Perhaps a'} {words} acts beyond what the model has"
    if _is_since(recorded):
        by = f", by {_signed(change)}" if change else ""
        return f"{'Changed' if likely else 'Perhaps changed'} since the baseline: size of {cause.effect}{by}"
    size = f", off by {_signed(change)}" if change else ""
    return f"Nominal parameter {'' if likely else 'perhaps '}wrong: size of {cause.effect}{size}"


def _unknown(answer: Answer) -> Iterator[str]:
    """Yield what is said where no cause is probable enough to be told."""
    if answer.unknown_probability < LIKELY:
        none, unknown = map(probability_text, (answer.no_gap_probability, answer.unknown_probability))
        yield f"Undecided: no effect is missing (probability {none}), or one that is not known (probability {unknown})."
        if answer.no_gap_probability + answer.unknown_probability < LIKELY:
            yield "Else the machine changes from one motion to another by more than its repeats differ by."
        return
    text = f"None of the known effects explains the gap (probability {probability_text(answer.unknown_probability)})."
    if answer.causes:
        yield f"{text} Fitted, but improbable: {_names(answer.causes)}."
    else:
        yield f"{text}{_nearest(answer)}"


def _left(answer: Answer) -> Iterator[str]:
    """Yield what the causes leave, where that is worth a sentence."""
    unknown, left = answer.unknown_probability, answer.unexplained()
    size, rest = answer.sizes()[1], f"{percent(left)} of the {AFTER} is neither explained nor noise"
    if answer.left() > size:
        more = percent(answer.left() / size - 1.0)
        rest = f"the effects make the {AFTER} {more} larger in all on {answer.shrinkage.judged_on_words}"
    if unknown >= LIKELY and answer.left() <= size and left < UNSEEN:
        yield (
            f"Something else may be missing, too (probability {probability_text(unknown)}), though no more than noise "
            f"is left on {answer.shrinkage.judged_on_words}."
        )
    elif unknown >= LIKELY:
        yield (
            f"Something else is missing too, with probability {probability_text(unknown)}: {rest}, and none of the "
            "known effects explains more."
        )
    elif left > UNEXPLAINED:
        yield f"Not all: {rest}."


def _dependence(best: Dependence) -> str:
    where = ""
    if most := best.most:
        span = f"{most.low:.3g} and {most.high:.3g} {unit_text(most.unit)}"
        force = f"{most.force_N:+.3g} {unit_text('N')}"
        where = f", most of all between {span}, where the motor gives {force} beside the model"
    words = best.function_of.replace("_", " ")
    return f"What is left depends most on {words}: a function of it would remove {percent(best.share)}{where}."


def _other_forces(answer: Answer) -> Iterator[str]:
    found = forces(answer)
    elsewhere = [Path(force.record).name for force in found if force.beside != "nominal"]
    if elsewhere:
        yield f"Of another condition and left out: {' and '.join(elsewhere)}; the force that acts there stands below."
    for force in found:
        if force.beside == "nominal":
            yield (
                f"A force of {si_text(force.rms_N, 'N')} rms acts in {Path(force.record).name} that does not repeat "
                "with the motion; it stands below."
            )


def forces(answer: Answer) -> list[ProcessForce]:
    """Return one force for each record, not that beside the nominal model where there is a better one."""
    apart = {force.record for force in answer.process_forces if force.beside != "nominal"}
    return [force for force in answer.process_forces if force.beside != "nominal" or force.record not in apart]


def process_forces(answer: Answer) -> Iterator[str]:
    """Yield what acts in each record of another condition: how large, when, at which frequency, how sure."""
    for force in forces(answer):
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
            sine = (
                f"{si_text(force.amplitude_N, 'N')} amplitude ({si_text(force.amplitude_N / math.sqrt(2.0), 'N')} rms)"
            )
            line = f", its strongest line a sine of {sine} at {force.frequency_Hz:.3g} Hz"
        yield (
            f"{force.record}{condition}: a force acts that the model and the other records lack, {beside}: "
            f"from {first:.3g} to {last:.3g} s {si_text(force.rms_N, 'N')} rms, {si_text(force.mean_N, 'N')} on "
            f"average, {si_text(force.largest_N, 'N')} at most{line}; each value is known to "
            f"{si_text(1.96 * force.standard_deviation_N, 'N')} (95 %).{left_out}"
        )


def _names(causes: Sequence[Cause]) -> str:
    return " and ".join(cause.effect for cause in causes)


def _nearest(answer: Answer) -> str:
    if answer.nearest is None:
        return ""
    if answer.nearest.reduction < UNSEEN:
        return " None of them would remove any of it."
    return f" The nearest, {answer.nearest.effect}, would remove {part_text(answer.nearest.reduction)} of it."


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
        beside = f", {BESIDE_CHANGES}" if step.beside_changes else ""
        yield f"+ {step.added}: {number(step.before)} to {number(step.after)}, {change}{beside}"
    if shrunk.steps:
        yield (
            f"all effects: {less(shrunk.total)} ({share_interval_text(shrunk.ci95)}); "
            f"{percent(shrunk.reducible_left)} of what is left is not noise"
        )


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
            and not _scales(step.added)
            and step is not answer.shrinkage.steps[-1]
        ):
            yield f"What {step.added} adds shows beside what follows it: the interval of its own step includes none."
        elif step.ci95[0] <= 0.0 and not _scales(step.added):
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
    is_since = _is_since(answer.recorded)
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
    return _signed(change)


def _signed(change: Quantity) -> str:
    text = si_text(change.value, change.unit) if change.unit else percent(change.value)
    return text if change.value < 0.0 else f"+{text}"


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
    if is_noise_alone(answer):
        yield "nothing beyond the noise"
        return
    for words in PARTITIONS:
        cells = cells_of(answer, words)
        shown = sorted((cell for cell in cells if cell[1] >= SMALLEST_SHARE), key=lambda cell: -cell[1])
        if not shown:
            yield f"{words}: nothing beyond the noise"
        elif len(cells) > MOST_CELLS and shown[0][1] < EVEN / len(cells):
            yield f"{words}: spread evenly"
        else:
            yield f"{words}: " + ", ".join(f"{name} {percent(share)}" for name, share in shown[:MOST_CELLS])


def is_noise_alone(answer: Answer) -> bool:
    """Return whether a gap is noise alone, so that no place has a share of it."""
    return answer.no_gap_probability >= LIKELY and answer.sizes()[1] <= NOISE_ALONE


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
        if cause.parametric:
            continue
        yield (
            f"{_with_probability(cause)}, share {percent(cause.share)}, of which no other named effect explains "
            f"{percent(unique(cause))}{f'; both {BESIDE_CHANGES}' if cause.beside_changes else ''}"
        )
        yield _values(cause)
        if cause.within_known:
            yield "  no cause: how the known friction turns its sign, or as much as that is in doubt by"
        if other := cause.instead:
            removed = f"{part_text(other.reduction)} instead of {part_text(other.reduction_of_named or 0.0)}"
            yield f"  in its place {other.effect} would remove {removed} of the held-out misfit"
    experiment = answer.next_experiment
    if experiment is not None:
        yield f"Next experiment, to separate {' from '.join(experiment.to_separate)}: {experiment.trajectory}"


def _nominal_parameters(answer: Answer) -> Iterator[str]:
    for cause in answer.causes:
        if cause.parametric:
            yield f"{_with_probability(cause)}, share {percent(cause.share)}"
            yield _values(cause)


def _with_probability(cause: Cause) -> str:
    return f"{cause.effect}: probability {probability_text(cause.probability)}"


def _values(cause: Cause) -> str:
    typical = dict.fromkeys(cause.typical, " (typical)")
    values = (parameter_text(name, value) + typical.get(name, "") for name, value in cause.parameters.items())
    return "  " + "; ".join(values)


def part_text(reduction: float) -> str:
    """Return a share that is removed; more than all, as of what is beyond the noise alone, is all.

    >>> part_text(1.1), part_text(0.79), part_text(-0.2)
    ('all', '79 %', '0 %')
    """
    return "all" if reduction >= 1.0 else percent(max(reduction, 0.0))


def parameter_text(name: str, entry: Quantity) -> str:
    """Return a parameter of a cause with its unit and, where there is one, its interval."""
    words = split_unit(spoken_name(name))[0].replace("_", " ")
    if entry.ci95 is None:
        return f"{words} {si_text(entry.value, entry.unit)}"
    low, high = entry.ci95
    factor, prefixed = scaled(entry.unit, max(abs(entry.value), 0.5 * (high - low)))
    text = f"{words} {factor * entry.value:.3g} {prefixed}".rstrip()
    return f"{text} (95 %: {factor * low:.3g} to {factor * high:.3g} {prefixed})".replace(" )", ")")
