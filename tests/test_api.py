"""The functions of Python: what the command line finds, as tables, figures and cards; nothing imported early."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
from typer.testing import CliRunner

import fdbench
from fdbench import compare, diagnose, load_scenario, read_record, run
from fdbench.api import DiagnosisResult, RunResult
from fdbench.benchmark.store import Store
from fdbench.cli import app
from fdbench.effects import effects
from fdbench.errors import FdbenchError, SpecError, UnknownName
from fdbench.record import Record
from fdbench.scenario import Reality

AXIS = "BallScrewAxis-v0"
SLOW = {"numba", "pandas", "scipy", "pyarrow", "plotly", "jinja2", "fdbench.api", "fdbench.scenario", "fdbench.effects"}


def command(*words: str | Path) -> str:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return files of a short stroke twice, with friction that the model lacks."""
    folder, axis = tmp_path_factory.mktemp("records"), load_scenario(AXIS)
    worn = effects.get("direction_dependent_friction").typical(coulomb_asymmetry_N=5.0)
    axis = dataclasses.replace(axis, reality=Reality(effects=(worn,), noise=axis.reality.noise))
    files = [folder / "run_0.csv", folder / "run_1.csv"]
    for seed, file in enumerate(files):
        axis.record(seed).slice(0, 6000).save(file)
    return files


@pytest.fixture(scope="module")
def found(records: list[Path]) -> DiagnosisResult:
    return diagnose(load_scenario(AXIS), [records[0], read_record(records[1])])


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return run("ShakerConstant-v1", ["least_squares"], seeds=2, output=tmp_path_factory.mktemp("run"), jobs=1)


# ---- the package ----


def test_import_is_quick_and_names_are_there() -> None:
    program = f"import sys, fdbench; dir(fdbench); print(sorted({SLOW!r} & set(sys.modules)))\n"
    program += "from fdbench import Record; print(sorted({'fdbench.api', 'plotly'} & set(sys.modules)))\n"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[]", "[]"]
    assert fdbench.Record is Record
    assert set(fdbench.__all__) <= set(dir(fdbench))
    assert all(getattr(fdbench, name) is not None for name in fdbench.__all__)
    with pytest.raises(AttributeError, match="no attribute 'diagnos'"):
        _ = fdbench.diagnos  # type: ignore[attr-defined]


def test_types_are_known_to_checkers(tmp_path: Path) -> None:
    text = "import fdbench\nreveal_type(fdbench.diagnose)\nreveal_type(fdbench.run().scores())\nfdbench.compare(1, 2)\n"
    (tmp_path / "script.py").write_text(text, "utf-8")
    words = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path), str(tmp_path / "script.py")]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert "DiagnosisResult" in done.stdout
    assert "DataFrame" in done.stdout
    assert 'Argument 1 to "compare" has incompatible type "int"' in done.stdout


# ---- diagnose ----


def test_a_diagnosis_is_that_of_the_command(found: DiagnosisResult, records: list[Path], tmp_path: Path) -> None:
    model = Path(__file__).parents[1] / "scenarios" / f"{AXIS}.toml"
    text = command("diagnose", "--model", model, *records, "--json", tmp_path / "a.json", "--html", tmp_path / "a.html")
    found.write_json(tmp_path / "b.json")
    found.write_html(tmp_path / "b.html")
    for name in ("json", "html"):
        assert (tmp_path / f"a.{name}").read_bytes() == (tmp_path / f"b.{name}").read_bytes()
    assert text == f"{found}\n"


def test_a_model_that_is_refused_costs_no_answer(
    found: DiagnosisResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise FdbenchError("worse.toml: not written: it predicts worse.")

    monkeypatch.setattr(fdbench.api, "diagnose", lambda *_, **__: found)
    monkeypatch.setattr(DiagnosisResult, "write_model", refused)
    words = ["diagnose", "a.csv", "--model", AXIS, "--write-model", "worse.toml", "--json", str(tmp_path / "a.json")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code != 0
    assert done.stdout == f"{found}\n"
    assert json.loads((tmp_path / "a.json").read_text("utf-8")) == json.loads(json.dumps(found.answer.as_json()))


def test_tables_of_a_diagnosis_are_its_answer(found: DiagnosisResult) -> None:
    causes, parameters, gap = found.causes(), found.parameters(), found.gap()
    assert causes["effect"].tolist() == [cause.effect for cause in found.answer.causes] != []
    assert causes["probability"].tolist() == [cause.probability for cause in found.answer.causes]
    (row,) = parameters[parameters["parameter"] == "coulomb_asymmetry_N"].to_dict("records")
    quantity = found.answer.causes[0].parameters["coulomb_asymmetry_N"]
    assert (row["value"], (row["low"], row["high"]), row["unit"]) == (quantity.value, quantity.ci95, "N")
    assert gap["channel"].tolist() == found.channels
    assert gap.set_index("channel").loc["motor_force_N", "noise_floor"] == pytest.approx(
        found.answer.gap.channels["motor_force_N"].noise_floor
    )


def test_tables_without_rows_have_their_columns(found: DiagnosisResult) -> None:
    answer = dataclasses.replace(found.answer, causes=())
    empty = DiagnosisResult(dataclasses.replace(found.diagnosis, answer=answer))
    assert list(empty.causes()) == list(found.causes())
    assert list(empty.parameters()) == list(found.parameters())
    assert "<table>" in empty._repr_html_()


@pytest.mark.parametrize("over", ["time", "position", "frequency"])
def test_figures_of_a_diagnosis(found: DiagnosisResult, over: str) -> None:
    figure = found.figure("force", over)
    assert isinstance(figure, go.Figure)
    for name in ("simulated, re-calibrated", "simulated, repaired"):
        assert any(trace.name.startswith(name) for trace in figure.data), name
    assert "var(--" not in figure.to_json()
    if over == "time":
        measured = next(trace for trace in figure.data if trace.name == "measured")
        assert np.ptp(np.asarray(measured.y)) == pytest.approx(
            np.ptp(found.diagnosis.split.runs[0].channels["motor_force_N"]), rel=1e-6
        )


def test_what_a_figure_cannot_show_is_refused(found: DiagnosisResult) -> None:
    for wrong, message in (
        (("voltage",), "one of motor_force_N"),
        (("force", "times"), "Did you mean time"),
        (("force", "time", 7), "record 7: 0 to "),
        (("force", "time", -1), "record -1"),
        (("force", "position", 1), "of all records together"),
    ):
        with pytest.raises(FdbenchError, match=message):
            found.figure(*wrong)


def test_records_are_paths_records_or_frames(records: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[list[Record], list[Record]]] = []

    def stop(nominal: object, fitted: list[Record], judged: list[Record], *_: object) -> None:
        given.append((fitted, judged))

    monkeypatch.setattr("fdbench.api._diagnosis.find", stop)
    record = read_record(records[0])
    for one in (records[0], str(records[0]), record, pd.DataFrame(dict(record))):
        diagnose(load_scenario(AXIS), one)
        diagnose(load_scenario(AXIS), [one, one], holdouts=[one])
    assert [(len(fitted), len(judged)) for fitted, judged in given] == [(1, 0), (2, 1)] * 4
    assert all(item == record for pair in given for part in pair for item in part)
    with pytest.raises(SpecError, match="no record is one"):
        diagnose(load_scenario(AXIS), records, data="folder")


def test_cards_are_whole(found: DiagnosisResult, results: RunResult) -> None:
    card = found._repr_html_()
    assert "Cause: direction_dependent_friction" in card or "direction_dependent_friction" in card
    assert "motor force" in card
    ranking = results._repr_html_()
    assert "least_squares" in ranking
    assert "parameters: feed_drive" in ranking
    for text in (card, ranking, compare(results, results)._repr_html_()):
        assert text.count("<div") == text.count("</div>") > 0
        assert "<script" not in text


# ---- run and compare ----


def test_a_run_is_that_of_the_command(results: RunResult, tmp_path: Path) -> None:
    words = ("--scenario", "ShakerConstant-v1", "--estimator", "least_squares", "--seeds", "2", "--jobs", "1")
    command("run", *words, "--out", tmp_path)
    theirs, ours = Store(tmp_path).scores(), results.scores()
    names = [
        "scenario",
        "estimator",
        "seed",
        "metric",
        "unit",
        "status",
        "value",
        "scenario_digest",
        "estimator_digest",
    ]
    sides = [side[side["metric"] != "microseconds_per_sample"][names].reset_index(drop=True) for side in (ours, theirs)]
    pd.testing.assert_frame_equal(*sides, check_exact=True)
    assert set(results.written) == {"leaderboard.md", "report.html"}
    assert {"leaderboard.md", "report.html"} <= {path.name for path in results.folder.iterdir()}


def test_a_run_goes_on_in_its_folder(results: RunResult) -> None:
    again = run(["ShakerConstant-v1"], "least_squares", 2, results.folder, jobs=1)
    assert (again.summary.computed, again.written, again.unchanged) == (0, (), ("leaderboard.md", "report.html"))


def test_without_output_the_folder_goes_with_the_result() -> None:
    found = run("ShakerConstant-v1", [], seeds=1, jobs=1)
    folder = found.folder
    assert (folder / "scores.parquet").is_file()
    assert found.written == ()
    del found
    assert not folder.exists()


def test_rankings_are_tables_and_figures(results: RunResult) -> None:
    ranking = results.ranking("parameters")
    assert results.ranking("parameters", "feed_drive").equals(ranking)
    assert ranking["estimator"].tolist()[0] == "oracle"
    own = ranking.set_index("estimator").loc["least_squares"]
    assert own["rank"] == 1
    assert own["low"] <= own["score"] <= own["high"]
    figure = results.figure("parameters")
    assert {trace.name: trace.x[0] for trace in figure.data}["least_squares"] == own["score"]
    with pytest.raises(UnknownName, match=r"no ranking 'speed'; there is parameters feed_drive"):
        results.ranking("speed")


def test_a_comparison_tells_losses(results: RunResult, tmp_path: Path) -> None:
    even = compare(results, results.folder)
    assert not even.has_loss
    assert set(even.rows()["verdict"]) <= {"even", "not judged"}
    assert even.rows("loss").empty
    assert "Losses: 0" in str(even)
    worse = results.scores()
    rows = (worse["estimator"] == "least_squares") & (worse["metric"] == "parameter_error")
    worse.loc[rows, "value"] *= 3.0
    for name in ("scores", "parameters"):
        source = results.folder / f"{name}.parquet"
        (tmp_path / source.name).write_bytes(source.read_bytes())
    worse.to_parquet(tmp_path / "scores.parquet")
    lost = compare(results, tmp_path)
    assert lost.has_loss
    assert lost.rows("loss")["metric"].tolist() == ["parameter_error"]
    assert "parameter_error" in lost._repr_html_()
    with pytest.raises(UnknownName, match="verdict 'lost'"):
        lost.rows("lost")
    shown = json.loads(CliRunner().invoke(app, ["compare", str(results.folder), str(tmp_path), "--json"]).stdout)
    assert [row["metric"] for row in shown["rows"] if row["verdict"] == "loss"] == ["parameter_error"]
