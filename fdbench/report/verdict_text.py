"""The verdict of a diagnosis: its answer in one to four sentences."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from scipy.constants import g

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.cause import Cause
from fdbench.diagnosis.answer.quantity import Quantity
from fdbench.diagnosis.answer.recorded import Recorded
from fdbench.diagnosis.answer.where import Dependence
from fdbench.diagnosis.model.axis_parameters import Mass
from fdbench.diagnosis.model.known_effects import OFFSET
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import effects
from fdbench.report._text import (
    AFTER,
    BESIDE_CHANGES,
    LIKELY,
    MOSTLY,
    MOVED,
    NOISE_ALONE,
    NOMINAL,
    UNEXPLAINED,
    WORTH_SAYING,
    is_since_baseline,
    part_text,
    plain,
    scales_all,
    signed,
)
from fdbench.report.process_forces_text import forces
from fdbench.wording import percent, probability_text, si_text, unit_text

UNSEEN = 0.005  # share of the gap that rounds to none
AS_HEAVY = 0.1  # relative difference of a force and the weight of a mass that may be one payload
SMALL = 0.02  # of the motor's force, below which a machine that is well may have as much


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
    yield from _payload(said)
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
            f"No cause to tell: the mean squared gap is {size:.2f} times the noise of the mean of its repeats, which "
            "friction that differs from run to run and the form of a model may leave of an axis that is well, and no "
            "known effect takes enough of it."
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
    is_told = any(cause.parametric and cause.probability > LIKELY for cause in answer.causes)
    if is_told or is_since_baseline(answer.recorded):
        return ""
    moved = answer.parametric.moved_in_standard_deviations
    far = [f"{name} by {shift:+.1f}" for name, shift in moved.items() if abs(shift) > MOVED]
    return f", unless what moved far stands in for one: {', '.join(far)} standard deviations" if far else ""


def _set_anew(answer: Answer) -> Iterator[str]:
    """Yield which gains of the controller somebody has changed since the baseline."""
    if gains := answer.parametric.set_anew:
        changes = " and ".join(_by(gains))
        yield f"The controller was set anew since the baseline: {changes}. All that follows is beside the new setting."


def _changed_values(answer: Answer) -> Iterator[str]:
    """Yield which values have changed since the baseline where that closes most of the gap, and is named by nobody."""
    changed, closed = answer.parametric.values, answer.parametric.closed_by_recalibration
    is_named = any(cause.probability > LIKELY for cause in answer.causes)
    if changed and is_since_baseline(answer.recorded) and closed >= MOSTLY and not is_named:
        sizes = ", ".join(_by(changed))
        yield f"Most of what has changed is a size: {sizes}. Re-calibration alone closes {percent(closed)} of the gap."


def _named(cause: Cause, answer: Answer) -> str:
    """Return what is said of a cause, and of what its share is."""
    recorded = answer.recorded
    chance, likely = f"probability {probability_text(cause.probability)}", cause.probability > LIKELY
    if cause.parametric:
        removes = f"its correction removes {percent(cause.share)} of the {NOMINAL}"
        said = f"{_wrong(cause, likely, recorded)}, {chance}; {removes}."
        others = sorted(cause.alternatives.items(), key=lambda item: -item[1])
        words = [f"{name}, probability {probability_text(p)}" for name, p in others if p >= WORTH_SAYING]
        known = "before" if is_since_baseline(recorded) else "on paper"
        return f"{said} Or it is {', or '.join(words)}, and the value as {known}." if words else said
    share = f"{percent(cause.share)} of the {AFTER}{f', {BESIDE_CHANGES}' if cause.beside_changes else ''}"
    if cause.indistinguishable_from:
        names = " or ".join([cause.effect, *cause.indistinguishable_from])
        together = cause.probability + sum(cause.alternatives.get(name, 0.0) for name in cause.indistinguishable_from)
        chance = f"probability together {probability_text(together)}"
        return f"Cannot be distinguished on these data: {names}, {chance}. Whichever it is explains {share}."
    first = "Cause:" if likely else "Perhaps"
    sizes = f"another size of {', '.join(_by(answer.parametric.values))}" if answer.parametric.values else "other sizes"
    taken_for = f"re-calibration alone takes it for {sizes}, beyond which " if scales_all(cause.effect) else ""
    return f"{first} {cause.effect}, {chance}; {taken_for}it explains {share}.{_small(cause, recorded)}"


def _by(changes: Mapping[str, Quantity]) -> list[str]:
    """Return by how much each value has changed, or seems to have."""
    return [f"{name} by {signed(change)}" for name, change in changes.items()]


def _payload(said: Sequence[Cause]) -> Iterator[str]:
    """Yield that a mass and a force are one cause, where the force is the weight of the mass."""
    likely = (cause for cause in said if cause.probability > LIKELY)
    changed = {_corrected(cause): next(iter(cause.parameters.values()), None) for cause in likely}
    mass, force = changed.get(Mass.kind), changed.get(OFFSET)
    if mass is None or force is None or (mass.unit, force.unit) != ("kg", "N"):
        return
    weight_N = abs(mass.value) * g
    if abs(abs(force.value) - weight_N) < AS_HEAVY * weight_N:
        yield f"A mass of {signed(mass)} weighs {si_text(weight_N, 'N')}: on a vertical axis both are one payload."


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
    if change and _corrected(cause) == OFFSET:
        words = f"{cause.effect.replace('_', ' ')} of {si_text(change.value, change.unit)}"
        return f"{'A' if likely else 'Perhaps a'} {words} acts beyond what the model has"
    what = f"mass ({cause.effect})" if _corrected(cause) == Mass.kind else f"size of {cause.effect}"
    if is_since_baseline(recorded):
        by = f", by {signed(change)}" if change else ""
        return f"{'Changed' if likely else 'Perhaps changed'} since the baseline: {what}{by}"
    size = f", off by {signed(change)}" if change else ""
    return f"Nominal parameter {'' if likely else 'perhaps '}wrong: {what}{size}"


def _corrected(cause: Cause) -> str:
    """Return the kind of nominal parameter that a cause corrects, or an empty text."""
    return effects.get(cause.effect).calibrates if cause.effect in effects.names() else ""


def _unknown(answer: Answer) -> Iterator[str]:
    """Yield what is said where no cause is probable enough to be told."""
    if answer.unknown_probability < LIKELY:
        none, unknown = map(probability_text, (answer.no_gap_probability, answer.unknown_probability))
        yield f"Undecided: no effect is missing (probability {none}), or one that is not known (probability {unknown})."
        if answer.no_gap_probability + answer.unknown_probability < LIKELY:
            yield "Else the machine changes from one motion to another by more than its repeats differ by."
        return
    text = f"None of the known effects explains the gap (probability {probability_text(answer.unknown_probability)})."
    values, closed = answer.parametric.nameless, answer.parametric.closed_by_recalibration
    if values and closed >= MOSTLY and not is_since_baseline(answer.recorded):
        sizes = " and ".join(_by(values))
        yield f"{text} Values that none stands for seem to differ: {sizes}; with them {percent(closed)} is closed."
    elif answer.causes:
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
        channels = answer.gap.channels
        grown = [name for name, channel in channels.items() if channel.repaired > channel.recalibrated]
        if 0 < len(grown) < len(channels):
            rest += f", as they do not fit {' and '.join(map(plain, grown))}"
    if unknown >= LIKELY and answer.left() <= size and left < UNSEEN:
        little = "no more than noise" if answer.shrinkage.reducible_left < LIKELY else f"{percent(left)} of that gap"
        yield (
            f"Something else may be missing, too (probability {probability_text(unknown)}), though {little} is left on "
            f"{answer.shrinkage.judged_on_words}."
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


def _names(causes: Sequence[Cause]) -> str:
    return " and ".join(cause.effect for cause in causes)


def _nearest(answer: Answer) -> str:
    if answer.nearest is None:
        return ""
    if answer.nearest.reduction < UNSEEN:
        return " None of them would remove any of it."
    return f" The nearest, {answer.nearest.effect}, would remove {part_text(answer.nearest.reduction)} of it."
