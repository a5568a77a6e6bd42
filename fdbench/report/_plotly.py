"""Figures of pages as plotly's own objects, for notebooks, in the colours of a light screen."""

import html
import re
from collections.abc import Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from fdbench.benchmark.statistics import LEVEL, Standing
from fdbench.report._figures import Band, Curve, Figure, Style, style_of
from fdbench.report._templates import resource

if TYPE_CHECKING:
    import plotly.graph_objects as go

TITLE_PX = 110
FILLED = {"full": "", "open": "-open", "half": "-open-dot"}


def plotly_figure(figure: Figure) -> "go.Figure":
    """Return a figure of a page for a notebook, with title and caption in it."""
    from plotly.subplots import make_subplots

    heights = [panel.height_px for panel in figure.panels]
    headings = [panel.heading and _plain(panel.heading) for panel in figure.panels]
    shown = make_subplots(len(heights), 1, shared_xaxes=True, row_heights=heights, subplot_titles=headings)
    named: set[str] = set()
    for row, panel in enumerate(figure.panels, start=1):
        for item in panel.items:
            listed = item.listed and item.name not in named
            named |= {item.name} if listed else set()
            for trace in _traces(item):
                shown.add_trace({"showlegend": listed, **trace}, row, 1)
        bounds = None if panel.y_range is None else list(panel.y_range)
        kind = "log" if panel.y_log else "linear"
        shown.update_yaxes(title_text=_plain(panel.y_title), range=bounds, type=kind, row=row)
    shown.update_xaxes(type="log" if figure.x_log else "linear")
    shown.update_xaxes(title_text=_plain(figure.x_title), row=len(heights))
    title = {"text": _plain(figure.title), "subtitle": {"text": _plain(figure.caption)}}
    return shown.update_layout(title=title, height=sum(heights) + 2 * TITLE_PX, margin_t=TITLE_PX)


def ranking_figure(ranking: Sequence[Standing]) -> "go.Figure":
    """Return the score of each estimator with its interval, the best on top."""
    import plotly.graph_objects as go

    shown = go.Figure()
    for line in ranking:
        style, score, name = style_of(line.estimator), line.score, _plain(line.estimator)
        error = {"array": [score.high - score.value], "arrayminus": [score.value - score.low]}
        marker = {"color": _coloured(style), "symbol": style.symbol + FILLED[style.fill], "size": 9}
        shown.add_scatter(x=[score.value], y=[name], name=name, mode="markers", marker=marker, error_x=error)
    shown.update_yaxes(categoryorder="array", categoryarray=[_plain(line.estimator) for line in reversed(ranking)])
    shown.update_xaxes(title_text="score (1: knows the truth, 0: has learnt nothing)")
    return shown.update_layout(title=f"Score with {LEVEL:.0%} interval", showlegend=False)


def _traces(item: Curve | Band) -> Iterator[dict[str, Any]]:
    colour = _coloured(item.style)
    shared = {"type": "scatter", "x": item.x, "name": _plain(item.name), "legendgroup": item.name}
    if item.hidden:
        shared["visible"] = "legendonly"
    if isinstance(item, Band):
        edge = {**shared, "mode": "lines", "line": {"width": 0, "color": colour}, "hoverinfo": "skip"}
        yield {**edge, "y": item.lower, "showlegend": False}
        yield {**edge, "y": item.upper, "fill": "tonexty", "fillcolor": colour if item.is_dense else f"{colour}33"}
    elif item.points:
        yield {**shared, "y": item.y, "mode": "markers", "marker": {"color": colour, "size": 4}}
    else:
        line = {"color": colour, "width": item.width, "dash": item.style.dash}
        yield {**shared, "y": item.y, "mode": "lines", "line": line}


def _plain(text: str) -> str:
    """Return text such that plotly shows it as it is."""
    return html.escape(text, quote=False)


def _coloured(style: Style) -> str:
    found = re.fullmatch(r"var\((--[\w-]+)\)", style.colour)
    return style.colour if found is None else _colours()[found[1]]


@cache
def _colours() -> dict[str, str]:
    return dict(re.findall(r"(--[\w-]+): (#\w+)", resource("figure.css").partition("@media")[0]))
