"""The frame of every page: sections with a table of contents, tables, and figures that draw themselves when seen.

Plain text is escaped wherever it goes in; only `Html` is taken as it is.
"""

import html
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeAlias

from fdbench.errors import FdbenchError

# Nothing is fetched: the browser itself refuses every request of the page.
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"

Trace = dict[str, Any]


class Html(str):
    """Markup that is put on a page as it is."""

    __slots__ = ()


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


def escaped(value: str) -> Html:
    """Return text as markup.

    >>> escaped("a < b"), escaped(Html("<b>a</b>"))
    ('a &lt; b', '<b>a</b>')
    """
    return value if isinstance(value, Html) else Html(html.escape(value))


def tag(name: str, *parts: str, kind: str = "") -> Html:
    """Return an element with its content, which is escaped unless it is markup.

    >>> tag("p", "1 < 2", kind="note")
    '<p class="note">1 &lt; 2</p>'
    """
    attribute = f' class="{html.escape(kind)}"' if kind else ""
    return Html(f"<{name}{attribute}>{''.join(escaped(part) for part in parts)}</{name}>")


def breakable(name: str) -> Html:
    """Return a name that may be broken after its underscores.

    >>> breakable("parameter_error")
    'parameter_<wbr>error'
    """
    return Html(escaped(name).replace("_", "_<wbr>"))


def paragraph(*parts: str) -> Html:
    """Return a paragraph."""
    return tag("p", *parts)


def note(*parts: str) -> Html:
    """Return a paragraph in small print."""
    return tag("p", *parts, kind="note")


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
    kinds = ["number" if side == "r" else "" for side in alignment]

    def row(cells: Sequence[str], name: str) -> Html:
        return tag("tr", *(tag(name, cell, kind=kind) for cell, kind in zip(cells, kinds, strict=True)))

    body = tag("tbody", *(row(cells, "td") for cells in rows))
    return tag("div", tag("table", tag("thead", row(header, "th")), body), kind="wide")


def folded(summary: str, *parts: Html) -> Html:
    """Return what is shown when its summary is clicked."""
    return tag("details", tag("summary", summary), *parts)


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

    placed = _placed(sections, "")
    body = [
        "<header>",
        tag("h1", title),
        *lead,
        "</header>",
        '<nav aria-label="Contents">',
        "<ul>",
        *(line for entry in placed for line in entry.contents()),
        "</ul>",
        "</nav>",
        "<main>",
        *(line for entry in placed for line in entry.lines(2)),
        "</main>",
    ]
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark">',
            tag("title", title),
            f"<style>\n{_resource('_page.css')}</style>",
            "</head>",
            "<body>",
            "<noscript><p>The figures of this page need JavaScript; the tables do not.</p></noscript>",
            *body,
            f'<script data-library="plotly">{get_plotlyjs()}</script>',
            f"<script>\n{_resource('_page.js')}</script>",
            "</body>",
            "</html>",
            "",
        ]
    )


def _resource(name: str) -> str:
    return files("fdbench.report").joinpath(name).read_text("utf-8")


@dataclass(frozen=True)
class _Placed:
    """A section with its id, and those that it holds, in order."""

    section: Section
    identifier: str
    inner: "list[_Placed]"

    def contents(self) -> Iterator[str]:
        yield f'<li><a href="#{self.identifier}">{escaped(self.section.title)}</a>'
        if self.inner:
            yield "<ul>"
            for entry in self.inner:
                yield f'<li><a href="#{entry.identifier}">{escaped(entry.section.title)}</a></li>'
            yield "</ul>"
        yield "</li>"

    def lines(self, level: int) -> Iterator[str]:
        yield f'<section id="{self.identifier}">'
        yield tag(f"h{level}", self.section.title)
        inner = iter(self.inner)
        for number, block in enumerate(self.section.blocks):
            if isinstance(block, Section):
                yield from next(inner).lines(level + 1)
            elif isinstance(block, Html):
                yield block
            elif isinstance(block, Figure):
                yield from _figure(block, f"{self.identifier}-{number}", level + 1)
            else:
                yield '<div class="grid">'
                for place, figure in enumerate(block.figures):
                    yield from _figure(figure, f"{self.identifier}-{number}-{place}", level + 1)
                yield "</div>"
        yield "</section>"


def _placed(blocks: Iterable[Block], prefix: str) -> list[_Placed]:
    """Return the sections among blocks with an id each; equal titles are numbered."""
    found: dict[str, _Placed] = {}
    for section in blocks:
        if isinstance(section, Section):
            wanted = prefix + slug(section.title)
            identifier, number = wanted, 2
            while identifier in found:
                identifier, number = f"{wanted}-{number}", number + 1
            found[identifier] = _Placed(section, identifier, _placed(section.blocks, f"{identifier}-"))
    return list(found.values())


def _figure(figure: Figure, identifier: str, level: int) -> Iterator[str]:
    yield "<figure>"
    yield tag(f"h{level}", figure.title)
    yield f'<div class="plot" id="plot-{identifier}" style="height:{figure.height_px}px"></div>'
    yield f'<script type="application/json" data-plot="plot-{identifier}">{_json(figure)}</script>'
    if figure.caption:
        yield tag("figcaption", figure.caption)
    yield "</figure>"


def _json(figure: Figure) -> str:
    text = json.dumps({"data": figure.traces, "layout": figure.layout}, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")
