"""What the pages of a diagnosis and of its answer alone share: the answer, where the gap lies, causes, shrinkage."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.experiment import Experiment
from fdbench.diagnosis.answer.quantity import Pair, Quantity
from fdbench.diagnosis.answer.where import Cell, Where
from fdbench.report import diagnosis_text, doubts_text, verdict_text
from fdbench.report._bars import bars, dots
from fdbench.report._figures import BEFORE, Band, Curve, Figure, Panel
from fdbench.report._page import Block, Grid, Section, breakable, folded, note, paragraph, table
from fdbench.report._templates import Html, part
from fdbench.report._text import LIKELY
from fdbench.report._virtual_machines import virtual_machines
from fdbench.report.process_forces_text import forces, process_forces
from fdbench.wording import percent, probability_text, public_text, quantity, scaled, si_text, unit_text

PARTITIONS = {
    "motion": "Phase of motion",
    "frequency": "Frequency",
    "position": "Position",
    "velocity": "Velocity",
    "time": "Time",
    "channel": "Channel",
}
TITLES = ("Where the gap lies", "Causes", "How far the gap shrinks", "Process forces", "Virtual machines like this one")


def lead(answer: Answer) -> Iterator[Html]:
    """Yield the answer on one card, and beside it what speaks against it."""
    doubts = [public_text(doubt) for doubt in doubts_text.doubts(answer)]
    content = [*_causes_in_short(answer), channel_bars(answer), *map(paragraph, verdict_text.verdict(answer))]
    yield part("answer", diagnosis_text.title(answer), content, doubts)


def _causes_in_short(answer: Answer) -> Iterator[Html]:
    """Yield what is most probable: causes with their values, the type of cause where the effect is in doubt."""
    named = [cause for cause in answer.causes if cause.probability > LIKELY]
    for cause in named:
        names = Html(" or ").join(map(breakable, [cause.effect, *cause.indistinguishable_from]))
        values = [
            f"{quantity(name)[0]} {si_text(item.value, item.unit)}"
            for name, item in cause.parameters.items()
            if name not in cause.typical
        ]
        yield part("cause", names, probability_text(cause.probability), cause.probability, "; ".join(values))
    others = (("no gap beyond the noise", answer.no_gap_probability), ("something unknown", answer.unknown_probability))
    for name, chance in others:
        if chance >= LIKELY:
            yield part("cause", name, probability_text(chance), chance, "")
    if not named and answer.types:
        best = answer.types[0]
        side = f" on the side of the {best.side}" if best.side else ""
        name = f"type of cause: {best.type.replace('_', ' ')}{side}"
        yield part("cause", name, probability_text(best.probability), best.probability, "")


def channel_bars(answer: Answer) -> Html:
    """Return the gap of each channel before and after as bars, that with the largest share of the gap first."""
    rows = []
    shares = answer.where.channel
    for name, channel in sorted(answer.gap.channels.items(), key=lambda item: -shares.get(item[0], 0.0)):
        longest = max(channel.before, channel.recalibrated, channel.repaired, channel.noise_floor) or 1.0
        sizes = (channel.before, channel.recalibrated, channel.repaired, channel.noise_floor)
        factor, unit = scaled(channel.unit, longest)
        rows.append(
            {
                "name": quantity(name)[0],
                "before": round(100.0 * channel.before / longest, 2),
                "after": round(100.0 * channel.repaired / longest, 2),
                "floor": round(100.0 * channel.noise_floor / longest, 2),
                "text": f"{factor * channel.before:.3g} → {factor * channel.repaired:.3g} {unit}",
                "title": ", ".join(
                    f"{what} {si_text(size, channel.unit)}"
                    for what, size in zip(("nominal", "re-calibrated", "repaired", "noise floor"), sizes, strict=True)
                ),
            }
        )
    return part(
        "gaps",
        rows,
        f"Root mean square gap on {answer.shrinkage.judged_on_words}. Above nominal, below repaired; line: noise.",
    )


def sections(answer: Answer) -> list[Section]:
    """Return where the gap lies, its causes, and how far it shrinks."""
    parts = (_where(answer), _causes(answer), _shrinkage(answer), _process_forces(answer), _virtual_machines(answer))
    found = [Section(title, list(blocks)) for title, blocks in zip(TITLES, parts, strict=True)]
    return [section for section in found if section.blocks]


def _virtual_machines(answer: Answer) -> Iterator[Block]:
    sentences = [f"{sentence[0].upper()}{sentence[1:]}." for sentence in virtual_machines(answer)]
    if sentences:
        yield part("bullets", sentences)


def _process_forces(answer: Answer) -> Iterator[Block]:
    for force, sentence in zip(forces(answer), process_forces(answer), strict=True):
        yield paragraph(public_text(sentence))
        time, values = np.array(force.course.time_s), np.array(force.course.force_N)
        within = 1.96 * force.standard_deviation_N
        shaded = Band(name="95 %", x=time, lower=values - within, upper=values + within, style=BEFORE)
        force_N = Curve(name="force on the axis", x=time, y=values, style=BEFORE, listed=False)
        panel = Panel(y_title=f"force ({unit_text('N')})", items=[shaded, force_N])
        title = public_text(force.record)
        yield Figure(title=title, panels=[panel], x_title="time (s)", caption="Shaded: 95 % intervals.")


def noise_floors(answer: Answer) -> Html:
    """Return the table of the noise floor of each channel."""
    rows = [
        [
            quantity(name)[0],
            si_text(floor.value, floor.unit),
            "measured from repeats" if floor.measured_from_repeats else "assumed from the quietest parts",
        ]
        for name, floor in answer.noise_floor.items()
    ]
    return table(["channel", "noise floor", "origin"], rows, "lrl")


def _where(answer: Answer) -> Iterator[Block]:
    if diagnosis_text.is_noise_alone(answer):
        yield paragraph("Nothing is beyond the noise.")
        return
    yield note(
        "Shares of the mean squared gap of the re-calibrated model beyond the noise floor, all channels together, each "
        "in units of its floor. What the noise alone would give is set apart, so the shares of a figure add up to 1."
    )
    yield note("Thin lines: 95 % of resampled stretches of time.")
    figures = []
    for key, title in PARTITIONS.items():
        cells = diagnosis_text.cells_of(answer, key)
        if any(share > 0.0 for _, share in cells):
            names, shares = [name for name, _ in cells], [share for _, share in cells]
            figures.append(bars(title, names, shares, bounds=_bounds(answer.where, key), whole=1.0))
    yield Grid(figures) if figures else paragraph("Nothing is beyond the noise.")


def _bounds(where: Where, key: str) -> list[Pair]:
    """Return the intervals of the cells of a partition; none where the answer has none, as older ones."""
    content: Mapping[str, float] | Sequence[Cell] = getattr(where, key)
    named = where.ci95.get(key, {})
    found = [named.get(name) for name in content] if isinstance(content, Mapping) else [cell.ci95 for cell in content]
    return [bounds for bounds in found if bounds is not None] if None not in found else []


def _causes(answer: Answer) -> Iterator[Block]:
    causes = answer.causes
    names = [*(cause.effect for cause in causes), "something unknown", "no gap"]
    chances = [cause.probability for cause in causes]
    chances += [answer.unknown_probability, answer.no_gap_probability]
    yield from cause_tables(answer)
    if not causes:
        yield paragraph("No effect is named.")
    size = answer.sizes()[1]
    noise = min(1.0, 1.0 / size) if size > 0.0 else 1.0
    added = [cause for cause in causes if not cause.parametric and not cause.beside_changes]
    yield Grid(
        [
            bars(
                "Probability",
                names,
                [min(chance, 1.0) for chance in chances],
                text=probability_text,
                longest=1.0,
                caption="Several effects may be present at once.",
            ),
            bars(
                "What the mean squared gap after re-calibration consists of",
                [*(cause.effect for cause in added), "not explained", "noise"],
                [*(cause.share for cause in added), answer.unexplained(), noise],
                whole=1.0,
                caption=f"Judged on {answer.shrinkage.judged_on_words}. What effects share is split by the mean over "
                "all orders.",
            ),
        ]
    )
    if answer.next_experiment is not None:
        yield from _experiment(answer.next_experiment)


def cause_tables(answer: Answer) -> Iterator[Html]:
    """Yield the causes with their parameters, then with their probabilities and shares, nominal parameters apart."""
    causes = answer.causes
    if not causes:
        return
    rows = []
    for cause in causes:
        for number, (name, value) in enumerate(cause.parameters.items()):
            text, _ = quantity(name)
            known = "typical, not fitted" if name in cause.typical else _interval(value)
            shown = si_text(value.value, value.unit)
            rows.append([breakable(cause.effect) if number == 0 else "", text, shown, known])
    yield table(["effect", "parameter", "value", "95 % interval"], rows, "llrl")
    added = [cause for cause in causes if not cause.parametric]
    if added:
        shares = [
            [
                *(breakable(cause.effect), probability_text(cause.probability), percent(cause.share)),
                *(percent(diagnosis_text.unique(cause)), ", ".join(cause.indistinguishable_from) or "–"),
            ]
            for cause in added
        ]
        header = [
            "effect",
            "probability",
            "share after re-calibration",
            "share of its own",
            "cannot be distinguished from",
        ]
        yield table(header, shares, "lrrrl")
    if len(added) < len(causes):
        shares = [
            [breakable(cause.effect), probability_text(cause.probability), percent(cause.share)]
            for cause in causes
            if cause.parametric
        ]
        yield table(["nominal parameter", "probability", "share of the nominal gap"], shares, "lrr")


def _experiment(experiment: Experiment) -> Iterator[Block]:
    pair = " from ".join(experiment.to_separate)
    file = f" ({experiment.file})" if experiment.file else ""
    yield paragraph(f"Next experiment, to separate {pair}: {experiment.motion or experiment.trajectory}{file}")
    rows = []
    if experiment.position_m is not None:
        low, high = (si_text(bound, "m") for bound in experiment.position_m)
        rows.append(["where", f"{low} to {high}"])
    for name, value, unit in (
        ("amplitude", experiment.amplitude_m, "m"),
        ("fastest", experiment.velocity_m_per_s, "m/s"),
        ("hardest", experiment.acceleration_m_per_s2, "m/s^2"),
        ("lasts", experiment.duration_s, "s"),
    ):
        if value is not None:
            rows.append([name, si_text(value, unit)])
    if (chance := experiment.expected_probability) is not None:
        text = f"{probability_text(chance.now)} now, {probability_text(chance.after)} after it"
        rows.append(["probability of the true cause, expected", text])
    if experiment.expected_gain_per_s is not None:
        rows.append(["gain for each second of the machine", f"{experiment.expected_gain_per_s:.2g}"])
    for item in experiment.separates:
        rows.append([f"{' from '.join(item.effects)}, expected", f"{item.expected_log_odds:.3g} of log odds"])
    if rows:
        yield table(["next experiment", ""], rows, "lr")


def _interval(value: Quantity) -> str:
    if value.ci95 is None:
        return "not computed"
    return " to ".join(si_text(bound, value.unit) for bound in value.ci95)


def _shrinkage(answer: Answer) -> Iterator[Block]:
    nominal, size = answer.sizes()
    steps = [step for step in answer.shrinkage.steps if not step.beside_changes]
    names = ["nominal", "re-calibrated", *(f"+ {step.added}" for step in steps), "noise alone"]
    values = [nominal, size, *(step.after for step in steps), 1.0]
    none = (math.nan, math.nan)
    intervals = [(step.before * (1.0 - step.ci95[1]), step.before * (1.0 - step.ci95[0])) for step in steps]
    yield dots(
        "Mean squared gap in units of the noise floor",
        names,
        values,
        [none, none, *intervals, none],
        log=True,
        caption=f"Judged on {answer.shrinkage.judged_on_words}. Fine lines: 95 % of resampled stretches of time, for "
        "the step alone.",
    )
    yield part("bullets", list(diagnosis_text.shrinkage(answer)))
    yield folded("Gap of each channel, root mean square", channel_table(answer))


def channel_table(answer: Answer) -> Html:
    """Return the gap of each channel before and after."""
    rows = [
        [
            quantity(name)[0],
            *(
                si_text(size, channel.unit)
                for size in (channel.before, channel.recalibrated, channel.repaired, channel.noise_floor)
            ),
            percent(channel.reduction),
        ]
        for name, channel in answer.gap.channels.items()
    ]
    header = ["channel", "nominal", "re-calibrated", "repaired", "noise floor", "mean square less"]
    return table(header, rows, "lrrrrr")
