"""Pictures of records: every column over time, those of several records above each other."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fdbench.errors import RecordError, SpecError, did_you_mean
from fdbench.files import write_text
from fdbench.record import Record
from fdbench.report._figures import TRUTH, Curve, Figure, Panel, Style, labelled, numbered
from fdbench.report._page import Section, note, table, write_page
from fdbench.report._series import MOST_POINTS, peak, thinned
from fdbench.report._svg import svg_file
from fdbench.report._templates import Html
from fdbench.wording import quantity, scaled, si_text

TIME, REFERENCE = "time_s", "reference_"
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
        If no record has such a column, the format is another one, or the file cannot be written.
    """
    if output.suffix.lower() not in FORMATS:
        raise SpecError(f"{output}: a plot is written as {' or '.join(FORMATS)}.")
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


def figure(records: Sequence[Record], columns: Sequence[str] = ()) -> Figure:
    """Return a panel for each column; a reference is drawn behind what follows it."""
    names = _chosen(records, columns)
    behind = {name: f"{REFERENCE}{name}" for name in names if f"{REFERENCE}{name}" in names}
    panels = [_panel(records, name, behind.get(name)) for name in names if name not in behind.values()]
    return Figure(title="", panels=panels, x_title="time (s)")


def _chosen(records: Sequence[Record], columns: Sequence[str]) -> list[str]:
    """Return the columns to draw, in the order of the records, or as they are named."""
    known = [name for name in dict.fromkeys(name for record in records for name in record) if name != TIME]
    for name in columns:
        if name not in known:
            raise RecordError(f"{records[0].source}: no column '{name}' to draw.{did_you_mean(name, known)}")
    return list(dict.fromkeys(columns)) or known


def _panel(records: Sequence[Record], name: str, behind: str | None) -> Panel:
    text, unit = quantity(name)
    those = [(place, record) for place, record in enumerate(records) if name in record]
    factor, shown = scaled(unit, peak([record[name][np.isfinite(record[name])] for _, record in those]))
    items = []
    for place, record in those:
        title = Path(record.source).name if len(records) > 1 else "measured"
        if behind is not None and behind in record:
            items.append(_curve(record, behind, "reference", factor, Style(colour=TRUTH), 3.0))
        items.append(_curve(record, name, title, factor, numbered(place)))
    return Panel(y_title=labelled(text, shown), items=items, height_px=150)


def _curve(record: Record, column: str, name: str, factor: float, style: Style, width: float = 1.2) -> Curve:
    x, y = thinned(record[TIME], factor * record[column], MOST_POINTS)
    return Curve(name=name, x=x, y=y, style=style, width=width)


def _sizes(records: Sequence[Record], names: Sequence[str]) -> Html:
    rows = []
    for name in names:
        unit = quantity(name)[1]
        for record in records:
            if name in record:
                values = record[name][np.isfinite(record[name])]
                root = float(np.sqrt(np.mean(values**2)))
                sizes = (float(values.min()), float(values.max()), float(values.mean()), root)
                rows.append([name, Path(record.source).name, *(si_text(size, unit) for size in sizes)])
    return table(["column", "record", "least", "greatest", "mean", "root mean square"], rows, "llrrrr")
