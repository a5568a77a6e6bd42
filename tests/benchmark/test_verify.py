"""`fdbench verify`: files of estimators are found, failures fail again, a leaderboard prints what results give."""

import json
import re
from pathlib import Path

import pytest
from conftest import REPOSITORY
from typer.testing import CliRunner

from fdbench.benchmark.leaderboard import leaderboard
from fdbench.benchmark.run import run
from fdbench.benchmark.store import RunKey, Store
from fdbench.benchmark.verify import RUN, Difference, verify
from fdbench.benchmark.verify_leaderboard import figures, printed_otherwise
from fdbench.cli import app
from fdbench.errors import FdbenchError, UnknownName
from fdbench.estimator import estimators

pytestmark = pytest.mark.usefixtures("own_plugin_files")

GUESS = """import pathlib
from fdbench.estimator import BatchEstimator, Estimate


class Guess(BatchEstimator):
    def __init__(self, factor=1.0):
        self.factor = factor

    def fit(self, context, record):
        share = float(pathlib.Path(__file__).with_suffix(".txt").read_text())
        return Estimate(parameters={"beta_1": self.factor * share * context.nominal["beta_1"]})
"""
SLEEPS = GUESS.replace("        share", "        import time\n        time.sleep(60.0)\n        share")
TIME_S = 2.0


def found_files() -> list[str]:
    return sorted(estimators.files())


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with sealed results, and the files that they were made of."""
    folder = tmp_path_factory.mktemp("verify")
    text = (REPOSITORY / "scenarios" / "ShakerConstant-v1.toml").read_text("utf-8")
    short = "[timing]\nduration_s = 7.0\n\n[estimation]\nwindow_s = [2.4, 6.9]\n\n[[draw]]"
    (folder / "Short-v1.toml").write_text(text.replace("[[draw]]", short, 1), "utf-8")
    for name, content in (("guess", GUESS), ("sleeps", SLEEPS), ("faulty", "1 / 0\n")):
        (folder / f"{name}.py").write_text(content, "utf-8")
        (folder / f"{name}.txt").write_text("0.999", "utf-8")
    names = ["least_squares", *(str(folder / name) for name in ("guess.py[factor=1.001]", "sleeps.py", "faulty.py"))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimators, "_files", {})
        run([folder / "Short-v1.toml"], names, 2, folder / "out", sealed=True, time_limit_s=TIME_S)
    return folder


def test_estimators_of_files_are_found_by_their_paths_and_fail_as_before(place: Path) -> None:
    found = verify(place / "out", 100, scenarios=[place / "Short-v1.toml"])
    assert (found.runs, found.differences, found.changed) == (12, (), ())
    assert found.scores == sum(1 for score in Store(place / "out").scores()["metric"] if "microsec" not in score)
    assert found.largest < 1e-9
    assert found_files() == ["faulty", "guess", "sleeps"]
    kept = Store(place / "out").read_run(RunKey("Short-v1", "sleeps", 0))
    assert kept is not None
    assert kept.message.endswith(f"took longer than {TIME_S:g} s")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ("guess.py", r"^guess: \S+guess\.py, or a file that it uses, has changed .* Give .*: --estimator guess\.py\.$"),
        ("guess.txt", r"^guess: \S+guess\.py, or a file that it uses, has changed since these results were made\."),
    ],
)
def test_a_file_that_has_changed_is_told(place: Path, changed: str, message: str) -> None:
    file = place / changed
    before = file.read_text("utf-8")
    file.write_text(f"{before} ", "utf-8")
    try:
        with pytest.raises(UnknownName, match=message):
            verify(place / "out", 1, scenarios=[place / "Short-v1.toml"])
        assert "guess" not in found_files()
        estimators.declare(str(place / "guess.py"))
        assert "estimator guess[factor=1.001]" in verify(place / "out", 1, scenarios=[place / "Short-v1.toml"]).changed
    finally:
        file.write_text(before, "utf-8")


def test_files_that_are_not_there_any_more_are_all_told_at_once(place: Path, tmp_path: Path) -> None:
    names = ("guess", "faulty")
    for name in names:
        (place / f"{name}.py").rename(tmp_path / f"{name}.py")
    try:
        with pytest.raises(UnknownName, match="not at") as caught:
            verify(place / "out", 1, scenarios=[place / "Short-v1.toml"])
    finally:
        for name in names:
            (tmp_path / f"{name}.py").rename(place / f"{name}.py")
    for name in names:
        wanted = f"Give the file as it was then: --estimator {name}.py."
        assert f"{name}: its file is not at {place / name}.py any more. {wanted}" in str(caught.value)


def copied(place: Path, folder: Path) -> Store:
    """Return the results in another folder, whose runs may be edited."""
    store = Store(folder)
    for key in Store(place / "out").run_keys():
        store.run_file(key).parent.mkdir(parents=True, exist_ok=True)
        store.run_file(key).write_bytes(Store(place / "out").run_file(key).read_bytes())
    (folder / "seal.json").write_bytes((place / "out" / "seal.json").read_bytes())
    return store


def test_another_status_is_a_difference(place: Path, tmp_path: Path) -> None:
    store, key = copied(place, tmp_path), RunKey("Short-v1", "least_squares", 1)
    document = json.loads(store.run_file(key).read_text("utf-8"))
    document["scores"] = [{**score, "value": None, "status": "failed"} for score in document["scores"]]
    store.run_file(key).write_text(json.dumps({**document, "status": "failed"}), "utf-8")
    faulty = RunKey("Short-v1", "faulty", 0)
    document = json.loads(store.run_file(faulty).read_text("utf-8"))
    document["scores"] = [{**score, "value": 1.0, "status": "ok"} for score in document["scores"]]
    store.run_file(faulty).write_text(json.dumps({**document, "status": "ok"}), "utf-8")
    half = RunKey("Short-v1", "least_squares", 0)
    text = store.run_file(half).read_text("utf-8")
    document = json.loads(text)
    for score in document["scores"]:
        if score["metric"] == "parameter_error":
            score["value"], score["status"] = None, "skipped"
    store.run_file(half).write_text(json.dumps(document), "utf-8")
    store.merge([key, half, faulty])
    found = verify(tmp_path, 100, scenarios=[place / "Short-v1.toml"])
    fails = "failed (faulty.py: cannot be imported: line 1: ZeroDivisionError: division by zero)"
    assert sorted(found.differences, key=lambda line: line.key) == [
        Difference(key=faulty, metric=RUN, stored="ok", now=fails),
        Difference(key=half, metric="parameter_error", stored="skipped", now="ok"),
        Difference(key=key, metric=RUN, stored="failed", now="ok"),
    ]
    assert not found.is_same


def test_an_estimator_that_was_not_sealed_and_a_seal_of_another_one_are_told(place: Path, tmp_path: Path) -> None:
    store = copied(place, tmp_path)
    keys = [key for key in store.run_keys() if key.estimator in ("least_squares", "null", "oracle")]
    store.merge(keys)
    drawn = json.loads((tmp_path / "seal.json").read_text("utf-8"))
    for sealed, changed in (
        ({"null": drawn["estimators"]["null"]}, ("the seal",)),
        ({**drawn["estimators"], "null": "0" * 64}, ("estimator null",)),
    ):
        (tmp_path / "seal.json").write_text(json.dumps({**drawn, "estimators": sealed}), "utf-8")
        assert verify(tmp_path, 1, scenarios=[place / "Short-v1.toml"]).changed == changed


# ---- the leaderboard ----


def test_every_printed_figure_counts(place: Path, tmp_path: Path) -> None:
    text, file = leaderboard(Store(place / "out")), tmp_path / "board.md"

    def differences(printed: str) -> list[str]:
        file.write_text(printed, "utf-8")
        return printed_otherwise(file, text)

    assert differences(text) == []
    assert differences(text.replace("Means over the seeds", "Means over all seeds")) == []
    top, tables = text.split("\n## ", 1)
    sealed = re.compile(r"`[0-9a-f-]{12,}")
    for part in re.findall(r"(?:nonce|commit|code)\s`[^`]+`|`[0-9a-f]{16}` \|", top):
        forged = sealed.sub(lambda old: old[0].translate(str.maketrans("0123456789abcdef", "123456789abcdef0")), part)
        assert len(differences(text.replace(part, forged, 1))) == 1, part
    # Every number of a table, and of the digest of a scenario.
    spots = [
        spot
        for line in re.finditer(r"^(?:\|(?! ---).*|.*seeds, digest.*|Not used.*)$", tables, re.MULTILINE)
        for spot in range(*line.span())
        if tables[spot].isdigit()
    ]
    assert len(spots) > 400
    for spot in spots:
        forged = f"{tables[:spot]}{(int(tables[spot]) + 1) % 10}{tables[spot + 1 :]}"
        assert differences(f"{top}\n## {forged}"), tables[spot - 30 : spot + 30]
    row = next(line for line in tables.splitlines() if "`least_squares`" in line)
    for forged in (text.replace(f"{row}\n", "", 1), text.replace(row, f"{row}\n{row.replace('least', 'most')}", 1)):
        assert len(differences(forged)) == row.count("|") - 1


def test_what_is_said_is_where_it_stands(place: Path, tmp_path: Path) -> None:
    text, file = leaderboard(Store(place / "out")), tmp_path / "board.md"
    nonce, score = figures(text)["nonce"], figures(text)["parameters: feed_drive, least_squares, score"]
    forged = text.replace(nonce, "0" * 64, 1).replace(f"| `least_squares` | {score}", "| `least_squares` | 0.999", 1)
    file.write_text(forged, "utf-8")
    assert printed_otherwise(file, text) == [
        f"nonce: '{'0' * 64}' is printed, '{nonce}' follows from the results",
        f"parameters: feed_drive, least_squares, score: '0.999' is printed, '{score}' follows from the results",
    ]
    for content, message in ((b"text\n", "no leaderboard"), (b"\xff", "cannot be read"), (None, "No such file")):
        file.unlink()
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(FdbenchError, match=message):
            printed_otherwise(file, text)
        file.touch()


def test_the_command_holds_a_leaderboard_against_the_results(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    store = copied(place, tmp_path)
    store.merge([key for key in store.run_keys() if key.estimator in ("least_squares", "null", "oracle")])
    (tmp_path / "seal.json").unlink()  # it is of more than these
    words = ["verify", ".", "--runs", "1", "--scenario", str(place / "Short-v1.toml")]
    without = CliRunner().invoke(app, words)
    assert (without.exit_code, without.stdout.count("\n")) == (0, 1)
    written = CliRunner().invoke(app, ["leaderboard", ".", "-o", "board.md"])
    assert written.exit_code == 0
    good = CliRunner().invoke(app, [*words, "--leaderboard", "board.md"])
    assert good.exit_code == 0, good.output
    assert good.stdout.startswith("board.md prints what these results give.\n1 runs made again, ")
    text = (tmp_path / "board.md").read_text("utf-8")
    score = figures(text)["parameters: feed_drive, least_squares, score"]
    forged = text.replace(f"| `least_squares` | {score}", "| `least_squares` | 0.999", 1)
    (tmp_path / "leaderboard.md").write_text(forged, "utf-8")
    for options, file in (([], "leaderboard.md"), (["--leaderboard", "leaderboard.md"], "leaderboard.md")):
        bad = CliRunner().invoke(app, [*words, *options])
        assert bad.exit_code == 1
        said = f"{file}: parameters: feed_drive, least_squares, score: '0.999' is printed, '{score}' follows from the"
        assert bad.stdout.startswith(said)
        assert "1 runs made again" in bad.stdout
    refused = CliRunner().invoke(app, [*words, "--leaderboard", "none.md"])
    assert (refused.exit_code, refused.stderr) == (2, "fdbench: none.md: cannot be read: No such file or directory.\n")
