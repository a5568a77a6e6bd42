"""The frame of every page: sections with a table of contents, tables, figures, and what is folded.

Plain text is escaped wherever it goes in; only `Html` is taken as it is.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from markupsafe import escape

from fdbench.files import write_text
from fdbench.report._figures import Figure
from fdbench.report._svg import drawing
from fdbench.report._templates import Html, part, rendered, resource


@dataclass(frozen=True, eq=False)
class Grid:
    """Small figures beside each other, as many as the screen has room for."""

    items: Sequence["Html | Figure"]


@dataclass(frozen=True, eq=False)
class Folded:
    """What is drawn when its summary is opened; one with an ``identifier`` can be linked to and found by ``name``."""

    summary: str
    blocks: Sequence["Block"]
    identifier: str = ""
    name: str = ""


@dataclass(frozen=True, eq=False)
class Section:
    """A heading with what stands below it; sections may hold sections."""

    title: str
    blocks: Sequence["Block"]


Block: TypeAlias = Html | Figure | Grid | Folded | Section


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
    write_text(output, page(title, lead, sections))


def page(title: str, lead: Sequence[Html], sections: Sequence[Section]) -> str:
    """Return the text of a page: title, lead, table of contents, sections."""
    return _shared(
        rendered(
            "page.html",
            title=title,
            lead=lead,
            sections=_placed(sections, ""),
            css=resource("figure.css") + resource("page.css"),
            js=resource("page.js"),
        )
    )


def _shared(text: str) -> str:
    """Return a page whose axes of one scale refer to the grid and the ticks of the first one, as it grows less so."""
    names: dict[str, str] = {}
    counts = {"x": 0, "y": 0}

    def refer(found: re.Match[str]) -> str:
        ticks = found[0]
        if ticks in names:
            return f'<use href="#{names[ticks]}"/>'
        names[ticks] = f"{'axis' if found[1] == 'x' else 'scale'}-{counts[found[1]]}"
        counts[found[1]] += 1
        return ticks.replace("<g", f'<g id="{names[ticks]}"', 1)

    return re.sub(r'<g class="ticks ([xy])">.*?</g>', refer, text)


@dataclass(frozen=True, kw_only=True)
class _Placed:
    """A block as the template takes it: drawn, or with all that stands in it."""

    kind: str
    title: str = ""
    identifier: str = ""
    name: str = ""
    drawing: str = ""
    caption: str = ""
    blocks: "Sequence[Html | _Placed]" = ()


def _placed(blocks: Iterable[Block], prefix: str) -> list[Html | _Placed]:
    """Return blocks with figures drawn and an id for each section; equal titles are numbered."""
    found: list[Html | _Placed] = []
    taken: set[str] = set()
    for block in blocks:
        if isinstance(block, Html):
            found.append(block)
        elif isinstance(block, Figure):
            found.append(_Placed(kind="figure", title=block.title, drawing=drawing(block), caption=block.caption))
        elif isinstance(block, Grid):
            found.append(_Placed(kind="grid", blocks=_placed(block.items, prefix)))
        elif isinstance(block, Folded):
            inner = _placed(block.blocks, f"{block.identifier or prefix}-")
            found.append(
                _Placed(kind="folded", title=block.summary, identifier=block.identifier, name=block.name, blocks=inner)
            )
        else:
            wanted = prefix + slug(block.title)
            identifier, number = wanted, 2
            while identifier in taken:
                identifier, number = f"{wanted}-{number}", number + 1
            taken.add(identifier)
            inner = _placed(block.blocks, f"{identifier}-")
            found.append(_Placed(kind="section", title=block.title, identifier=identifier, blocks=inner))
    return found
