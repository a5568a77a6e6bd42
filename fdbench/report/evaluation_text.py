"""An evaluation in plain words and tables for a terminal."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from fdbench.diagnosis.evaluation.result import ALL_RECORDS, WAYS, Evaluation, ModelComparison, PredictionScore
from fdbench.report._text import wrapped
from fdbench.wording import quantity, scaled, si_text

HEADER = ("channel", "record", "model", "error", "of the spread", "fit", "noise floor")


def evaluation_text(found: Evaluation) -> str:
    """Return an evaluation as text: a table for each way of predicting, the comparison of models, and warnings."""
    lines = [f"Evaluation: {counted(len(found.models), 'model')}, {counted(len(found.records), 'record')}"]
    for way in WAYS:
        lines += ["", way_title(found, way)]
        lines += _aligned([HEADER, *(row for _, row in rows(found, way))])
        for comparison in found.comparisons:
            if comparison.way == way:
                lines += wrapped(compared(comparison))
    if not all(score.noise_measured for score in found.scores):
        lines += ["", "Noise floor: assumed from what the model leaves at all times, as nothing was repeated."]
    if found.warnings:
        lines += ["", "Warnings", *(line for text in found.warnings for line in wrapped(text))]
    return "\n".join(lines)


def counted(count: int, name: str) -> str:
    """Return a number of things.

    >>> counted(1, "model"), counted(2, "record")
    ('1 model', '2 records')
    """
    return f"{count} {name}{'' if count == 1 else 's'}"


def way_title(found: Evaluation, way: str) -> str:
    """Return what a way of predicting is called, with its band of frequency."""
    return f"{WAYS[way]}, up to {found.band_Hz:.3g} Hz" if way == "inverse_dynamics" else WAYS[way]


def rows(found: Evaluation, way: str) -> Iterator[tuple[PredictionScore, tuple[str, ...]]]:
    """Yield the scores of a way with their cells; ``*`` marks the model that predicts a channel best."""
    best = {item.channel: item.best for item in found.comparisons if item.way == way}
    scores = [score for score in found.scores if score.way == way]
    overall = ALL_RECORDS if len(found.records) > 1 else found.records[0]
    order = {channel: place for place, channel in enumerate(dict.fromkeys(score.channel for score in scores))}
    records = {record: place for place, record in enumerate((*found.records, ALL_RECORDS))}
    for score in sorted(scores, key=lambda item: (order[item.channel], records[item.record])):
        mark = " *" if score.record == overall and best.get(score.channel) == score.model else ""
        yield (
            score,
            (
                quantity(score.channel)[0],
                score.record if score.record == ALL_RECORDS else Path(score.record).name,
                score.model + mark,
                si_text(score.root_mean_square_error, score.unit),
                "–" if score.relative_error is None else f"{100.0 * score.relative_error:.3g} %",
                "–" if score.fit_percent is None else fit_text(score.fit_percent),
                _floor(score),
            ),
        )


def fit_text(fit_percent: float) -> str:
    """Return a fit with as many digits as tell it from 100 %.

    >>> fit_text(95.69), fit_text(99.99817), fit_text(-12.3), fit_text(100.0)
    ('95.69 %', '99.99817 %', '-12.3 %', '100 %')
    """
    missing = 100.0 - fit_percent
    digits = next((n for n in range(1, 7) if missing >= 10.0 ** (2 - n)), 7 if missing > 0.0 else 0)
    return f"{fit_percent:.{max(digits, 1)}f} %" if missing > 0.0 else "100 %"


def _floor(score: PredictionScore) -> str:
    factor, unit = scaled(score.unit, score.noise_floor)
    return f"{factor * score.noise_floor:.3g} {unit}{'' if score.noise_measured else ' (assumed)'}"


def compared(comparison: ModelComparison) -> str:
    """Return which model predicts a channel best, and by how much."""
    others = "; ".join(
        f"{ratio.model} has {ratio.value:.4g} times its error (95 %: {ratio.ci95[0]:.4g} to {ratio.ci95[1]:.4g})"
        for ratio in comparison.ratios
    )
    doubt = "" if comparison.certain else "; not certain, an interval includes 1"
    return f"{quantity(comparison.channel)[0]}: {comparison.best} is best; {others}{doubt}."


def _aligned(table: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(len(row[place]) for row in table) for place in range(len(table[0]))]
    for row in table:
        cells = [
            cell.ljust(width) if place < 3 else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield f"  {'  '.join(cells)}".rstrip()
