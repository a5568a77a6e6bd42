"""The frame of every page: sections with a table of contents, tables, and figures that draw themselves when seen.

Plain text is escaped wherever it goes in; only `Html` is taken as it is.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from markupsafe import escape

from fdbench.errors import FdbenchError
from fdbench.report._templates import Html, part, rendered, resource

Trace = dict[str, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class Figure:
    """A plotly figure; colours may be variables of the style sheet, such as ``var(--ink)``.

    Attributes
    ----------
    title, caption : str
        Text above and below.
    traces : sequence of dict
    layout : mapping
    height_px : int
    """

    title: str
    traces: Sequence[Trace]
    layout: Mapping[str, Any]
    height_px: int
    caption: str = ""

    @property
    def json(self) -> Html:
        """What draws it, as it may stand in a page."""
        text = json.dumps({"data": self.traces, "layout": self.layout}, allow_nan=False, separators=(",", ":"))
        return Html(text.replace("<", "\\u003c"))


@dataclass(frozen=True, eq=False)
class Grid:
    """Small figures beside each other, as many as the screen has room for."""

    figures: Sequence[Figure]


@dataclass(frozen=True, eq=False)
class Section:
    """A heading with what stands below it; sections may hold sections."""

    title: str
    blocks: Sequence["Block"]


Block: TypeAlias = Html | Figure | Grid | Section


def breakable(name: str) -> Html:
    """Return a name that may be broken after its underscores.

    >>> breakable("parameter_error")
    Markup('parameter_<wbr>error')
    """
    return escape(name).replace("_", Html("_<wbr>"))


def paragraph(*parts: str) -> Html:
    """Return a paragraph."""
    return part("paragraph", parts)


def note(*parts: str) -> Html:
    """Return a paragraph in small print."""
    return part("note", parts)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], alignment: str) -> Html:
    """Return a table that scrolls sideways where the screen is narrow.

    Parameters
    ----------
    header, rows : sequences of str
        Cells; escaped unless they are markup.
    alignment : str
        ``l`` or ``r`` for each column.

    Raises
    ------
    ValueError
        If a row has not one cell for each column.
    """
    lines = [*rows]
    for cells in (header, *lines):
        if len(cells) != len(alignment):
            raise ValueError(f"{len(cells)} cells in a row, {len(alignment)} columns: {cells}.")
    return part("table", header, lines, alignment)


def folded(summary: str, *parts: Html) -> Html:
    """Return what is shown when its summary is clicked."""
    return part("details", summary, parts)


def slug(text: str) -> str:
    """Return a text as part of an id.

    >>> slug("Track: output (N)")
    'track-output-n'
    """
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "section"


def write_page(output: Path, title: str, lead: Sequence[Html], sections: Sequence[Section]) -> None:
    """Write a page that needs nothing but itself.

    Raises
    ------
    FdbenchError
        If the file cannot be written.
    """
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(page(title, lead, sections), encoding="utf-8", newline="\n")
    except OSError as error:
        raise FdbenchError(f"{output}: cannot be written: {error.strerror or error}.") from error


def page(title: str, lead: Sequence[Html], sections: Sequence[Section]) -> str:
    """Return the text of a page: title, lead, table of contents, sections."""
    from plotly.offline import get_plotlyjs

    return rendered(
        "page.html",
        title=title,
        lead=lead,
        sections=_placed(sections, ""),
        css=resource("page.css"),
        js=resource("page.js"),
        plotly=Html(get_plotlyjs()),
    )


@dataclass(frozen=True)
class _Placed:
    """A section with its id, and blocks of which those that are sections are placed too."""

    title: str
    identifier: str
    blocks: "list[Html | Figure | Grid | _Placed]"


def _placed(blocks: Iterable[Block], prefix: str) -> "list[Html | Figure | Grid | _Placed]":
    """Return blocks, the sections among them with an id each; equal titles are numbered."""
    found: list[Html | Figure | Grid | _Placed] = []
    taken: set[str] = set()
    for block in blocks:
        if not isinstance(block, Section):
            found.append(block)
            continue
        wanted = prefix + slug(block.title)
        identifier, number = wanted, 2
        while identifier in taken:
            identifier, number = f"{wanted}-{number}", number + 1
        taken.add(identifier)
        found.append(_Placed(block.title, identifier, _placed(block.blocks, f"{identifier}-")))
    return found
