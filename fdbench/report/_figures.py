"""What figures are made of: colours, axes with units, long series thinned for the screen."""

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.run import NULL
from fdbench.regression import FloatArray
from fdbench.report._page import Figure, Trace
from fdbench.report._templates import Html, part

# What is drawn for comparison only and would hide the rest; a click on its name shows it.
LEGEND_ONLY = (NULL,)

# Place of the first estimator in a legend; what has none of its own comes before.
FIRST_RANK = 1001

INK, SOFT, GRID, TRUTH = "var(--ink)", "var(--soft)", "var(--grid)", "var(--truth)"

# Colours of the style sheet; the next estimators have them again with another line and marker.
N_COLOURS = 16
DASHES = ("solid", "dash", "dot")
SYMBOLS = ("circle", "square", "diamond")


@dataclass(frozen=True, kw_only=True)
class Style:
    """How an estimator is drawn: colour, dash of its lines, symbol of its points."""

    colour: str
    dash: str = "solid"
    symbol: str = "circle"

    @property
    def band(self) -> str:
        """The colour, mostly transparent."""
        return f"{self.colour}/33"


# A model before and after its repair.
BEFORE, AFTER = Style(colour="var(--series-0)"), Style(colour="var(--series-1)")


def styles_of(names: Sequence[str]) -> dict[str, Style]:
    """Return one style for each estimator; null and oracle are grey."""
    ordinary = sorted(set(names) - {NULL, ORACLE})
    styles = {
        name: Style(
            colour=f"var(--series-{number % N_COLOURS})",
            dash=DASHES[number // N_COLOURS % len(DASHES)],
            symbol=SYMBOLS[number // N_COLOURS % len(SYMBOLS)],
        )
        for number, name in enumerate(ordinary)
    }
    references = {NULL: Style(colour="var(--muted)", symbol="x"), ORACLE: Style(colour=SOFT, symbol="star")}
    return styles | {name: style for name, style in references.items() if name in names}


def legend(styles: Mapping[str, Style]) -> Html:
    """Return the colours of the page."""
    return part("legend", styles)


def named(name: str, style: Style) -> Html:
    """Return the name of an estimator behind its colour."""
    return part("named", name, style)


def labelled(text: str, unit: str) -> str:
    """Return the title of an axis."""
    return plain(f"{text} ({unit})" if unit else text)


def plain(text: str) -> str:
    """Return text such that plotly shows it as it is."""
    return html.escape(text, quote=False)


# ---- series ----


def encoded(values: FloatArray) -> dict[str, str]:
    """Return numbers as plotly reads them, 4 bytes each; what is not finite is a gap."""
    finite = np.where(np.isfinite(values), values, np.nan).astype("<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(finite.tobytes()).decode("ascii")}


def decoded(encoded: Mapping[str, str]) -> FloatArray:
    """Return the numbers that `encoded` made text of.

    >>> decoded(encoded(np.array([1.0, np.inf, -0.5])))
    array([ 1. ,  nan, -0.5])
    """
    return np.frombuffer(base64.b64decode(encoded["bdata"]), encoded["dtype"]).astype(np.float64)


def _abscissa(time_s: FloatArray) -> Trace:
    """Return times as start and step, which takes no room, where the steps are equal."""
    steps = np.diff(time_s)
    if len(steps) and np.ptp(steps) <= 1e-6 * abs(steps[0]):
        return {"x0": float(time_s[0]), "dx": float((time_s[-1] - time_s[0]) / len(steps))}
    return {"x": encoded(time_s)}


def line(name: str, time_s: FloatArray, values: FloatArray, style: Style, *, width: float = 1.2) -> Trace:
    """Return a line through points that are few enough already; see `thinned`."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": plain(name),
        "legendgroup": name,
        "line": {"color": style.colour, "width": width, "dash": style.dash},
        **_abscissa(time_s),
        "y": encoded(values),
    }


def band(
    name: str, time_s: FloatArray, lower: FloatArray, upper: FloatArray, style: Style, *, width: float = 0.0
) -> list[Trace]:
    """Return the filled area between two bounds."""
    edge = {
        "type": "scatter",
        "mode": "lines",
        "name": plain(name),
        "legendgroup": name,
        "showlegend": False,
        "hoverinfo": "skip",
        "line": {"color": style.colour, "width": width},
        **_abscissa(time_s),
    }
    return [edge | {"y": encoded(lower)}, edge | {"y": encoded(upper), "fill": "tonexty", "fillcolor": style.band}]


# ---- axes and layout ----


def axis(title: str) -> dict[str, Any]:
    """Return an axis."""
    return {
        "title": {"text": title, "standoff": 8},
        "automargin": True,
        "gridcolor": GRID,
        "zerolinecolor": GRID,
        "linecolor": GRID,
        "tickcolor": GRID,
    }


def layout(x: Mapping[str, Any], y: Mapping[str, Any]) -> dict[str, Any]:
    """Return the layout that all figures share, with a legend above."""
    return {
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"color": INK, "family": "system-ui, sans-serif", "size": 12},
        "margin": {"l": 56, "r": 12, "t": 8, "b": 44},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "bgcolor": "rgba(0,0,0,0)"},
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": SOFT, "activecolor": INK},
        "hoverlabel": {"namelength": -1},
        "xaxis": dict(x),
        "yaxis": dict(y),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """One of several figures on top of each other.

    Attributes
    ----------
    y_title : str
    traces : sequence of dict
    heading : str
        Text above.
    y_range : list of two floats, optional
        What the axis opens with; everything, if it is not given. A double click shows everything.
    height_px : int
    """

    y_title: str
    traces: Sequence[Trace]
    heading: str = ""
    y_range: list[float] | None = None
    height_px: int = 220


GAP_PX = 34


def stack(title: str, panels: Sequence[Panel], x_title: str, caption: str = "") -> Figure:
    """Return panels with one horizontal axis; a name is in the legend once, where it comes first."""
    total_px = sum(panel.height_px for panel in panels) + GAP_PX * (len(panels) - 1)
    result = layout(axis(x_title), {})
    traces: list[Trace] = []
    seen: set[str] = set()
    top_px = 0
    for number, panel in enumerate(panels, start=1):
        suffix = "" if number == 1 else str(number)
        domain = [1.0 - (top_px + panel.height_px) / total_px, 1.0 - top_px / total_px]
        top_px += panel.height_px + GAP_PX
        if panel.heading:
            result.setdefault("annotations", []).append(_heading(panel.heading, domain[1]))
        result[f"yaxis{suffix}"] = axis(panel.y_title) | {"domain": [max(0.0, domain[0]), domain[1]]}
        if panel.y_range is not None:
            result[f"yaxis{suffix}"]["range"] = panel.y_range
        for trace in panel.traces:
            shown = trace.get("showlegend", trace["legendgroup"] not in seen)
            if shown:
                seen.add(trace["legendgroup"])
            traces.append(trace | {"yaxis": f"y{suffix}", "showlegend": shown})
    result["xaxis"]["anchor"] = "y" if len(panels) == 1 else f"y{len(panels)}"
    if panels[0].heading:
        result["margin"]["t"] = GAP_PX
    if any(panel.y_range for panel in panels):
        caption = f"{caption} Single values outside of the range; a double click shows all.".lstrip()
    return Figure(title=title, traces=traces, layout=result, height_px=total_px + 110, caption=caption)


def _heading(text: str, y: float) -> dict[str, Any]:
    return {
        "text": plain(text),
        "x": 0,
        "y": y,
        "xref": "paper",
        "yref": "paper",
        "xanchor": "left",
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"size": 12},
    }


ROW_PX = 26


def dots(
    title: str,
    names: Sequence[str],
    values: FloatArray,
    bounds: FloatArray,
    styles: Mapping[str, Style],
    x_title: str,
) -> Figure:
    """Return a point with its interval for each estimator, the first one on top.

    Parameters
    ----------
    values : (n,) array
    bounds : (n, 2) array
        Lower and upper bound; NaN where none is known.
    """
    distances = np.nan_to_num(np.abs(bounds - values[:, None]), nan=0.0)
    traces = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": plain(name),
            "x": [float(value)],
            "y": [plain(name)],
            "showlegend": False,
            "marker": {"color": styles[name].colour, "symbol": styles[name].symbol, "size": 9},
            "error_x": {
                "type": "data",
                "array": [float(above)],
                "arrayminus": [float(below)],
                "color": styles[name].colour,
                "thickness": 2,
                "width": 5,
            },
        }
        for name, value, (below, above) in zip(names, values, distances, strict=True)
    ]
    rows = {"categoryorder": "array", "categoryarray": [plain(name) for name in reversed(names)]}
    vertical = axis("") | rows | {"range": [-0.6, len(names) - 0.4], "ticks": ""}
    reached = np.concatenate([[0.0], values, values - distances[:, 0], values + distances[:, 1]])
    low, high = float(reached.min()), float(reached.max())
    margin = 0.06 * (high - low) or 1.0
    horizontal = axis(x_title) | {"zerolinecolor": SOFT, "range": [low - margin, high + margin]}
    return Figure(
        title=title,
        traces=traces,
        layout=layout(horizontal, vertical) | {"dragmode": False},
        height_px=ROW_PX * len(names) + 84,
    )


BAR_PX = 24


def bars(
    title: str,
    names: Sequence[str],
    values: Sequence[float],
    x_title: str,
    caption: str = "",
    bounds: Sequence[Sequence[float]] = (),
) -> Figure:
    """Return a bar for each name, the first one on top, with its interval where there are ``bounds``."""
    trace = {
        "type": "bar",
        "orientation": "h",
        "x": list(values),
        "y": [plain(name) for name in names],
        "marker": {"color": BEFORE.colour},
        "hovertemplate": "%{y}: %{x:.3g}<extra></extra>",
        "showlegend": False,
    }
    high = max([*values, 0.0])
    if bounds:
        trace["error_x"] = {
            "type": "data",
            "symmetric": False,
            "array": [max(above - value, 0.0) for value, (_, above) in zip(values, bounds, strict=True)],
            "arrayminus": [max(value - below, 0.0) for value, (below, _) in zip(values, bounds, strict=True)],
            "color": INK,
            "thickness": 1,
            "width": 3,
        }
        high = max([high, *(above for _, above in bounds)])
    rows = {"categoryorder": "array", "categoryarray": [plain(name) for name in reversed(names)], "ticks": ""}
    horizontal = axis(x_title) | {"range": [0.0, 1.05 * high or 1.0], "zerolinecolor": GRID}
    return Figure(
        title=title,
        traces=[trace],
        layout=layout(horizontal, axis("") | rows) | {"dragmode": False},
        height_px=BAR_PX * len(names) + 84,
        caption=caption,
    )
