"""Figures as pages, files and notebooks have them: the same values, styles that follow from names, readable ticks."""

import hashlib
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from html_page import Page

from fdbench.estimator import estimators
from fdbench.report._bars import bars, dots
from fdbench.report._figures import BEFORE, Band, Curve, Figure, Panel, extent, numbered, style_of
from fdbench.report._page import Section, page
from fdbench.report._plotly import plotly_figure
from fdbench.report._svg import UNSEEN, _straight, svg_file
from fdbench.report._ticks import linear_ticks, log_ticks, tick_texts

HOSTILE = "<script>alert(1)</script> & \"quoted\" 'text'"
X = np.linspace(0.5, 4.5, 800)
RELEASED = {
    "frequency_least_squares": (1, "dot"),
    "hybrid_rls": (0, "dot"),
    "idim_iv": (9, "dash"),
    "kalman": (2, "dash"),
    "kalman_central": (0, "solid"),
    "kalman_consensus": (7, "dash"),
    "kalman_distributed": (11, "dash"),
    "kalman_parallel": (13, "solid"),
    "kalman_weighted": (15, "dash"),
    "krls_t": (10, "dash"),
    "least_squares": (5, "dot"),
    "linear_regression": (14, "dot"),
    "lr_nfb": (2, "dot"),
    "order_tracking_ridge": (14, "solid"),
    "output_error": (4, "dot"),
    "physics_model": (13, "dot"),
    "pl_lssvm": (12, "dot"),
    "slr_nfb": (8, "dot"),
    "state_space_gp": (3, "dot"),
}


def figure(name: str = "sine", **changes: object) -> Figure:
    """Return a sine with a gap, and below it its band and points."""
    y = np.sin(3.0 * X)
    y[100:120] = np.nan
    sine = Curve(name=name, x=X, y=y, style=BEFORE)
    band = Band(name="bounds", x=X, lower=np.cos(X) - 0.5, upper=np.cos(X) + 0.5, style=numbered(3))
    points = Curve(name="points", x=X[::100], y=np.cos(X[::100]), style=numbered(2), points=True)
    panels = [Panel(y_title="force (N)", items=[sine]), Panel(y_title="force (N)", items=[band, points])]
    return replace(Figure(title="Two", panels=panels, x_title="time (s)"), **changes)


def drawn(one: Figure) -> Page:
    return Page(page("t", [], [Section("s", [one])]))


@pytest.mark.parametrize("x_log", [False, True])
def test_drawn_values_are_those_of_the_figure(x_log: bool) -> None:
    shown = drawn(figure(x_log=x_log))
    first, second = shown.figures["Two"]
    x, y = first.curve("sine")
    there = np.isfinite(figure().panels[0].items[0].ordinates[0])
    expected = np.interp(x, X[there], np.sin(3.0 * X[there]))
    slope = 3.0 * (X[-1] - X[0]) / first.wide * (3.0 if x_log else 1.0)
    np.testing.assert_allclose(y, expected, atol=first.resolution + slope)
    assert not ((x > X[102]) & (x < X[117])).any()  # the gap
    x, y = second.curve("points")
    np.testing.assert_allclose(y, np.cos(X[::100]), atol=second.resolution)
    np.testing.assert_allclose(x, X[::100], atol=(X[-1] - X[0]) / second.wide * (3.0 if x_log else 1.0))
    (band,) = [data for name, data in second.paths if name == "bounds"]
    assert band


def test_an_svg_file_stands_alone_and_is_sound() -> None:
    root = ET.fromstring(svg_file(figure(HOSTILE)))
    texts = [element.text for element in root.iter() if element.text]
    assert HOSTILE in texts
    assert not [element for element in root.iter() if element.tag.endswith("script")]
    assert len([element for element in root.iter() if element.get("class") == "curves"]) == 2


def test_notebooks_have_the_same_values() -> None:
    shown = plotly_figure(figure(HOSTILE))
    (sine,) = [trace for trace in shown.data if trace.name and trace.name.startswith("&lt;script")]
    np.testing.assert_array_equal(np.asarray(sine.y), figure().panels[0].items[0].ordinates[0])
    assert "var(--" not in shown.to_json()


def test_names_are_escaped_in_figures() -> None:
    shown = drawn(figure(HOSTILE, title=HOSTILE, caption=HOSTILE))
    assert [tag for tag, _ in shown.tags].count("script") == 1
    assert shown.figures[HOSTILE][0].paths[0][0] == HOSTILE


# ---- styles ----


def test_a_name_has_its_style_for_ever() -> None:
    """A change here recolours every page: of released names, never."""
    assert {name: (style_of(name).colour, style_of(name).dash) for name in RELEASED} == {
        name: (f"var(--series-{number})", dash) for name, (number, dash) in RELEASED.items()
    }


def test_released_estimators_can_be_told_apart() -> None:
    styles = {(style.colour, style.symbol) for style in map(style_of, RELEASED)}
    assert len(styles) == len(RELEASED)
    colours = [style_of(name).colour for name in RELEASED]
    assert max(colours.count(colour) for colour in colours) <= 2


def test_no_two_registered_estimators_look_alike() -> None:
    names = estimators.names()
    assert {*RELEASED} < {*names}
    assert len({*map(style_of, names)}) == len(names)


def test_names_spread_over_all_styles() -> None:
    names = [hashlib.sha256(str(number).encode()).hexdigest() for number in range(2000)]
    assert len({(style.colour, style.dash) for style in map(style_of, names)}) == 48
    assert len({*map(style_of, names)}) == 144


def test_a_straight_line_takes_the_place_of_places_that_it_passes() -> None:
    across = np.arange(1000)
    down = np.rint(300.0 * np.sin(0.02 * across) + np.random.default_rng(1).normal(0.0, 0.4, 1000)).astype(np.int64)
    corners = _straight(across, down)
    assert len(corners) < 0.25 * len(across)
    assert np.abs(np.interp(across, *corners.T) - down).max() <= UNSEEN + 1e-9
    assert {tuple(corner) for corner in corners.tolist()} <= {*zip(across.tolist(), down.tolist(), strict=True)}
    assert corners[[0, -1]].tolist() == [[0, down[0]], [999, down[-1]]]
    assert _straight(np.array([3, 3, 3]), np.array([0, 9, 4])).tolist() == [[3, 0], [3, 9], [3, 4]]


# ---- ticks ----


def test_ticks_are_few_round_and_inside() -> None:
    rng = np.random.default_rng(5)
    for low, span in zip(rng.normal(size=200), 10.0 ** rng.uniform(-6.0, 6.0, 200), strict=True):
        ticks = linear_ticks(low, low + span)
        assert 3 <= len(ticks) <= 9
        assert low - 1e-6 * span <= ticks[0]
        assert ticks[-1] <= low + 1.000001 * span


def test_ticks_of_a_logarithmic_axis_are_whole_numbers_with_all_their_digits() -> None:
    assert tick_texts(log_ticks(0.5, 12.0)) == ["0.5", "1", "2", "5", "10"]
    assert tick_texts(log_ticks(0.3, 500.0)) == ["1", "10", "100"]
    assert tick_texts(log_ticks(1e-9, 1e9))[0] == "10⁻⁹"
    assert len(log_ticks(1e-9, 1e9)) <= 7


def test_an_extent_is_never_empty() -> None:
    for log in (False, True):
        for values in ([], [np.nan], [0.0, 0.0], [3.0]):
            low, high = extent([np.array(values, dtype=float)], log, 0.0)
            assert low < high


# ---- bars ----


def test_what_a_whole_lacks_is_drawn() -> None:
    rows = Page(str(bars("Shares", ["a", "b"], [0.7, 0.25], whole=1.0))).bars["Shares"]
    assert [(row.name, row.text) for row in rows] == [("a", "70 %"), ("b", "25 %"), ("the rest", "5 %")]


def test_points_on_a_logarithmic_axis_are_equal_ratios_apart() -> None:
    rows = Page(str(dots("Gap", ["a", "b", "c"], [196.0, 14.0, 1.0], log=True))).bars["Gap"]
    (first,), (second,), (third,) = (row.dot for row in rows)
    assert first - second == pytest.approx(second - third, abs=0.03)
    assert [row.text for row in rows] == ["196", "14", "1"]
