"""The page of benchmark results: what is said first, that it needs nothing but itself, that its figures are right."""

import base64
import csv
import io
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from html_page import Page, Panel

from fdbench.benchmark.provenance import provenance
from fdbench.benchmark.run import run
from fdbench.benchmark.statistics import standings
from fdbench.benchmark.store import FAILED, OK, KeptRun, RunKey, Score, Store
from fdbench.errors import FdbenchError
from fdbench.report import write_report
from fdbench.report._figures import BEFORE, Curve, Figure
from fdbench.report._figures import Panel as Diagram
from fdbench.report._page import Section, page, paragraph, table
from fdbench.report._templates import Html

SCENARIOS = ("ShakerConstant-v0", "SpindleStep-v0")
HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)> & \"quoted\" 'text'"


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


def scored(values: dict[str, float]) -> list[KeptRun]:
    scores = {name: Score(metric="parameter_error", unit="%", value=value) for name, value in values.items()}
    return [replace(failed_run(name, ""), status=OK, scores=(score,)) for name, score in scores.items()]


@pytest.fixture
def only_failures(tmp_path: Path) -> Page:
    names = ["null", "oracle", "<b>bold"]
    return hand_made(tmp_path, [failed_run(name, HOSTILE) for name in names])


# ---- what is said first ----


def test_who_wins_where_comes_first(tmp_path: Path) -> None:
    """Errors of 100, 10 and 1: a tenth and a hundredth of the data sheet's, a third and two thirds of the score."""
    shown = hand_made(tmp_path, scored({"null": 100.0, "oracle": 0.0, "good": 1.0, "fair": 10.0}))
    assert "Best beside the data sheet: feed_drive: good at parameters (1/100 of its error)" in shown.spoken
    assert "One seed: no interval is known, and what is first may be so by chance." in shown.spoken
    places = [
        shown.text.index(part) for part in ("Best beside", '<table class="ranking"', 'id="scenarios"', "<script>")
    ]
    assert places == sorted(places)
    cells = dict(re.findall(r'data-name="(\w+)".*?class="scored".*?>([-\d.]+)</span>', shown.text, re.DOTALL))
    assert cells == {"good": "0.667", "fair": "0.333", "oracle": "1.000", "null": "0.000"}
    assert list(cells) == ["good", "fair", "oracle", "null"]


def test_bars_are_scores_on_a_logarithmic_axis_of_the_error(tmp_path: Path) -> None:
    """The bar of 0.667 goes from 0, at a quarter of the way from -1/3 to 1, to 1/100 of the data sheet's error."""
    shown = hand_made(tmp_path, scored({"null": 100.0, "oracle": 0.0, "good": 1.0, "bad": 300.0}))
    good, bad = (
        re.findall(rf'data-name="{name}".*?<b style="left:([\d.]+)%;width:([\d.]+)%">', shown.text, re.DOTALL)[0]
        for name in ("good", "bad")
    )
    assert [float(value) for value in good] == pytest.approx([25.0, 50.0], abs=0.01)
    worse = 75.0 * math.log10(3.0) / 3.0
    assert [float(value) for value in bad] == pytest.approx([25.0 - worse, worse], abs=0.01)
    axis = re.findall(r'<s style="left:([\d.]+)%">([\d/]+)</s>', shown.text)
    assert axis == [("25.0", "1"), ("50.0", "1/10"), ("75.0", "1/100"), ("100.0", "1/1000")]


def test_nobody_wins_where_the_data_sheet_does(tmp_path: Path) -> None:
    shown = hand_made(tmp_path, scored({"null": 1.0, "oracle": 0.0, "bad": 10.0}))
    assert "feed_drive: nobody at parameters (10 times its error)" in shown.spoken
    assert "parameters: nobody beats the data sheet" in shown.spoken


def test_rankings_can_be_downloaded(folder: Path, report: Page) -> None:
    (address,) = [href for href in report.attributes("href") if href.startswith("data:text/csv")]
    rows = list(csv.DictReader(io.StringIO(base64.b64decode(address.partition(",")[2]).decode())))
    (own,) = [row for row in rows if (row["track"], row["estimator"]) == ("disturbance", "pl_lssvm")]
    ranking = standings(Store(folder).scores(), "disturbance", "feed_drive")
    (line,) = [line for line in ranking if line.estimator == "pl_lssvm"]
    assert [float(own[key]) for key in ("score", "low", "high")] == pytest.approx(
        [line.score.value, line.score.low, line.score.high], rel=1e-5
    )


# ---- the frame ----


def test_every_section_is_there(report: Page) -> None:
    expected = [
        *("fdbench: benchmark results", "Ranking", "feed_drive 1 scenario", "Scenarios"),
        *("Failed and skipped runs", "Speed", "Provenance"),
    ]
    assert [text for text in report.headings if text in expected] == expected
    assert report.headings.count("Output: error of each prediction") == len(SCENARIOS)
    assert report.headings.count("Disturbance: error of each estimate") == 1
    assert report.headings.count("Spectrum of the prediction error") == len(SCENARIOS)
    assert [name for name in report.attributes("data-name") if name in SCENARIOS] == list(SCENARIOS)


def test_links_lead_somewhere(report: Page) -> None:
    ids = report.attributes("id")
    links = [href for href in report.attributes("href") if href.startswith("#")]
    assert len(set(ids)) == len(ids)
    assert {link.removeprefix("#") for link in links} <= set(ids)
    assert "#rank-feed-drive-pl-lssvm" in links


def test_page_needs_nothing_but_itself(report: Page) -> None:
    assert re.findall(r"https?:(?!//www\.w3\.org/2000/svg\")", report.text) == []
    assert report.attributes("src") == []
    policy = next(attributes["content"] for _, attributes in report.tags if "http-equiv" in attributes)
    assert policy is not None
    assert "default-src 'none'" in policy
    assert "connect-src" not in policy


def test_a_page_of_many_estimates_has_room_for_them(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The full suite has 402 estimates and 1.4 MB; these here claim all that can be drawn, as half of those do."""
    monkeypatch.setattr("fdbench.report.results._n_pictured", lambda statuses: 402)
    write_report(folder, tmp_path / "report.html")
    own = (tmp_path / "report.html").stat().st_size - len(page("", [], []).encode())
    assert own / (4 + 2) < 8.6e3


def test_panels_of_one_scale_share_its_ticks() -> None:
    panels = [
        Diagram(
            y_title="force (N)", items=[Curve(name="a", x=np.arange(9.0), y=np.ones(9), style=BEFORE)], y_range=scale
        )
        for scale in ((-1.0, 1.0), (-1.0, 1.0), (-2.0, 2.0))
    ]
    text = page("", [], [Section("Figure", [Figure(title="", panels=panels, x_title="time (s)")])])
    assert re.findall(r'<g id="(.*?)" class="ticks y">', text) == ["scale-0", "scale-1"]
    assert re.findall(r'<use href="#(.*?)"/>', text) == ["scale-0"]


def test_page_adapts_to_screen_and_scheme(report: Page) -> None:
    assert "(prefers-color-scheme: dark)" in report.text
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


def test_text_is_escaped(only_failures: Page) -> None:
    assert [name for name, _ in only_failures.tags if name == "img"] == []
    assert only_failures.words.count(HOSTILE) == 1
    assert "<b>bold" in only_failures.attributes("data-name") + only_failures.words


def test_tables_are_escaped() -> None:
    shown = Page(page(HOSTILE, [paragraph(HOSTILE)], [Section(HOSTILE, [table([HOSTILE], [[HOSTILE]], "l")])]))
    assert [name for name, _ in shown.tags if name == "img"] == []
    places = ["title", "h1", "p", "link", "h2", "th", "td"]
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
    assert "Output: error of each prediction" in shown.headings
    assert "Spectrum of the prediction error" not in shown.headings
    assert any("has changed since" in words for words in shown.words)


# ---- what the figures show ----


def panel_of(page: Page, title: str, name: str) -> Panel:
    """Return the panel of a figure whose heading begins with a name, or the first one with such a curve."""
    panels = page.figures[title]
    named = [panel for panel in panels if panel.title.startswith(name)]
    return (named or [panel for panel in panels if name in dict(panel.paths)])[0]


def test_noise_floor_and_lines_of_the_spectrum(report: Page) -> None:
    """Floor 2 sigma^2 Ts of 20 um/s at 333 Hz; 55 Hz and its harmonics, of which 220 and 275 Hz fold."""
    (panel,) = report.figures["Spectrum of the prediction error"]
    expected_dB = 10.0 * math.log10(2.0 * (2e-5) ** 2 / 333.0)
    _, floor_dB = panel.curve("noise floor")
    assert floor_dB == pytest.approx([expected_dB] * 2, abs=panel.resolution)
    low, high = panel.bounds[:2]
    group = re.search(r'<g class="marks">(.*?)</g>', report.text)
    assert group is not None
    places = [float(x) / 100.0 for x in re.findall(r'<line x1="([\d.]+)%"', group[1])]
    assert [low + (high - low) * place for place in places] == pytest.approx(
        [55.0, 110.0, 165.0, 113.0, 58.0], abs=0.01
    )
    assert float(np.median(panel.curve("oracle")[1])) == pytest.approx(expected_dB, abs=1.0)
    frequency_Hz, density_dB = panel.curve("least_squares")
    assert frequency_Hz[np.argmax(density_dB)] == pytest.approx(55.0, abs=333.0 / 1024.0)


def test_prediction_error_is_measured_less_predicted(folder: Path, report: Page) -> None:
    kept = Store(folder).read_estimate(RunKey("ShakerConstant-v0", "least_squares", 0))
    assert kept is not None
    assert kept.estimate.output is not None
    error_um_per_s = 1e6 * (kept.target - kept.estimate.output)
    panel = panel_of(report, "Output: error of each prediction", "least_squares")
    size = np.sqrt(np.mean(error_um_per_s**2))
    assert panel.title.startswith(f"least_squares: {size:.3g} µm/s rms")
    shown = panel.curve("least_squares")[1]
    assert [shown.min(), shown.max()] == pytest.approx(
        [error_um_per_s.min(), error_um_per_s.max()], abs=panel.resolution
    )


def test_errors_have_one_scale(report: Page) -> None:
    for title in ("Output: error of each prediction", "Disturbance: error of each estimate"):
        bounds = {tuple(panel.bounds) for panel in report.figures[title][1:]}
        assert len(bounds) == 1, title


def test_truth_of_the_disturbance(report: Page) -> None:
    """The shaker of 1.2 N, averaged over a sample by the sinc of 55/333, and nothing before 2 s."""
    panel = panel_of(report, "Disturbance: error of each estimate", "truth")
    time_s, force_N = panel.curve("truth")
    assert np.abs(force_N[time_s < 1.9]).max() < panel.resolution
    assert force_N.max() == pytest.approx(1.2 * np.sinc(55.0 / 333.0), rel=0.02)


def test_share_of_rows_within_the_stated_interval(folder: Path, report: Page) -> None:
    kept = Store(folder).read_estimate(RunKey("ShakerConstant-v0", "pl_lssvm", 0))
    assert kept is not None
    assert kept.estimate.output is not None
    assert kept.estimate.output_variance is not None
    inside = np.abs(kept.target - kept.estimate.output) <= 1.959964 * np.sqrt(kept.estimate.output_variance)
    panel = panel_of(report, "Output: error of each prediction", "pl_lssvm")
    assert panel.title.endswith(f"{100.0 * inside.mean():.1f}% of {len(inside)} rows inside")


def test_the_best_is_drawn_first_beside_the_truth(folder: Path, report: Page) -> None:
    """Its own panel, on the scale of the truth, which hides neither."""
    names = [title for title in report.headings if title in ("least_squares", "pl_lssvm")]
    assert names == ["pl_lssvm", "least_squares"]
    (panel,) = report.figures["pl_lssvm"]
    assert [name for name, _ in panel.paths] == ["pl_lssvm", "truth", "pl_lssvm"]  # its interval, the truth, itself


def test_metric_troubles_are_listed(report: Page) -> None:
    assert "Metrics without a value in runs that have an estimate" in report.words
    assert "the estimate claims no disturbance_variance_N2" in report.words
