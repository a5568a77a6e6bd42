"""What figures are made of: styles, curves, bands, and panels above each other; `_svg` and `_plotly` draw them."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.selection import NULL
from fdbench.regression import FloatArray

INK, SOFT, TRUTH = "var(--ink)", "var(--soft)", "var(--truth)"

# Colours of the style sheet; with another dash or symbol they stand for other names.
N_COLOURS = 16
DASHES = ("solid", "dash", "dot")
SYMBOLS = ("circle", "square", "diamond")
# How symbols are filled, and how broad lines are then.
FILLS = {"full": 1.0, "open": 2.0, "half": 0.7}
SALT = "fdbench 515"  # with it no two estimators that came with the first pages look alike
NOT_FOR_FILLS = 3  # bytes at the end of a digest; without them no two that came since look alike

LINE_PX = 1.2  # of the style sheet too
MARGIN = 0.04  # of an axis beyond its values


@dataclass(frozen=True, kw_only=True)
class Style:
    """How a name is drawn: colour, dash of its lines, symbol beside it and how that is filled."""

    colour: str
    dash: str = "solid"
    symbol: str = "circle"
    fill: str = "full"

    @property
    def token(self) -> str:
        """The class of the colour in the style sheet."""
        return self.colour.removeprefix("var(--").removesuffix(")")

    @property
    def breadth(self) -> float:
        """What the width of a line is multiplied by that stands among others."""
        return FILLS[self.fill]

    @property
    def solid(self) -> "Style":
        """The same without dashes, for a line that is alone in its panel."""
        return replace(self, dash="solid")


# A model before and after its repair.
BEFORE, AFTER = Style(colour="var(--series-0)"), Style(colour="var(--series-1)")


def numbered(number: int) -> Style:
    """Return one of the styles; the first `N_COLOURS` are solid."""
    turn = number // N_COLOURS % len(DASHES)
    return Style(colour=f"var(--series-{number % N_COLOURS})", dash=DASHES[turn], symbol=SYMBOLS[turn])


def style_of(name: str) -> Style:
    """Return how an estimator or a model is drawn, on every page the same, whatever else is on it.

    It follows from the name alone, so two names of different authors may look alike (1 in 144); null and oracle are
    grey.
    """
    if name == NULL:
        return Style(colour="var(--muted)", symbol="diamond")
    if name == ORACLE:
        return Style(colour=SOFT)
    digest = hashlib.sha256(f"{SALT} {name}".encode()).digest()
    fill = int.from_bytes(digest[:-NOT_FOR_FILLS], "big") % len(FILLS)
    style = numbered(int.from_bytes(digest[:4], "big") % (N_COLOURS * len(DASHES)))
    return replace(style, fill=list(FILLS)[fill])


def styles_of(names: Sequence[str]) -> dict[str, Style]:
    """Return `style_of` each name, without dashes where their colours alone tell them apart."""
    styles = {name: style_of(name) for name in names}
    is_clear = len({style.colour for style in styles.values()}) == len(styles)
    return {name: style.solid if is_clear else style for name, style in styles.items()}


def labelled(text: str, unit: str) -> str:
    """Return the title of an axis."""
    return f"{text} ({unit})" if unit else text


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A line, or points, through values that are few enough already; NaN is a gap.

    Attributes
    ----------
    hidden : bool
        Not drawn until its name is clicked.
    listed : bool
        Whether its name is in the legend.
    """

    name: str
    x: FloatArray
    y: FloatArray
    style: Style
    width: float = LINE_PX
    points: bool = False
    hidden: bool = False
    listed: bool = True

    @property
    def ordinates(self) -> Sequence[FloatArray]:
        """All y, which an axis has to hold."""
        return (self.y,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Band:
    """The filled area between two bounds; NaN is a gap.

    Attributes
    ----------
    is_dense : bool
        It stands for a line that goes up and down within it, more often than can be seen.
    """

    name: str
    x: FloatArray
    lower: FloatArray
    upper: FloatArray
    style: Style
    is_dense: bool = False
    hidden: bool = False
    listed: bool = False

    @property
    def ordinates(self) -> Sequence[FloatArray]:
        """All y, which an axis has to hold."""
        return self.lower, self.upper


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """One of several diagrams above each other.

    Attributes
    ----------
    y_title : str
        With the unit.
    items : sequence of Curve and Band
        The last one is drawn on top.
    heading : str
        Stands above.
    y_range : pair of float, optional
        What is shown; everything, if it is not given.
    y_log : bool
    height_px : int
    """

    y_title: str
    items: Sequence[Curve | Band]
    heading: str = ""
    y_range: tuple[float, float] | None = None
    y_log: bool = False
    height_px: int = 220

    @property
    def shown_range(self) -> tuple[float, float]:
        """Bounds of the vertical axis."""
        if self.y_range is not None:
            return self.y_range
        return extent((part for item in self.items for part in item.ordinates), self.y_log, MARGIN)


@dataclass(frozen=True, kw_only=True, eq=False)
class Figure:
    """Panels with one horizontal axis.

    Attributes
    ----------
    title, caption : str
        Text above and below.
    panels : sequence of Panel
    x_title : str
        With the unit.
    x_log : bool
    x_range : pair of float, optional
        What is shown; everything, if it is not given.
    marks : sequence of (float, str)
        Vertical lines with what they are called.
    """

    title: str
    panels: Sequence[Panel]
    x_title: str
    caption: str = ""
    x_log: bool = False
    x_range: tuple[float, float] | None = None
    marks: Sequence[tuple[float, str]] = ()

    @property
    def shown_range(self) -> tuple[float, float]:
        """Bounds of the horizontal axis."""
        if self.x_range is not None:
            return self.x_range
        return extent((item.x for panel in self.panels for item in panel.items), self.x_log, 0.0)

    @property
    def legend(self) -> dict[str, Curve | Band]:
        """What is listed, by name, each once."""
        found: dict[str, Curve | Band] = {}
        for panel in self.panels:
            for item in panel.items:
                if item.listed:
                    found.setdefault(item.name, item)
        return found if len(found) > 1 else {}

    def curves(self) -> Iterator[Curve]:
        """Yield all curves of all panels."""
        yield from (item for panel in self.panels for item in panel.items if isinstance(item, Curve))


LOG_RANGE = 1e-150, 1e150


def extent(series: Iterable[FloatArray], log: bool, margin: float) -> tuple[float, float]:
    """Return bounds that hold all finite values, and a share of their span on each side; never equal ones.

    On a logarithmic axis what is beyond `LOG_RANGE` counts as its end, as ratios of such values are not computed with.

    >>> extent([np.array([0.0, 10.0, np.nan])], False, 0.1), extent([np.ones(3)], False, 0.0)
    ((-1.0, 11.0), (0.5, 1.5))
    >>> extent([np.array([5e-324, 1.0])], True, 0.0)
    (1e-150, 1.0)
    """
    values = np.concatenate([np.empty(0), *series])
    values = values[np.isfinite(values) & ((values > 0.0) | (not log))]
    if len(values) == 0:
        return (1.0, 10.0) if log else (0.0, 1.0)
    values = np.clip(values, *LOG_RANGE) if log else values
    low, high = float(values.min()), float(values.max())
    if log:
        ratio = (high / low) ** margin if high > low else 2.0
        return low / ratio, high * ratio
    span = margin * (high - low) if high > low else 0.5 * (abs(low) or 1.0)
    return low - span, high + span
