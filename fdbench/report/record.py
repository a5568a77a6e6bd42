"""Pictures of records: every column over time, those of several records above each other."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from fdbench.errors import RecordError, SpecError, did_you_mean
from fdbench.files import write_text
from fdbench.record import FloatArray, Record
from fdbench.report._figures import TRUTH, Curve, Figure, Panel, Style, labelled, numbered
from fdbench.report._page import Section, note, table, write_page
from fdbench.report._series import MOST_POINTS, peak, thinned
from fdbench.report._svg import svg_file
from fdbench.report._templates import Html
from fdbench.wording import quantity, scaled, si_text

TIME, REFERENCE = "time_s", "reference_"
LARGEST = 1e100
FORMATS = (".html", ".svg")


def write_plot(records: Sequence[Record], output: Path, columns: Sequence[str] = ()) -> None:
    """Write a picture of records.

    Parameters
    ----------
    records : sequence of Record
    output : Path
        ``.html`` for a page with a table of sizes, ``.svg`` for the picture alone.
    columns : sequence of str
        What is drawn; all columns, if none is given.

    Raises
    ------
    FdbenchError
        If no record has such a column, a number is too large to be drawn, the format is another one, or the file cannot
        be written.
    """
    if output.suffix.lower() not in FORMATS:
        raise SpecError(f"{output}: a plot is written as {' or '.join(FORMATS)}.")
    for record in records:
        check_sizes(record, _chosen(records, columns))
    drawn = figure(records, columns)
    if output.suffix.lower() == ".svg":
        write_text(output, svg_file(drawn))
        return
    counts = "; ".join(
        f"{Path(record.source).name}: {record.n_samples} samples of {si_text(record.sampling_time_s, 's')}"
        for record in records
    )
    sections = [Section("Columns over time", [drawn]), Section("Sizes", [_sizes(records, _chosen(records, columns))])]
    write_page(output, "fdbench: records", [note(counts)], sections)


def check_sizes(record: Record, names: Sequence[str]) -> None:
    """Raise a RecordError where a column of these names holds a number that is too large to be drawn."""
    for name in names:
        place = int(np.argmax(np.abs(record[name]))) if name in record else 0
        if name in record and abs(record[name][place]) > LARGEST:
            raise RecordError(
                f"{record.source}: {name} is {record[name][place]:g} at sample {place}, too large to draw."
            )


def figure(records: Sequence[Record], columns: Sequence[str] = ()) -> Figure:
    """Return a panel for each column; a reference is drawn behind what follows it."""
    names = _chosen(records, columns)
    behind = {name: f"{REFERENCE}{name}" for name in names if f"{REFERENCE}{name}" in names}
    alone = [name for name in names if name not in behind.values()]
    panels = [panel for name in alone for panel in _panels(records, name, behind.get(name))]
    return Figure(title="", panels=panels, x_title="time (s)")


def _chosen(records: Sequence[Record], columns: Sequence[str]) -> list[str]:
    """Return the columns to draw, in the order of the records, or as they are named."""
    known = [name for name in dict.fromkeys(name for record in records for name in record) if name != TIME]
    for name in columns:
        if name not in known:
            raise RecordError(f"{records[0].source}: no column '{name}' to draw.{did_you_mean(name, known)}")
    return list(dict.fromkeys(columns)) or known


def _panels(records: Sequence[Record], name: str, behind: str | None) -> Iterator[Panel]:
    """Yield a column with its reference behind it, and what lies between the two."""
    text, unit = quantity(name)
    titles = _titles(records)
    those = [(place, record) for place, record in enumerate(records) if name in record]
    factor, shown = scaled(unit, peak([_finite(record[name]) for _, record in those]))
    items, errors = [], {}
    for place, record in those:
        if behind is not None and behind in record:
            items.append(_curve(record, record[behind], "reference", factor, Style(colour=TRUTH), 3.0))
            errors[place] = record[name] - record[behind]
        items.append(_curve(record, record[name], titles[place], factor, numbered(place)))
    yield Panel(y_title=labelled(text, shown), items=items, height_px=150)
    if errors:
        factor, shown = scaled(unit, peak([_finite(values) for values in errors.values()]))
        items = [
            _curve(records[place], values, titles[place], factor, numbered(place)) for place, values in errors.items()
        ]
        yield Panel(y_title=labelled(f"{text} minus reference", shown), items=items, height_px=150)


def _titles(records: Sequence[Record]) -> list[str]:
    """Return the names of the files, with their folders where they are the same without."""
    if len(records) == 1:
        return ["measured"]
    names = [Path(record.source).name for record in records]
    return names if len(set(names)) == len(names) else [record.source for record in records]


def _finite(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]


def _curve(record: Record, values: FloatArray, name: str, factor: float, style: Style, width: float = 1.2) -> Curve:
    x, y = thinned(record[TIME], factor * values, MOST_POINTS)
    return Curve(name=name, x=x, y=y, style=style, width=width)


def _sizes(records: Sequence[Record], names: Sequence[str]) -> Html:
    rows = []
    for name in names:
        unit = quantity(name)[1]
        for record in records:
            if name in record:
                values = _finite(record[name])
                root = float(np.sqrt(np.mean(values**2)))
                sizes = (float(values.min()), float(values.max()), float(values.mean()), root)
                rows.append([name, Path(record.source).name, *(si_text(size, unit) for size in sizes)])
    return table(["column", "record", "least", "greatest", "mean", "root mean square"], rows, "llrrrr")
