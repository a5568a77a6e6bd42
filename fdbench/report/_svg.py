"""Figures as SVG: paths in a coordinate system of their own that stretches with the page, text that does not.

Each panel is an ``svg`` of a height in pixels, whose width is that of the page; ticks and grid are placed in per cent.
Its curves lie in an inner ``svg`` with whole units of its own that is stretched to it, and their lines are not.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fdbench.regression import FloatArray
from fdbench.report._figures import LINE_PX, Band, Curve, Figure, Panel, Style
from fdbench.report._templates import Html, part, rendered, resource
from fdbench.report._ticks import linear_ticks, log_ticks, tick_texts

FEWEST_UNITS, MOST_UNITS = 500, 3000  # of the width, one for each point
UNITS_A_PX = 3  # of the height
UNSEEN = 1  # units of height that a line may be off where a straight one takes the place of several
FAR = 4  # heights beyond which what is outside of the panel is not told apart
LEFT_PX, RIGHT_PX, HEAD_PX, FOOT_PX = 54, 14, 24, 46
TICK_PX = 40  # between horizontal grid lines
FILE_PX = 960  # width of a file of its own

Integers: TypeAlias = NDArray[np.int64]
Scale: TypeAlias = Callable[[FloatArray], FloatArray]


def drawing(figure: Figure) -> Html:
    """Return a figure for a page, without title and caption, its legend above."""
    return part("drawing", _drawn(figure))


def svg_file(figure: Figure) -> str:
    """Return a figure as the text of an SVG file, in the colours of a light or a dark screen."""
    drawn = _drawn(figure)
    return str(
        rendered(
            "figure.svg",
            css=resource("figure.css"),
            drawn=drawn,
            width_px=FILE_PX,
            height_px=drawn.height_px + (HEAD_PX if drawn.keys else 0),
            left_px=LEFT_PX,
            right_px=RIGHT_PX,
        )
    )


@dataclass(frozen=True, kw_only=True)
class _DrawnPanel:
    """A panel with the place of its upper edge, ticks in per cent from above, and paths in units."""

    panel: Panel
    top_px: int
    high: int
    y_ticks: Sequence[tuple[float, str]]
    y_bounds: str
    paths: Html


@dataclass(frozen=True, kw_only=True)
class _Drawn:
    """A figure with all that its template places; keys are class, name, style and whether it is hidden."""

    title: str
    keys: Sequence[tuple[str, str, Style, bool]]
    panels: Sequence[_DrawnPanel]
    wide: int
    x_ticks: Sequence[tuple[float, str]]
    x_bounds: str
    x_title: str
    marks: Sequence[tuple[float, str]]
    top_px: int
    bottom_px: int
    height_px: int


def _keys(figure: Figure) -> list[tuple[str, str, Style, bool]]:
    """Return class, name, style and whether it is hidden of each entry of the legend."""
    return [(f"c{number}", name, item.style, item.hidden) for number, (name, item) in enumerate(figure.legend.items())]


def _scale(bounds: tuple[float, float], log: bool, size: int) -> Scale:
    """Return what takes values to 0 ... ``size``."""
    low, high = np.log10(bounds) if log else np.array(bounds)

    def scale(values: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            levels = np.log10(values) if log else values
        return np.asarray((levels - low) / (high - low) * size)

    return scale


def _drawn(figure: Figure) -> _Drawn:
    x_bounds, keys, panels, top_px = figure.shown_range, _keys(figure), [], 0
    x_ticks = log_ticks(*x_bounds) if figure.x_log else linear_ticks(*x_bounds)
    n_points = max(len(item.x) for panel in figure.panels for item in panel.items)
    wide = min(max(n_points, FEWEST_UNITS), MOST_UNITS)
    to_x = _scale(x_bounds, figure.x_log, wide)
    classes = {name: key for key, name, _, _ in keys}
    for panel in figure.panels:
        y_bounds = panel.shown_range
        about = max(3, panel.height_px // TICK_PX)
        y_ticks = log_ticks(*y_bounds) if panel.y_log else linear_ticks(*y_bounds, about)
        high = UNITS_A_PX * panel.height_px
        to_y = _scale(y_bounds, panel.y_log, high)
        panels.append(
            _DrawnPanel(
                panel=panel,
                top_px=top_px + HEAD_PX,
                y_ticks=[(round(100.0 - place, 2), text) for place, text in _placed(y_ticks, to_y, high)],
                y_bounds=_bounds(y_bounds, panel.y_log),
                high=high,
                paths=Html("\n").join(
                    _path(item, to_x, to_y, high, classes.get(item.name, "")) for item in panel.items
                ),
            )
        )
        top_px += HEAD_PX + panel.height_px
    return _Drawn(
        title=figure.title,
        keys=keys,
        panels=panels,
        wide=wide,
        x_ticks=_placed(x_ticks, to_x, wide),
        x_bounds=_bounds(x_bounds, figure.x_log),
        x_title=figure.x_title,
        marks=[(round(100.0 / wide * float(to_x(np.array(x))), 3), text) for x, text in figure.marks],
        top_px=HEAD_PX,
        bottom_px=top_px,
        height_px=top_px + FOOT_PX,
    )


def _placed(ticks: Sequence[float], scale: Scale, size: int) -> list[tuple[float, str]]:
    places = 100.0 / size * scale(np.array(ticks))
    return [(round(float(place), 2), text) for place, text in zip(places, tick_texts(ticks), strict=True)]


def _bounds(bounds: tuple[float, float], log: bool) -> str:
    """Return what a script needs to read values off an axis."""
    return " ".join([*(f"{value:.7g}" for value in bounds), *(["log"] if log else [])])


def _path(item: Curve | Band, to_x: Scale, to_y: Scale, high: int, key: str) -> Html:
    classes = [item.style.token, key, "off" if item.hidden else ""]
    if isinstance(item, Band):
        classes.append("dense" if item.is_dense else "band")
        width, data = 0.0, _area(item, to_x, to_y, high)
    elif item.points:
        classes.append("round" if item.style.symbol == "circle" else "angular")
        width, data = 4.0 * item.width, commands(to_x(item.x), to_y(item.y), high, points=True)
    else:
        classes.append("" if item.style.dash == "solid" else item.style.dash)
        width, data = item.width, commands(to_x(item.x), to_y(item.y), high)
    return part(
        "path", " ".join(filter(None, classes)), "" if width in (0.0, LINE_PX) else f"{width:g}", data, item.name
    )


def _area(item: Band, to_x: Scale, to_y: Scale, high: int) -> str:
    """Return the outlines of a band, one for each stretch between gaps."""
    there = np.isfinite(item.lower) & np.isfinite(item.upper)
    text = ""
    for rows in _stretches(there):
        x, upper, lower = to_x(item.x[rows]), to_y(item.upper[rows]), to_y(item.lower[rows])
        forth, back = _straight(*_units(x, upper, high)), _straight(*_units(x, lower, high))[::-1]
        text += _run(np.concatenate([forth, back])) + "z"
    return text


def _stretches(there: NDArray[np.bool_]) -> list[Integers]:
    """Return the rows of each stretch without gaps."""
    parts = np.split(np.arange(len(there)), np.flatnonzero(np.diff(there)) + 1)
    return [rows for rows in parts if len(rows) and there[rows[0]]]


def commands(x: FloatArray, y: FloatArray, high: int, points: bool = False) -> str:
    """Return a line, or points, through places in units, as the data of a path; y points upwards, NaN is a gap.

    >>> commands(np.array([0.0, 1.2, 3.0, 4.0, 5.0]), np.array([300.0, 290.0, np.nan, 0.0, 1.0]), 300)
    'M0 0l1 10M4 300l1-1'
    >>> commands(np.array([2.0, 7.0]), np.array([200.0, 190.0]), 300, points=True)
    'M2 100h0M7 110h0'
    """
    there = np.isfinite(x) & np.isfinite(y)
    if points:
        across, down = _units(x[there], y[there], high)
        return "".join(f"M{u} {v}h0" for u, v in zip(across.tolist(), down.tolist(), strict=True))
    return "".join(_run(_straight(*_units(x[rows], y[rows], high))) for rows in _stretches(there))


def _units(x: FloatArray, y: FloatArray, high: int) -> tuple[Integers, Integers]:
    """Return places in whole units, from the upper left corner."""
    down = np.clip(high - y, -FAR * high, FAR * high)
    return np.rint(x).astype(np.int64), np.rint(down).astype(np.int64)


def _straight(across: Integers, down: Integers) -> Integers:
    """Return the corners, (n, 2), of a line to the right that passes all places within `UNSEEN`.

    >>> _straight(np.array([0, 1, 2, 3, 4]), np.array([0, 2, 3, 6, 0])).tolist()
    [[0, 0], [3, 6], [4, 0]]
    """
    places = list(zip(across.tolist(), down.tolist(), strict=True))
    corners, last = places[:1], places[0]
    low, high = -math.inf, math.inf  # slopes from the last corner that pass all places since
    for place in places[1:]:
        width, depth = place[0] - corners[-1][0], place[1] - corners[-1][1]
        if width == 0 or not low * width <= depth <= high * width:
            if last != corners[-1]:
                corners.append(last)
            width, depth = place[0] - last[0], place[1] - last[1]
            low, high = -math.inf, math.inf
        if width == 0:
            corners.append(place)
        else:
            low, high = max(low, (depth - UNSEEN) / width), min(high, (depth + UNSEEN) / width)
        last = place
    if last != corners[-1]:
        corners.append(last)
    return np.array(corners)


def _run(corners: Integers) -> str:
    start = f"M{corners[0, 0]} {corners[0, 1]}"
    steps = np.diff(corners, axis=0)
    steps = steps[(steps != 0).any(axis=1)]
    if len(steps) == 0:
        return f"{start}h0"
    return f"{start}l" + " ".join(map(str, steps.ravel().tolist())).replace(" -", "-")
