"""The page of benchmark results: what is on it, that it needs nothing but itself, and that its figures are right."""

import base64
import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects
import pytest
from conftest import REPOSITORY
from plotly.offline import get_plotlyjs

from fdbench.benchmark.provenance import provenance
from fdbench.benchmark.run import run
from fdbench.benchmark.store import FAILED, OK, KeptRun, RunKey, Score, Store
from fdbench.diagnosis.answer import EFFECT, from_json, read_answer
from fdbench.errors import FdbenchError
from fdbench.report import write_report
from fdbench.report._figures import styles_of
from fdbench.report._page import Figure, Section, page, paragraph, table
from fdbench.report._series import envelope, thinned
from fdbench.report._templates import Html
from fdbench.report.answer import write_answer
from fdbench.report.cards import verdict_card
from fdbench.report.diagnosis_text import summary

SCENARIOS = ("MillingUpDown-v1", "ShakerConstant-v0")
HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)> & \"quoted\" 'text'"
VOID = {"meta", "wbr", "link", "img", "br"}


class Page(HTMLParser):
    """A page taken apart; a tag that is not closed where it should be is an error."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.text = text
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.headings: list[str] = []
        self.words: list[str] = []
        self.figures: dict[str, dict[str, Any]] = {}
        self.plot: str | None = None
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        self.plot = dict(attrs).get("data-plot")
        if re.fullmatch(r"h\d", tag):
            self.headings.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-1:] == ["script"]:
            if self.plot:
                self.figures[self.plot] = json.loads(data)
        elif self.open[-1:] != ["style"]:
            self.words.append(data)
            if self.open and re.fullmatch(r"h\d", self.open[-1]):
                self.headings[-1] += data

    def attributes(self, name: str) -> list[str]:
        return [value for _, attributes in self.tags if (value := attributes.get(name)) is not None]

    def figure(self, scenario: str, y_title: str) -> dict[str, Any]:
        """Return the first figure of a scenario with an axis of this title."""
        prefix = f"plot-scenarios-{scenario.lower()}-"
        for name, figure in self.figures.items():
            titles = [axis["title"]["text"] for key, axis in figure["layout"].items() if key.startswith("yaxis")]
            if name.startswith(prefix) and any(title.startswith(y_title) for title in titles):
                return figure
        raise LookupError(f"{scenario}: no figure of {y_title}")


def numbers(encoded: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(encoded["bdata"]), dtype="<f4").astype(float)


def traces(figure: dict[str, Any], name: str) -> list[dict[str, Any]]:
    return [trace for trace in figure["data"] if trace["name"] == name]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    results = tmp_path_factory.mktemp("results")
    run(SCENARIOS, ["least_squares", "pl_lssvm"], 2, results)
    return results


@pytest.fixture(scope="module")
def report(folder: Path) -> Page:
    write_report(folder, folder / "report.html")
    return Page((folder / "report.html").read_text("utf-8"))


def failed_run(estimator: str, message: str) -> KeptRun:
    return KeptRun(
        scenario="Nowhere-v0",
        estimator=estimator,
        seed=0,
        plant="feed_drive",
        status=FAILED,
        message=message,
        seconds=None,
        provenance={**provenance(), "scenario_digest": "0" * 64, "estimator_digest": "1" * 64, "utc": "2024-01-01"},
        scores=(Score(metric="parameter_error", unit="%", status=FAILED, message=message),),
    )


def hand_made(folder: Path, runs: list[KeptRun]) -> Page:
    store = Store(folder)
    for one in runs:
        store.write_run(one)
    store.merge([one.key for one in runs])
    write_report(folder, folder / "report.html")
    return Page((folder / "report.html").read_text("utf-8"))


@pytest.fixture
def only_failures(tmp_path: Path) -> Page:
    names = ["null", "oracle", "<b>bold"]
    return hand_made(tmp_path, [failed_run(name, HOSTILE) for name in names])


# ---- the frame ----


def test_every_section_is_there(report: Page) -> None:
    expected = [
        "fdbench: benchmark results",
        *[
            "Ranking",
            "Track: parameters",
            "feed_drive",
            "Track: disturbance",
            "feed_drive",
            "Track: output",
            "feed_drive",
        ],
        *["Scenarios", *SCENARIOS, "Failed and skipped runs", "Speed", "Provenance"],
    ]
    assert [text for text in report.headings if text in expected] == expected
    for title in (
        "Output: measured and predicted",
        "Disturbance: truth and estimates",
        "Disturbance: detail",
        "Spectrum of the prediction error",
        "Output: error and stated 95% interval",
        "Disturbance without its mean: error and stated 95% interval",
        "Parameters: bias over the seeds",
    ):
        assert report.headings.count(title) == len(SCENARIOS), title


def test_contents_lead_to_the_sections(report: Page) -> None:
    ids = report.attributes("id")
    links = report.attributes("href")
    assert len(set(ids)) == len(ids)
    assert len(links) == 5 + 3 + len(SCENARIOS)
    assert {link.removeprefix("#") for link in links} <= set(ids)


def test_page_needs_nothing_but_itself(report: Page) -> None:
    assert report.text.count(get_plotlyjs()) == 1
    rest = report.text.replace(get_plotlyjs(), "")
    assert re.findall(r"https?:|//\w+\.\w+", rest) == []
    assert report.attributes("src") == []
    assert "showSendToCloud: false" in rest
    policy = next(attributes["content"] for _, attributes in report.tags if "http-equiv" in attributes)
    assert policy is not None
    assert "default-src 'none'" in policy
    assert "connect-src" not in policy


def test_page_is_small_enough(report: Page) -> None:
    own = len(report.text.encode()) - len(get_plotlyjs().encode())
    assert own < 0.5e6 * len(SCENARIOS), "12 scenarios and plotly must stay below 10 MB"


def test_page_adapts_to_screen_and_scheme(report: Page) -> None:
    assert "@media (prefers-color-scheme: dark)" in report.text
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in [
        attributes for _, attributes in report.tags
    ]
    used = set(re.findall(r"var\((--[\w-]+)\)", report.text))
    defined = set(re.findall(r"(--[\w-]+):", report.text))
    assert used
    assert used <= defined


def test_same_results_give_the_same_text(folder: Path, report: Page, tmp_path: Path) -> None:
    write_report(folder, tmp_path / "again.html")
    assert (tmp_path / "again.html").read_text("utf-8") == report.text


def test_plotly_accepts_every_figure(report: Page, only_failures: Page) -> None:
    figures = [*report.figures.values(), *only_failures.figures.values()]
    assert len(figures) > 20
    for figure in figures:
        text = json.dumps(figure)
        plotly.graph_objects.Figure(json.loads(re.sub(r"var\(--[\w-]+\)(/\w\w)?", "#123456", text)))


def test_text_is_escaped(only_failures: Page) -> None:
    assert [name for name, _ in only_failures.tags if name in ("img", "b")] == []
    assert only_failures.words.count(HOSTILE) == 1
    assert only_failures.words.count("<b>bold") >= 2


def test_names_are_escaped_in_figures(tmp_path: Path) -> None:
    values = {"null": 100.0, "oracle": 0.0, "<b>bold": 1.0}
    scores = {name: Score(metric="parameter_error", unit="%", value=value) for name, value in values.items()}
    runs = [replace(failed_run(name, ""), status=OK, scores=(score,)) for name, score in scores.items()]
    shown = hand_made(tmp_path, runs)
    (figure,) = shown.figures.values()
    assert {trace["name"]: trace["x"] for trace in figure["data"]} == {
        "oracle": [1.0],
        "&lt;b&gt;bold": [pytest.approx(2 / 3)],
        "null": [0.0],
    }


def test_figures_and_tables_are_escaped() -> None:
    figure = Figure(title=HOSTILE, traces=[{"name": HOSTILE}], layout={}, height_px=100, caption=HOSTILE)
    cells = table([HOSTILE], [[HOSTILE]], "l")
    shown = Page(page(HOSTILE, [paragraph(HOSTILE)], [Section(HOSTILE, [figure, cells])]))
    assert [data["data"][0]["name"] for data in shown.figures.values()] == [HOSTILE]
    assert [name for name, _ in shown.tags if name == "img"] == []
    places = ["title", "h1", "p", "link", "h2", "h3", "figcaption", "th", "td"]
    assert shown.words.count(HOSTILE) == len(places)


def test_equal_titles_have_ids_of_their_own() -> None:
    shown = Page(page("", [], [Section("A b", [Html("")]), Section("a-B", [Html("")])]))
    assert shown.attributes("id") == ["a-b", "a-b-2"]


def test_page_of_failures_says_so(only_failures: Page) -> None:
    text = " ".join(only_failures.words)
    assert "3 runs: 3 failed" in text
    assert "No estimate of seed 0 is kept" in text
    assert "No run has a time." in text


def test_missing_results_and_unwritable_page(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(FdbenchError, match=r"no scores\.parquet"):
        write_report(tmp_path / "nowhere", tmp_path / "report.html")
    with pytest.raises(FdbenchError, match="cannot be written"):
        write_report(folder, tmp_path)


def test_changed_scenario_has_no_spectrum(folder: Path, tmp_path: Path) -> None:
    """A scenario that is not the one of the results must not lend them its noise and its frequencies."""
    source, target = Store(folder), Store(tmp_path)
    runs = []
    for name in ("null", "oracle", "least_squares"):
        found = source.read_run(RunKey("ShakerConstant-v0", name, 0))
        assert found is not None
        changed = {**found.provenance, "scenario_digest": "0" * 64}
        runs.append(replace(found, provenance=changed))
        file = target.estimate_file(found.key)
        file.parent.mkdir(parents=True)
        file.write_bytes(source.estimate_file(found.key).read_bytes())
    shown = hand_made(tmp_path, runs)
    assert "Output: measured and predicted" in shown.headings
    assert "Spectrum of the prediction error" not in shown.headings
    assert any("has changed since" in words for words in shown.words)


# ---- what the figures show ----


def test_noise_floor_and_lines_of_the_spectrum(report: Page) -> None:
    """Floor 2 sigma^2 Ts of 20 um/s at 333 Hz; 55 Hz and its harmonics, of which 220 and 275 Hz fold."""
    figure = report.figure("ShakerConstant-v0", "power density")
    (floor,) = traces(figure, "noise floor")
    expected_dB = 10.0 * math.log10(2.0 * (2e-5) ** 2 / 333.0)
    assert numbers(floor["y"]) == pytest.approx([expected_dB] * 2, abs=1e-4)
    lines_Hz = [shape["x0"] for shape in figure["layout"]["shapes"]]
    assert lines_Hz == pytest.approx([55.0, 110.0, 165.0, 113.0, 58.0], rel=1e-9)
    (oracle,) = traces(figure, "oracle")
    assert float(np.median(numbers(oracle["y"]))) == pytest.approx(expected_dB, abs=1.0)
    (least_squares,) = traces(figure, "least_squares")
    density_dB = numbers(least_squares["y"])
    frequency_Hz = least_squares["x0"] + least_squares["dx"] * np.arange(len(density_dB))
    assert frequency_Hz[np.argmax(density_dB)] == pytest.approx(55.0, abs=333.0 / 1024.0)


def test_prediction_error_is_measured_less_predicted(folder: Path, report: Page) -> None:
    kept = Store(folder).read_estimate(RunKey("ShakerConstant-v0", "least_squares", 0))
    assert kept is not None
    assert kept.estimate.output is not None
    error_um_per_s = 1e6 * (kept.target - kept.estimate.output)
    figure = report.figure("ShakerConstant-v0", "prediction error")
    assert figure["layout"]["yaxis2"]["title"]["text"] == "prediction error (µm/s)"
    shown = numbers(next(trace for trace in traces(figure, "least_squares") if trace["yaxis"] == "y2")["y"])
    assert [shown.min(), shown.max()] == pytest.approx([error_um_per_s.min(), error_um_per_s.max()], rel=1e-6)


def test_truth_of_the_disturbance(report: Page) -> None:
    """The shaker of 1.2 N, averaged over a sample by the sinc of 55/333, and nothing before 2 s."""
    figure = report.figure("ShakerConstant-v0", "disturbance")
    (truth,) = traces(figure, "truth")
    force_N = numbers(truth["y"])
    time_s = truth["x0"] + truth["dx"] * np.arange(len(force_N))
    assert np.abs(force_N[time_s < 1.9]).max() < 1e-9
    assert force_N.max() == pytest.approx(1.2 * np.sinc(55.0 / 333.0), rel=0.02)


def test_share_of_rows_within_the_stated_interval(folder: Path, report: Page) -> None:
    kept = Store(folder).read_estimate(RunKey("ShakerConstant-v0", "pl_lssvm", 0))
    assert kept is not None
    assert kept.estimate.output is not None
    assert kept.estimate.output_variance is not None
    inside = np.abs(kept.target - kept.estimate.output) <= 1.959964 * np.sqrt(kept.estimate.output_variance)
    figure = report.figure("ShakerConstant-v0", "error")
    texts = [annotation["text"] for annotation in figure["layout"]["annotations"]]
    assert f"pl_lssvm: {100.0 * inside.mean():.1f}% of {len(inside)} rows inside" in texts


def test_estimators_keep_their_colour(report: Page) -> None:
    colours: dict[str, set[str]] = {}
    for figure in report.figures.values():
        for trace in figure["data"]:
            colour = trace["marker"]["color"] if trace["mode"] == "markers" else trace["line"]["color"]
            if trace.get("showlegend", True) or trace["mode"] == "markers":
                colours.setdefault(trace["name"], set()).add(colour)
    assert {name: len(found) for name, found in colours.items() if len(found) > 1} == {}
    assert colours["least_squares"] != colours["pl_lssvm"]


def test_many_estimators_differ() -> None:
    names = [f"estimator_{number}" for number in range(25)]
    styles = styles_of(["oracle", *names, "null"])
    assert len({(style.colour, style.dash) for style in styles.values()}) == 27


# ---- long series ----


def blocks(rng: np.random.Generator) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for n in (1, 2, 2999, 3000, 3001, 54321):
        yield 0.25 + 1e-3 * np.arange(n), rng.standard_normal(n)


def test_thinned_series_keeps_extremes_and_span() -> None:
    for time_s, values in blocks(np.random.default_rng(3)):
        t, y = thinned(time_s, values, 3000)
        assert len(t) == len(y) <= 3002
        assert (y.min(), y.max()) == (values.min(), values.max())
        assert (np.diff(t) > 0.0).all()
        assert t[0] == time_s[0]
        assert abs(t[-1] - time_s[-1]) <= 2.0 * np.ptp(time_s) / 1500.0
        assert abs(t[np.argmax(y)] - time_s[np.argmax(values)]) <= 2.0 * np.ptp(time_s) / 1500.0


def test_thinned_series_breaks_at_gaps() -> None:
    time_s = np.concatenate((np.arange(0.0, 10.0, 1e-3), np.arange(50.0, 60.0, 1e-3)))
    t, y = thinned(time_s, np.ones(len(time_s)), 3000)
    (gap,) = np.flatnonzero(np.isnan(y))
    assert t[gap] < 10.02  # a group of rows
    assert t[gap + 1] == 50.0
    assert len(y) < 3010


def test_envelope_holds_every_bound() -> None:
    for time_s, values in blocks(np.random.default_rng(4)):
        half = np.abs(values)
        t, lower, upper = envelope(time_s, -half, half, 1000)
        rows = np.searchsorted(t, time_s, side="right") - 1
        assert (lower[rows] <= -half).all()
        assert (upper[rows] >= half).all()


def test_metric_troubles_are_listed(report: Page) -> None:
    assert "Metrics without a value in runs that have an estimate" in report.words
    assert "the estimate claims no disturbance_variance_N2" in report.words


# ---- the page of an answer ----


def share_of(kind: str, *bounds: float) -> list[dict[str, Any]]:
    return [{kind: list(pair), "share": 0.5} for pair in pairwise(bounds)]


def answer() -> dict[str, Any]:
    """Return an answer by hand: a gap of 100 floors, which cogging takes to 10."""
    return {
        "gap": {
            "channels": {
                "position_m": {
                    **{"before": 1e-5, "recalibrated": 5e-6, "repaired": 1e-6, "noise_floor": 5e-7},
                    **{"reduction": 0.96, "unit": "m", "relative": 0.1},
                }
            }
        },
        "where": {
            "motion": {"rest": 0.25, "cruise_positive": 0.75},
            "frequency": share_of("band_Hz", 0.0, 5.0, 15.0),
            "position": share_of("range_m", 0.0, 0.1, 0.2),
            "velocity": share_of("range_m_per_s", -0.1, 0.0, 0.1),
            "time": share_of("range_s", 0.0, 1.0, 2.0),
            "channel": {"position_m": 1.0},
        },
        "causes": [
            {
                **{"effect": "cogging", "probability": 0.999, "share": 0.9, "unique_share": 0.9},
                "parameters": {
                    "cogging_force_N": {"value": 7.5, "ci95": [7.0, 8.0], "unit": "N"},
                    "pitch_m": {"value": 0.01, "ci95": [0.009, 0.011], "unit": "m"},
                    "phase_rad": {"value": 0.5, "ci95": None, "unit": "rad"},
                },
                "indistinguishable_from": [],
            }
        ],
        "suspects": [{"effect": "backlash", "probability": 0.25}],
        "unknown_probability": 0.25,
        "no_gap_probability": 0.0,
        "shrinkage": {
            **{"judged_on": "held-out", "unit": "", "on_paper": 400.0, "total": 0.9, "ci95": [0.8, 0.95]},
            "steps": [{"added": "cogging", "before": 100.0, "after": 10.0, "reduction": 0.9, "ci95": [0.8, 0.95]}],
            **{"reducible_left": 0.9, "noise_floor": 1.0},
        },
        "next_experiment": {"to_separate": ["cogging", "backlash"], "trajectory": "a slow stroke"},
        "warnings": ["the clock of run_0 is odd"],
        "parametric": {"closed_by_recalibration": 0.75, "moved_in_standard_deviations": {"motor_mass": 4.0}},
        "noise_floor": {"position_m": {"value": 5e-7, "unit": "m", "measured_from_repeats": False}},
    }


def page_of(folder: Path, changed: dict[str, Any]) -> Page:
    (folder / "answer.json").write_text(json.dumps(changed), "utf-8")
    write_answer(folder / "answer.json", folder / "answer.html")
    return Page((folder / "answer.html").read_text("utf-8"))


def test_an_answer_becomes_a_page(tmp_path: Path) -> None:
    shown = page_of(tmp_path, answer())
    sections = ["Where the gap lies", "Causes", "How far the gap shrinks", "Noise floor and re-calibration"]
    assert [title for title in shown.headings if title in sections] == sections
    text = " ".join(shown.words)
    for words in (
        *("cogging, probability above 0.99", "the clock of run_0 is odd", "answer.json", "--html"),
        *("re-calibration alone: 400 to 100, 75 % less", "+ cogging: 100 to 10, 90 % less (95 %: 80 to 95 %)"),
        *(
            "7.5 N",
            "7 N to 8 N",
            "10 µm",
            "96 %",
            "500 nm",
            "assumed from the quietest parts",
            "+4.00",
            "a slow stroke",
        ),
        *("Re-calibration moved motor_mass by +4.0 standard deviations", "is assumed, from what the model leaves"),
    ):
        assert words in text, words
    first = [figure["data"][0] for figure in shown.figures.values()]
    bars = {tuple(trace["y"]): trace["x"] for trace in first if trace["type"] == "bar"}
    assert bars["cogging", "something unknown", "no gap"] == [0.999, 0.25, 0.0]
    assert bars["cogging", "not explained", "noise"] == pytest.approx([0.9, 0.09, 0.01])
    assert bars["rest", "cruise positive"] == [0.25, 0.75]
    assert bars["0 to 5 Hz", "5 to 15 Hz"] == [0.5, 0.5]
    (steps,) = [figure for figure in shown.figures.values() if len(figure["data"]) > 1]
    assert [trace["x"] for trace in steps["data"]] == [[400.0], [100.0], [10.0], [1.0]]
    assert re.findall(r"https?:", shown.text.replace(get_plotlyjs(), "")) == []


def test_an_effect_of_a_file_is_shown_as_it_is(tmp_path: Path) -> None:
    changed = answer()
    changed["causes"][0]["effect"] = changed["shrinkage"]["steps"][0]["added"] = "<b>mine"
    changed["causes"][0]["parameters"]["wear_mm_per_km"] = {"value": -3.5, "ci95": None, "unit": "mm/km"}
    shown = page_of(tmp_path, changed)
    assert "<b>mine" in shown.words
    assert "7 N to 8 N" in shown.words
    assert "-3.5 mm/km" in shown.words


def test_an_answer_from_before_causes_had_a_kind_is_read(tmp_path: Path) -> None:
    """Written by the version before, of the worn axis of the README."""
    written = REPOSITORY / "tests" / "golden" / "answer_before_kinds.json"
    older = read_answer(written)
    (cause,) = [item for item in older.causes if item.kind == EFFECT]
    assert cause.effect == "direction_dependent_friction"
    assert cause.parameters["viscous_asymmetry_N_s_per_m"].value == pytest.approx(20.0, rel=0.05)
    assert "Cause: direction_dependent_friction, probability above 0.99" in summary(older)
    assert from_json(older.as_json()) == older
    assert "direction_dependent_friction" in " ".join(page_of(tmp_path, json.loads(written.read_text())).words)


def test_markup_in_every_name_is_shown_as_it_is(tmp_path: Path) -> None:
    """Names and texts of an answer that somebody else has written: on the page and in the card of a notebook."""
    name, changed = HOSTILE, answer()
    cause, step = changed["causes"][0], changed["shrinkage"]["steps"][0]
    cause["effect"] = changed["suspects"][0]["effect"] = step["added"] = name
    cause["indistinguishable_from"] = [name]
    cause["parameters"] = {f"{name}_N": {"value": 1.0, "ci95": [0.5, 1.5], "unit": name}}
    for table_of, key in ((changed["gap"]["channels"], "position_m"), (changed["noise_floor"], "position_m")):
        table_of[f"{name}_m"] = table_of.pop(key) | {"unit": name}
    changed["where"]["channel"] = {f"{name}_m": 1.0}
    changed["where"]["motion"] = {name: 1.0}
    changed["shrinkage"] |= {"judged_on": name, "unit": name}
    changed["next_experiment"] = {"to_separate": [name, name], "trajectory": name, "motion": name, "file": name}
    changed["warnings"] = [name]
    changed["parametric"]["moved_in_standard_deviations"] = {name: 4.0}
    changed["probabilities_from"] = name
    shown = page_of(tmp_path, changed)
    card = Page(verdict_card(read_answer(tmp_path / "answer.json")))
    for document in (shown, card):
        assert [tag for tag, _ in document.tags if tag == "img"] == []
        assert "<img src=x onerror=alert(2)>" in " ".join(document.words)
    scripts = [attributes for tag, attributes in shown.tags if tag == "script"]
    assert len(scripts) == len(shown.figures) + 2  # plotly, and what draws
    assert [tag for tag, _ in card.tags if tag == "script"] == []


def test_rows_have_a_cell_for_each_column() -> None:
    with pytest.raises(ValueError, match="2 cells in a row, 1 columns"):
        table(["a"], [["b", "c"]], "l")


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("gap",), None, r"answer\.json\.gap: a table is expected, found None\."),
        (
            ("gap", "channels", "position_m", "before"),
            "x",
            r"gap\.channels\.position_m\.before: a number is expected, found the text 'x'\.",
        ),
        (("where", "time", 1, "range_s"), [1.0], r"where\.time\[1\]\.range_s: 2 values are expected, found 1\."),
        (
            ("causes", 0, "parameters", "pitch_m", "ci95"),
            [1.0, math.nan],
            r"pitch_m\.ci95\[1\]: a finite number is expected, found nan\.",
        ),
        (("causes", 0, "share"), True, r"causes\[0\]\.share: a number is expected, found true or false: True\."),
        (("causes", 0, "shares"), 0.5, r"causes\[0\]\.shares: unknown key for cause\. Did you mean share\?"),
        (("unknown_probability",), 10**400, r"unknown_probability: a finite number is expected, found 1000+\.\.\.\."),
        (("unknown_probability",), 1e200, r"unknown_probability: 1e\+200 is too large to be drawn\."),
        (("warnings",), {}, r"warnings: a list is expected, found a table\."),
    ],
)
def test_a_file_that_is_no_answer_is_refused(
    tmp_path: Path, place: tuple[str | int, ...], value: Any, message: str
) -> None:
    changed: Any = answer()
    inner = changed
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    with pytest.raises(
        FdbenchError, match=rf"answer\.json: neither a folder of results nor an answer .*: .*{message}$"
    ):
        page_of(tmp_path, changed)
    assert not (tmp_path / "answer.html").exists()


def test_what_an_answer_lacks_is_named(tmp_path: Path) -> None:
    changed = answer()
    del changed["shrinkage"]["steps"][0]["after"]
    with pytest.raises(FdbenchError, match=r"shrinkage\.steps\[0\]\.after: missing key of step\."):
        page_of(tmp_path, changed)
    (tmp_path / "deep.json").write_text("[" * 100_000, "utf-8")
    with pytest.raises(FdbenchError, match=r"deep\.json: neither"):
        write_answer(tmp_path / "deep.json", tmp_path / "answer.html")
