"""Figures of pages as plotly's own objects, for notebooks."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from fdbench.report._figures import decoded, plain
from fdbench.report._page import Figure
from fdbench.report._templates import resource

if TYPE_CHECKING:
    import plotly.graph_objects as go

TITLE_PX = 110


def plotly_figure(figure: Figure) -> "go.Figure":
    """Return a figure of a page for a notebook: title and caption in it, the colours those of a light screen."""
    import plotly.graph_objects as go

    colours = dict(re.findall(r"(--[\w-]+): (#\w+)", resource("page.css").partition("@media")[0]))

    def coloured(node: Any) -> Any:
        if isinstance(node, Mapping) and "bdata" in node:
            return decoded(node)
        if isinstance(node, Mapping):
            return {key: coloured(item) for key, item in node.items()}
        if isinstance(node, list | tuple):
            return [coloured(item) for item in node]
        found = re.fullmatch(r"var\((--[\w-]+)\)(?:/(\w\w))?", node) if isinstance(node, str) else None
        return node if found is None else colours[found[1]] + (found[2] or "")

    shown = go.Figure(coloured(list(figure.traces)), coloured(figure.layout))
    title = {"text": plain(figure.title), "subtitle": {"text": plain(figure.caption)}}
    shown.update_layout(title=title, height=figure.height_px + TITLE_PX, margin_t=TITLE_PX)
    return shown
