"""The page of an answer of a diagnosis: what is said first, that its numbers are right, and what is refused."""

import json
import math
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY
from html_page import Page

from fdbench.diagnosis.answer.answer import from_json, read_answer
from fdbench.diagnosis.answer.cause import EFFECT
from fdbench.errors import FdbenchError
from fdbench.report._page import table
from fdbench.report.answer import write_answer
from fdbench.report.cards import verdict_card
from fdbench.report.diagnosis_text import summary

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)> & \"quoted\" 'text'"


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
            "+4.00 σ",
            "a slow stroke",
        ),
        *("Re-calibration moved motor_mass by +4.0 standard deviations", "is assumed, from what the model leaves"),
    ):
        assert words in text, words
    bars = {title: {row.name: row.bar for row in rows} for title, rows in shown.bars.items()}
    assert bars["Probability"] == {"cogging": [99.9], "something unknown": [25.0], "no gap": [0.0]}
    assert bars["What the mean squared gap after re-calibration consists of"] == {
        "cogging": [100.0],
        "not explained": [10.0],
        "noise": [1.11],
    }
    assert bars["Phase of motion"] == {"rest": [33.33], "cruise positive": [100.0]}
    steps = shown.bars["Mean squared gap in units of the noise floor"]
    assert [row.text for row in steps] == ["400", "100", "10", "1"]
    ((nominal,), (calibrated,), (repaired,), (noise,)) = (row.dot for row in steps)
    assert repaired - noise == pytest.approx(calibrated - repaired, abs=0.02)  # tenfold each
    assert nominal - calibrated == pytest.approx(math.log10(4.0) * (repaired - noise), abs=0.02)
    assert re.findall(r"https?:", shown.text) == []


def test_the_cause_and_the_worst_channel_come_first(tmp_path: Path) -> None:
    """Before anything else is drawn: cause, probability, values, and the gap before and after."""
    shown = page_of(tmp_path, answer())
    first = shown.text[: shown.text.index("<nav")]
    words = " ".join(re.sub(r"<[^>]+>", " ", first).split())
    for part in ("cogging", "probability above 0.99", "cogging force 7.5 N; pitch 10 mm", "10 → 1 µm", "Doubts"):
        assert part in words, part
    assert 'class="before" style="width:100.0%"' in first
    assert 'class="after" style="width:10.0%"' in first


def test_shares_that_do_not_add_up_have_their_rest_drawn(tmp_path: Path) -> None:
    changed = answer()
    changed["causes"][0]["share"] = 0.7
    changed["shrinkage"]["reducible_left"] = 0.0
    rows = page_of(tmp_path, changed).bars["What the mean squared gap after re-calibration consists of"]
    texts = {row.name: row.text for row in rows}
    assert texts["cogging"] == "70 %"
    numbers = [float(re.sub("[^0-9.]", "", text)) for text in texts.values()]
    assert sum(numbers) == pytest.approx(100.0, abs=1.5)
    assert "the rest" in texts


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
    assert len(scripts) == 1  # the page's own
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
        (("unknown_probability",), 10**400, r"not JSON: a number of 401 digits\."),
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
