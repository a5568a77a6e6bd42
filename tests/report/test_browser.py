"""A page in a real browser: it opens, draws, sorts, filters, zooms, prints, and says nothing on the console."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from test_results_page import failed_run

from fdbench.benchmark.store import OK, Score, Store
from fdbench.report import write_report
from fdbench.report._figures import BEFORE, Curve, Figure, Panel, numbered
from fdbench.report._page import Folded, Section, write_page

playwright = pytest.importorskip("playwright.sync_api", reason="playwright, of the extra test, is not installed")

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason=f"no browser: none of {', '.join(BROWSERS)} is installed")

SCHEMES = ("light", "dark")

Opened: TypeAlias = Callable[..., Any]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=BROWSER)
        yield started
        started.close()


@pytest.fixture
def opened(browser: Any) -> Iterator[Opened]:
    """Return what opens a page; a word on the console of any fails the test."""
    said: list[str] = []
    context = browser.new_context()

    def opened(file: Path, width_px: int = 1280, scheme: str = "light") -> Any:
        page = context.new_page()
        page.set_viewport_size({"width": width_px, "height": 900})
        page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(file.as_uri())
        return page

    yield opened
    context.close()
    assert said == []


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = Store(tmp_path_factory.mktemp("results"))
    values = {"null": 100.0, "oracle": 0.0, "good": 1.0, "fair": 10.0, "an_estimator_of_a_long_name": 30.0}
    for name, value in values.items():
        score = Score(metric="parameter_error", unit="%", value=value)
        run = failed_run(name, "")
        store.write_run(type(run)(**{**vars(run), "status": OK, "scores": (score,)}))
    store.merge(store.run_keys())
    write_report(store.folder, store.folder / "report.html")
    return store.folder / "report.html"


@pytest.fixture(scope="module")
def curves(tmp_path_factory: pytest.TempPathFactory) -> Path:
    x = np.linspace(0.0, 10.0, 500)
    items = [
        Curve(name=name, x=x, y=(1 + number) * np.sin(x), style=style)
        for number, (name, style) in enumerate((("a", BEFORE), ("b", numbered(3))))
    ]
    figure = Figure(title="Curves", panels=[Panel(y_title="force (N)", items=items)], x_title="time (s)")
    path = tmp_path_factory.mktemp("curves") / "curves.html"
    write_page(
        path, "Curves", [], [Section("Open", [figure]), Section("Folded", [Folded("more", [figure], "id", "n")])]
    )
    return path


def test_tables_are_sorted_and_filtered(results: Path, opened: Opened) -> None:
    page = opened(results)
    rows, headings = page.locator(".ranking tr[data-name]"), page.locator(".ranking thead button")

    def names() -> list[str]:
        return [row.get_attribute("data-name") for row in rows.filter(visible=True).all()]

    ranked = ["good", "fair", "an_estimator_of_a_long_name"]
    assert names() == [*ranked, "oracle", "null"]
    headings.nth(0).click()
    assert names() == sorted([*ranked, "null", "oracle"])
    headings.nth(1).click()
    assert names() == ["oracle", *ranked, "null"]
    headings.nth(1).click()
    assert names() == ["null", *reversed(ranked), "oracle"]
    page.get_by_label("Filter estimators").fill("GOO")
    assert names() == ["good"]


def test_a_link_opens_what_is_folded(curves: Path, opened: Opened) -> None:
    page = opened(curves)
    inside = page.locator("#id .drawing")
    assert not inside.is_visible()
    page.evaluate("location.hash = '#id'")
    inside.wait_for(state="visible")


def test_shared_ticks_look_as_if_each_panel_had_its_own(
    tmp_path: Path, opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    item = Curve(name="a", x=np.arange(9.0), y=np.zeros(9), style=BEFORE)
    panels = [Panel(y_title="force (N)", items=[item], y_range=(-1.0, 1.0)) for _ in range(3)]
    sections = [Section("Open", [Figure(title="Curves", panels=panels, x_title="time (s)")])]
    file = tmp_path / "page.html"
    write_page(file, "Curves", [], sections)
    shared = [opened(file, scheme=scheme).screenshot() for scheme in SCHEMES]
    assert shared[0] != shared[1]
    monkeypatch.setattr("fdbench.report._page._shared", str)
    write_page(file, "Curves", [], sections)
    assert "<use" not in file.read_text("utf-8")
    assert [opened(file, scheme=scheme).screenshot() for scheme in SCHEMES] == shared


def test_curves_are_drawn_hidden_and_seen_closely(curves: Path, opened: Opened) -> None:
    page = opened(curves)
    drawing = page.locator(".drawing").first
    inner, path = drawing.locator(".curves"), drawing.locator("path").first
    box = inner.bounding_box()
    assert path.bounding_box()["width"] == pytest.approx(box["width"], rel=0.02)
    assert path.evaluate("path => getComputedStyle(path).stroke") == "rgb(31, 111, 180)"

    def ticks() -> list[float]:
        return [float(text) for text in drawing.locator(".ticks.x text").filter(visible=True).all_text_contents()]

    drawing.focus()
    assert ticks() == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    whole = drawing.screenshot()
    page.keyboard.press("+")
    assert ticks() == [3.0, 4.0, 5.0, 6.0, 7.0]
    assert drawing.screenshot() != whole
    page.keyboard.press("Escape")
    assert drawing.screenshot() == whole
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    time_s, force_N = (float(number) for number in page.locator(".readout").text_content().split("; "))
    assert (time_s, force_N) == (pytest.approx(5.0, abs=0.02), pytest.approx(0.0, abs=0.05))
    page.locator(".keys button").first.click()
    assert not path.is_visible()


def test_ticks_that_others_refer_to_stay(curves: Path, opened: Opened) -> None:
    page = opened(curves)
    page.locator("summary").click()
    first, second = page.locator(".drawing").all()
    assert second.locator("use").count() == 2
    apart = second.screenshot()
    first.focus()
    page.keyboard.press("+")
    assert second.screenshot() == apart
    second.focus()
    page.keyboard.press("+")
    assert second.screenshot() != apart


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("name", ["results", "curves"])
def test_a_narrow_screen_cuts_nothing(name: str, scheme: str, opened: Opened, request: pytest.FixtureRequest) -> None:
    """At 420 px nothing reaches over the edge that does not scroll by itself; in dark the paper is dark."""
    page = opened(request.getfixturevalue(name), 420, scheme)
    page.locator("details").evaluate_all("parts => parts.forEach((part) => { part.open = true; })")
    over = page.locator("body *").evaluate_all("""nodes => {
        const scrolls = (node) => node && (getComputedStyle(node).overflowX === "auto" || scrolls(node.parentElement));
        const isPart = (node) => !(node instanceof SVGElement) || node.classList.contains("drawing");
        const isOver = (node) => isPart(node) && node.getBoundingClientRect().right > 421 && !scrolls(node);
        return nodes.filter(isOver).map((node) => node.outerHTML.slice(0, 80));
    }""")
    assert over == []
    assert page.locator(".ranking .scored, .drawing").count()
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(20, 24, 28)" if scheme == "dark" else "rgb(255, 255, 255)")


def test_paper_is_white_and_has_nothing_to_type_into(results: Path, opened: Opened) -> None:
    page = opened(results, scheme="dark")
    field = page.get_by_label("Filter estimators")
    assert field.is_visible()
    page.emulate_media(media="print")
    assert not field.is_visible()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.pdf().startswith(b"%PDF")
