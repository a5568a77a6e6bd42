"""The answer of a diagnosis in plain words for a terminal; never more certain than the data."""

from collections.abc import Iterator, Mapping, Sequence

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.cause import Cause
from fdbench.diagnosis.answer.quantity import Quantity
from fdbench.diagnosis.answer.where import Cell
from fdbench.report._text import AFTER, BESIDE_CHANGES, LIKELY, NOISE_ALONE, NOMINAL, part_text, plain, wrapped
from fdbench.report._virtual_machines import virtual_machines
from fdbench.report.doubts_text import doubts
from fdbench.report.process_forces_text import process_forces
from fdbench.report.verdict_text import verdict
from fdbench.rotary import spoken_name, spoken_of
from fdbench.wording import less, number, percent, probability_text, quantity, scaled, si_text

ROUNDING = 1e-9  # of a cell, within which an edge is at zero
MOST_CELLS, SMALLEST_SHARE, EVEN = 4, 0.05, 1.5
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


# ---- parts that the page shows too ----


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
        change = less(step.reduction, step.ci95)
        beside = f", {BESIDE_CHANGES}" if step.beside_changes else ""
        yield f"+ {step.added}: {number(step.before)} to {number(step.after)}, {change}{beside}"
    if shrunk.steps:
        yield (
            f"all effects: {less(shrunk.total, shrunk.ci95)}; "
            f"{percent(shrunk.reducible_left)} of what is left is not noise"
        )


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
            f"{plain(name)}: {before} nominal, {recalibrated} re-calibrated, {repaired} "
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


def parameter_text(name: str, entry: Quantity) -> str:
    """Return a parameter of a cause with its unit and, where there is one, its interval."""
    words = plain(spoken_name(name))
    if entry.ci95 is None:
        return f"{words} {si_text(entry.value, entry.unit)}"
    low, high = entry.ci95
    factor, prefixed = scaled(entry.unit, max(abs(entry.value), 0.5 * (high - low)))
    text = f"{words} {factor * entry.value:.3g} {prefixed}".rstrip()
    return f"{text} (95 %: {factor * low:.3g} to {factor * high:.3g} {prefixed})".replace(" )", ")")
