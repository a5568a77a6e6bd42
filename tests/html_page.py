"""A page taken apart: tags, words, and the values of the curves that are drawn on it."""

import re
from dataclasses import dataclass, field
from html import unescape
from html.parser import HTMLParser
from typing import NamedTuple

import numpy as np

VOID = {"meta", "wbr", "link", "img", "br", "input"}


@dataclass
class Panel:
    """A panel with its bounds and the data of its paths by name."""

    bounds: list[float]
    title: str = ""
    paths: list[tuple[str, str]] = field(default_factory=list)
    wide: float = 0.0
    high: float = 0.0

    @property
    def resolution(self) -> float:
        """What one unit of height stands for."""
        return (self.bounds[3] - self.bounds[2]) / self.high

    def curve(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the values that the uppermost path of a name goes through."""
        *_, data = [data for own, data in self.paths if own == name]
        x, y = places(data).T
        low, high, bottom, top, x_log, _ = self.bounds
        share = x / self.wide
        return low * (high / low) ** share if x_log else low + share * (high - low), top - (
            top - bottom
        ) * y / self.high


def places(data: str) -> np.ndarray:
    """Return the points of a path in its own units, (n, 2)."""
    found: list[tuple[float, float]] = []
    for command, numbers in re.findall(r"([Mlhz])([^Mlhz]*)", data):
        pairs = [int(number) for number in re.findall(r"-?\d+", numbers)]
        if command in "hz":
            continue
        for dx, dy in zip(pairs[::2], pairs[1::2], strict=True):
            x, y = found[-1] if command == "l" else (0.0, 0.0)
            found.append((x + dx, y + dy))
    return np.array(found)


class Row(NamedTuple):
    """A name with its number, and in per cent the length of its bar, the place of its point, and its interval."""

    name: str
    text: str
    bar: list[float]
    dot: list[float]
    interval: list[float]


def _place(drawn: str, tag: str) -> list[float]:
    found = re.search(rf'<{tag} style="(.*?)"', drawn)
    return [float(number) for number in re.findall(r"[\d.]+(?=%)", found[1])] if found else []


class Page(HTMLParser):
    """A page taken apart; a tag that is not closed where it should be is an error."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.text = text
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.headings: list[str] = []
        self.words: list[str] = []
        self.figures: dict[str, list[Panel]] = {}
        self.path = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        own = dict(attrs)
        self.tags.append((tag, own))
        if tag not in VOID:
            self.open.append(tag)
        if re.fullmatch(r"h\d", tag):
            self.headings.append("")
        if own.get("class") == "drawing":
            self.x_bounds = (own["data-bounds"] or "").split()
            title = self.headings[-1] if self.headings else ""
            number = sum(name.startswith(f"{title} #") or name == title for name in self.figures)
            self.shown = self.figures.setdefault(f"{title} #{number}" if number else title, [])
        if own.get("class") == "panel":
            x, y = self.x_bounds, (own["data-bounds"] or "").split()
            self.shown.append(Panel([*map(float, (*x[:2], *y[:2])), "log" in x, "log" in y]))
        if own.get("class") == "curves":
            _, _, self.shown[-1].wide, self.shown[-1].high = map(float, (own["viewbox"] or "").split())
        if tag == "path":
            self.path = own["d"] or ""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-2:] == ["path", "title"]:
            self.shown[-1].paths.append((data, self.path))
        elif self.open[-1:] not in (["style"], ["script"]):
            self.words.append(data)
            if "text" in self.open and self.figures and self.shown and not self.shown[-1].title:
                self.shown[-1].title = data
            if any(re.fullmatch(r"h\d", tag) for tag in self.open):
                self.headings[-1] += data

    @property
    def spoken(self) -> str:
        """All words, white space made one."""
        return " ".join(" ".join(self.words).split())

    @property
    def bars(self) -> dict[str, list["Row"]]:
        """Rows of bars and points by the title above them, the first of a title."""
        found: dict[str, list[Row]] = {}
        for title, rows in re.findall(
            r'<figure class="bars"><table><caption>(.*?)</caption><tbody>(.*?)</tbody>', self.text, re.DOTALL
        ):
            pattern = (
                r'<th scope="row">(.*?)</th><td><span class="track">(.*?)</span></td><td class="number">(.*?)</td>'
            )
            drawn_rows = [
                Row(unescape(name), unescape(text), *(_place(drawn, tag) for tag in "bui"))
                for name, drawn, text in re.findall(pattern, rows, re.DOTALL)
            ]
            found.setdefault(unescape(title), drawn_rows)
        return found

    def attributes(self, name: str) -> list[str]:
        """Return all values of an attribute."""
        return [value for _, attributes in self.tags if (value := attributes.get(name)) is not None]
