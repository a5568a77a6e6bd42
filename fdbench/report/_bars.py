"""Bars and points in rows, one for each name, as tables that are read without a picture too."""

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from fdbench.report._figures import extent
from fdbench.report._templates import Html, part
from fdbench.report._ticks import linear_ticks, log_ticks, tick_texts
from fdbench.wording import number, percent

Pair: TypeAlias = tuple[float, float]
UNDRAWN = 0.005  # share below which a rest is rounding


def bars(
    title: str,
    names: Sequence[str],
    values: Sequence[float],
    *,
    bounds: Sequence[Pair] = (),
    whole: float | None = None,
    longest: float | None = None,
    text: Callable[[float], str] = percent,
    caption: str = "",
) -> Html:
    """Return a bar for each name, the first one on top, with its interval where there are ``bounds``.

    Parameters
    ----------
    whole : float, optional
        What the values are parts of: what they lack of it is a bar too.
    longest : float, optional
        What a bar of full length stands for; the largest value or bound, if it is not given.
    """
    values, names = list(values), list(names)
    if whole is not None and whole - sum(values) > UNDRAWN:
        values, names = [*values, whole - sum(values)], [*names, "the rest"]
    full = longest or max([*values, *(high for _, high in bounds), 0.0]) or 1.0
    rows = [
        {
            "name": name,
            "text": text(value),
            "bar": _within(value / full),
            "dot": None,
            "interval": _interval(*bounds[place], lambda x: x / full) if place < len(bounds) else None,
        }
        for place, (name, value) in enumerate(zip(names, values, strict=True))
    ]
    return part("bars", title, rows, (), caption)


def dots(
    title: str,
    names: Sequence[str],
    values: Sequence[float],
    bounds: Sequence[Pair] = (),
    *,
    log: bool = False,
    texts: Sequence[str] = (),
    caption: str = "",
) -> Html:
    """Return a point with its interval for each name, on an axis that is drawn below; NaN bounds are not known."""
    known = np.array([*values, *(edge for pair in bounds for edge in pair)])
    low, high = extent([known] if log else [known, np.zeros(1)], log, 0.03)

    def place(value: float) -> float:
        if log:
            return math.log(max(value, low) / low) / math.log(high / low)
        return (value - low) / (high - low)

    ticks = log_ticks(low, high) if log else linear_ticks(low, high)
    rows = [
        {
            "name": name,
            "text": texts[index] if texts else number(value),
            "bar": None,
            "dot": _within(place(value)),
            "interval": _interval(*bounds[index], place) if index < len(bounds) else None,
        }
        for index, (name, value) in enumerate(zip(names, values, strict=True))
    ]
    axis = [(_within(place(tick)), words) for tick, words in zip(ticks, tick_texts(ticks), strict=True)]
    return part("bars", title, rows, axis, caption)


def _within(share: float) -> float:
    """Return a share in per cent, inside of the drawing."""
    return round(100.0 * min(max(share, 0.0), 1.0), 2)


def _interval(low: float, high: float, place: Callable[[float], float]) -> Pair | None:
    """Return where an interval begins and how long it is, in per cent."""
    if math.isnan(low) or math.isnan(high):
        return None
    start, end = _within(place(low)), _within(place(high))
    return start, round(end - start, 2)
