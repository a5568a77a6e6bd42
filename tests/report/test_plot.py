"""Pictures of records: every column, several records above each other, as a page and as a file."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from html_page import Page
from typer.testing import CliRunner

from fdbench import cli
from fdbench.record import Record
from fdbench.report.record import figure

TIME = 1e-3 * np.arange(2000)


def record(amplitude_m: float, source: str) -> Record:
    position = amplitude_m * np.sin(TIME)
    columns = {"position_m": position + 1e-6, "reference_position_m": position, "motor_force_N": 5.0 * np.cos(TIME)}
    return Record({"time_s": TIME, **columns}, source=source)


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"run_{number}.csv" for number in range(2)]
    for number, path in enumerate(paths):
        record(0.1 * (number + 1), path.name).save(path)
    return paths


def run(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(cli.app, ["plot", *map(str, arguments)])
    return done.exit_code, done.stderr


def test_a_reference_is_behind_its_column_and_the_difference_below() -> None:
    position, difference, force = figure([record(0.1, "a.csv")]).panels
    assert [item.name for item in position.items] == ["reference", "measured"]
    assert position.y_title == "position (mm)"
    assert (difference.y_title, force.y_title) == ("position minus reference (µm)", "motor force (N)")
    np.testing.assert_allclose(difference.items[0].ordinates[0], 1.0, rtol=1e-9)


def test_records_are_told_apart_by_their_files() -> None:
    names = [
        [item.name for item in panel.items] for panel in figure([record(0.1, "a/x.csv"), record(1.0, "b/x.csv")]).panels
    ]
    assert names[2] == ["a/x.csv", "b/x.csv"]


def test_a_page_and_a_file_are_written(files: list[Path], tmp_path: Path) -> None:
    assert run(*files, "-o", tmp_path / "plot.html") == (0, "")
    page = Page((tmp_path / "plot.html").read_text("utf-8"))
    panels = page.figures["Columns over time"]
    force_N = panels[2].curve("run_1.csv")[1]
    assert force_N.max() == pytest.approx(5.0, abs=panels[2].resolution)
    assert "run_0.csv: 2000 samples of 1 ms; run_1.csv: 2000 samples of 1 ms" in page.spoken
    assert run(files[0], "--column", "motor_force_N", "-o", tmp_path / "plot.svg") == (0, "")
    root = ET.fromstring((tmp_path / "plot.svg").read_text("utf-8"))
    assert len([element for element in root.iter() if element.get("class") == "panel"]) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "plot.png"), "plot.png: a plot is written as .html or .svg."),
        (("--column", "motor_force"), "no column 'motor_force' to draw. Did you mean motor_force_N?"),
        (("--data", "."), "--data .: a folder for mapping files (.toml), but no record is one."),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    files: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = run(files[0], *arguments)
    assert code == 2
    assert message in said
    assert {path.name for path in tmp_path.iterdir()} == {"run_0.csv", "run_1.csv"}
