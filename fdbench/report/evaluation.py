"""The page of an evaluation: scores, comparison, and measured, predicted and error of every channel."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fdbench.diagnosis.evaluation.evaluate import Evaluated
from fdbench.diagnosis.evaluation.result import WAYS
from fdbench.record import FloatArray
from fdbench.report._figures import TRUTH, Curve, Figure, Panel, Style, labelled, styles_of
from fdbench.report._page import Block, Section, note, paragraph, table, write_page
from fdbench.report._series import MOST_POINTS, opening_range, peak, thinned
from fdbench.report._templates import Html
from fdbench.report.evaluation_text import HEADER, compared, counted, rows, way_title
from fdbench.wording import quantity, scaled

MOST_RUNS = 6
POINTS_OF_ALL_RUNS = 12_000


def write_evaluation(found: Evaluated, path: str | Path) -> None:
    """Write an evaluation as one HTML file that works offline.

    Raises
    ------
    FdbenchError
        If the file cannot be written.
    """
    own = found.evaluation
    head: list[Html] = [
        paragraph(f"{counted(len(own.models), 'model')}, {counted(len(own.records), 'record')}."),
        note(
            "Error: root mean square. Fit: 100 % minus the error over the standard deviation of the channel. Noise "
            "floor: half of what repeats or laps differ by, else assumed. * marks the model that predicts best."
        ),
        *(paragraph(text) for text in own.warnings),
    ]
    parts = [Section(way_title(own, way), list(_way(found, way))) for way in WAYS]
    write_page(Path(path), "fdbench: how well models predict records", head, parts)


def _way(found: Evaluated, way: str) -> Iterator[Block]:
    own = found.evaluation
    yield table(HEADER, [cells for _, cells in rows(own, way)], "lllrrrr")
    yield from (paragraph(compared(item)) for item in own.comparisons if item.way == way)
    if len(found.runs) > MOST_RUNS:
        yield note(f"The first {MOST_RUNS} of {len(found.runs)} records are drawn.")
    for place in range(min(len(found.runs), MOST_RUNS)):
        for channel in found.predictions[way, own.models[0]][place].measured:
            yield _figure(found, way, place, channel)


def _figure(found: Evaluated, way: str, place: int, channel: str) -> Figure:
    run, models = found.runs[place], found.evaluation.models
    text, unit = quantity(channel)
    own = {name: found.predictions[way, name][place] for name in models}
    first = next(iter(own.values()))
    measured = first.measured[channel]
    time_s = run.period_s * (first.first + np.arange(len(measured), dtype=np.float64))
    styles = styles_of(models)
    n_points = min(MOST_POINTS, POINTS_OF_ALL_RUNS // min(len(found.runs), MOST_RUNS))

    def curve(name: str, values: FloatArray, style: Style, width: float = 1.2) -> Curve:
        x, y = thinned(time_s, values, n_points)
        return Curve(name=name, x=x, y=y, style=style, width=width)

    errors = {name: item.measured[channel] - item.predicted[channel] for name, item in own.items()}
    factor, prefixed = scaled(unit, peak([measured]))
    of_error, error_unit = scaled(unit, peak(list(errors.values())))
    above = [curve(name, factor * item.predicted[channel], styles[name]) for name, item in own.items()]
    below = [of_error * error for error in errors.values()]
    panels = [
        Panel(
            y_title=labelled(text, prefixed),
            items=[curve("measured", factor * measured, Style(colour=TRUTH), 3.0), *above],
            height_px=180,
        ),
        Panel(
            y_title=labelled("error", error_unit),
            items=[curve(name, values, styles[name]) for name, values in zip(models, below, strict=True)],
            y_range=opening_range(below),
        ),
    ]
    return Figure(
        title=f"{Path(run.name).name}: {text}",
        panels=panels,
        x_title="time (s)",
        caption="Error: measured minus predicted.",
    )
