"""A page in a real browser: it opens, draws, sorts, filters, zooms, and says nothing on the console."""

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from test_results_page import failed_run

from fdbench.benchmark.store import OK, Score, Store
from fdbench.report import write_report
from fdbench.report._figures import BEFORE, Curve, Figure, Panel, numbered
from fdbench.report._page import Folded, Section, write_page

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason=f"no browser: none of {', '.join(BROWSERS)} is installed")

DARK = ("--force-dark-mode", "--blink-settings=preferredColorScheme=0")

# Stands before all else on the page, and hears what goes wrong.
LISTEN = """<script>
window.said = [];
for (const level of ["log", "info", "warn", "error"]) console[level] = (...words) => said.push(words.join(" "));
addEventListener("error", (event) => said.push(event.message));
addEventListener("securitypolicyviolation", (event) => said.push(event.violatedDirective));
</script>"""

# Stands behind all else, and leaves what it has found in the page.
ACT = """<script>
(async () => {
  const found = {};
  const frame = () => new Promise((done) => setTimeout(done, 30));
  try { %s } catch (error) { said.push(String(error)); }
  await frame();
  document.body.dataset.found = JSON.stringify({ ...found, said });
})();
</script>"""

NAMES = 'const names = () => [...document.querySelectorAll(".ranking tr[data-name]")]'


def played(page: Path, actions: str, width_px: int = 1280, *options: str) -> dict[str, object]:
    """Return what a script found on a page, with what was said on the console."""
    text = page.read_text("utf-8")
    head, _, rest = text.partition("<head>")
    changed = page.with_name("played.html")
    changed.write_text(f"{head}<head>{LISTEN}{rest.replace('</body>', ACT % actions + '</body>')}", "utf-8")
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--window-size={width_px},900", *options]
    command += ["--virtual-time-budget=4000", "--dump-dom", changed.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    (found,) = re.findall(r'data-found="(.*?)"', done.stdout)
    answer: dict[str, object] = json.loads(unescape(found))
    return answer


def seen(page: Path, *options: str) -> bytes:
    """Return what a page looks like, as a picture."""
    picture = page.with_name("seen.png")
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--window-size=800,900", *options]
    subprocess.run([*command, f"--screenshot={picture}", page.as_uri()], capture_output=True, timeout=60, check=True)
    return picture.read_bytes()


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


def test_tables_are_sorted_and_filtered(results: Path) -> None:
    found = played(
        results,
        NAMES
        + """.map((row) => row.dataset.name);
        found.first = names();
        const buttons = [...document.querySelectorAll(".ranking thead button")];
        buttons[0].click(); found.byName = names();
        buttons[1].click(); found.byScore = names();
        buttons[1].click(); found.worst = names();
        const input = document.querySelector("input[data-filters*=ranking]");
        found.offered = !input.hidden;
        input.value = "GOO"; input.dispatchEvent(new Event("input"));
        found.left = [...document.querySelectorAll(".ranking tr[data-name]")].filter((row) => row.offsetHeight).length;
        """,
    )
    names = ["good", "fair", "an_estimator_of_a_long_name"]
    assert found["first"] == [*names, "oracle", "null"]
    assert found["byName"] == sorted([*names, "null", "oracle"])
    assert found["byScore"] == ["oracle", *names, "null"]
    assert found["worst"] == ["null", *reversed(names), "oracle"]
    assert (found["offered"], found["left"], found["said"]) == (True, 1, [])


def test_a_link_opens_what_is_folded(curves: Path) -> None:
    found = played(
        curves,
        """
        const part = document.getElementById("id");
        found.before = part.open;
        location.hash = "#id";
        await frame();
        found.after = part.open;
        """,
    )
    assert (found["before"], found["after"], found["said"]) == (False, True, [])


def test_shared_ticks_look_as_if_each_panel_had_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    item = Curve(name="a", x=np.arange(9.0), y=np.zeros(9), style=BEFORE)
    panels = [Panel(y_title="force (N)", items=[item], y_range=(-1.0, 1.0)) for _ in range(3)]
    sections = [Section("Open", [Figure(title="Curves", panels=panels, x_title="time (s)")])]
    write_page(tmp_path / "page.html", "Curves", [], sections)
    shared = [seen(tmp_path / "page.html", *options) for options in ((), DARK)]
    assert shared[0] != shared[1]
    monkeypatch.setattr("fdbench.report._page._shared", str)
    write_page(tmp_path / "page.html", "Curves", [], sections)
    assert "<use" not in (tmp_path / "page.html").read_text("utf-8")
    assert [seen(tmp_path / "page.html", *options) for options in ((), DARK)] == shared


def test_curves_are_drawn_hidden_and_seen_closely(curves: Path) -> None:
    found = played(
        curves,
        """
        const drawing = document.querySelector(".drawing"), inner = drawing.querySelector(".curves");
        const path = inner.querySelector("path");
        found.wide = path.getBoundingClientRect().width / inner.getBoundingClientRect().width;
        found.stroke = getComputedStyle(path).stroke;
        const ticks = () => [...drawing.querySelectorAll(".ticks.x text")].map((text) => Number(text.textContent));
        found.ticks = ticks();
        drawing.dispatchEvent(new KeyboardEvent("keydown", { key: "+" }));
        found.closer = ticks();
        drawing.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape" }));
        found.back = ticks();
        const box = inner.getBoundingClientRect();
        const at = { clientX: box.left + box.width / 2, clientY: box.top + box.height / 2, bubbles: true };
        drawing.dispatchEvent(new PointerEvent("pointermove", at));
        found.readout = document.querySelector(".readout").textContent;
        document.querySelector(".keys button").click();
        found.hidden = getComputedStyle(path).display;
        """,
    )
    assert found["wide"] == pytest.approx(1.0, abs=0.02)
    assert found["stroke"] == "rgb(31, 111, 180)"
    assert found["ticks"] == found["back"] == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    assert found["closer"] == [3.0, 4.0, 5.0, 6.0, 7.0]
    time_s, force_N = (float(number) for number in str(found["readout"]).split("; "))
    assert (time_s, force_N) == (pytest.approx(5.0, abs=0.02), pytest.approx(0.0, abs=0.05))
    assert (found["hidden"], found["said"]) == ("none", [])


@pytest.mark.parametrize("options", [(), DARK])
@pytest.mark.parametrize("name", ["results", "curves"])
def test_a_narrow_screen_cuts_nothing(name: str, options: tuple[str, ...], request: pytest.FixtureRequest) -> None:
    """At 420 px nothing reaches over the edge that does not scroll by itself; in dark the paper is dark."""
    # A browser without a screen is no narrower than 500 px, for which the same rules hold.
    found = played(
        request.getfixturevalue(name),
        """
        document.body.style.width = "420px";
        document.body.style.margin = "0";
        document.querySelectorAll("details").forEach((part) => { part.open = true; });
        await frame();
        const scrolls = (node) => node && (getComputedStyle(node).overflowX === "auto" || scrolls(node.parentElement));
        const isPart = (node) => !(node instanceof SVGElement) || node.classList.contains("drawing");
        const isOver = (node) => isPart(node) && node.getBoundingClientRect().right > 421 && !scrolls(node);
        found.over = [...document.body.querySelectorAll("*")].filter(isOver).map((node) => node.outerHTML.slice(0, 80));
        found.seen = [...document.querySelectorAll(".ranking .scored, .drawing")].length;
        found.narrow = matchMedia("(max-width: 46rem)").matches;
        found.dark = matchMedia("(prefers-color-scheme: dark)").matches;
        found.paper = getComputedStyle(document.body).backgroundColor;
        """,
        420,
        *options,
    )
    assert (found["over"], found["narrow"], found["said"]) == ([], True, [])
    assert found["seen"]
    assert found["dark"] == bool(options)
    assert found["paper"] == ("rgb(20, 24, 28)" if options else "rgb(255, 255, 255)")
