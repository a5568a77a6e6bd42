"""Sealed runs: digests first, then the nonce; what is stored comes out again, and what was changed is told."""

import json
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY
from typer.testing import CliRunner

from fdbench.benchmark import seal
from fdbench.benchmark.leaderboard import leaderboard
from fdbench.benchmark.run import run
from fdbench.benchmark.store import RunKey, Store
from fdbench.benchmark.verify import verify
from fdbench.cli import app
from fdbench.errors import FdbenchError, SpecError
from fdbench.estimator import estimators

ESTIMATOR = """from fdbench.estimator import BatchEstimator, Estimate


class Guess(BatchEstimator):
    def fit(self, context, record):
        return Estimate(parameters={"beta_1": BETA_1})
"""


@pytest.fixture(autouse=True)
def _own_plugin_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimators, "_files", {})


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    file = tmp_path / "Short-v1.toml"
    text = (REPOSITORY / "scenarios" / "ShakerConstant-v1.toml").read_text("utf-8")
    file.write_text(
        text.replace("[[draw]]", "[timing]\nduration_s = 7.0\n\n[estimation]\nwindow_s = [2.4, 6.9]\n\n[[draw]]", 1)
    )
    return file


def values(folder: Path) -> list[float | None]:
    scores = Store(folder).scores()
    return scores[scores["metric"] == "parameter_error"].sort_values(["estimator", "seed"])["value"].tolist()


def test_the_nonce_is_drawn_after_the_digests(tmp_path: Path, scenario: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []

    def drawn() -> str:
        seen.append(json.loads((tmp_path / "out" / seal.FILE).read_text()))
        return "ab" * 32

    monkeypatch.setattr(seal, "new_nonce", drawn)
    run([scenario], ["least_squares"], 1, tmp_path / "out", sealed=True)
    assert len(seen) == 1
    assert seen[0]["nonce"] == ""
    assert set(seen[0]["estimators"]) == {"least_squares", "null"}
    assert set(seen[0]["scenarios"]) == {"Short-v1"}
    assert json.loads((tmp_path / "out" / seal.FILE).read_text()) == {**seen[0], "nonce": "ab" * 32}
    assert f"`{'ab' * 32}`" in leaderboard(Store(tmp_path / "out"))


def test_sealed_seeds_are_others_and_can_be_repeated(tmp_path: Path, scenario: Path) -> None:
    for out in ("one", "two"):
        run([scenario], ["least_squares"], 2, tmp_path / out, sealed=True)
    run([scenario], ["least_squares"], 2, tmp_path / "public")
    found = seal.read_seal(tmp_path / "one")
    assert found is not None
    run([scenario], ["least_squares"], 2, tmp_path / "again", nonce=found.nonce)
    assert len({tuple(values(tmp_path / out)) for out in ("one", "two", "public")}) == 3
    assert values(tmp_path / "again") == values(tmp_path / "one")
    assert "no digest was written down before" in leaderboard(Store(tmp_path / "again"))


def test_a_sealed_run_goes_on_with_its_nonce_but_not_with_another_estimator(tmp_path: Path, scenario: Path) -> None:
    file, out = tmp_path / "guess.py", tmp_path / "out"
    file.write_text(ESTIMATOR.replace("BETA_1", "0.8"))
    first = run([scenario], [str(file)], 1, out, sealed=True)
    before = seal.read_seal(out)
    again = run([scenario], [str(file)], 2, out, sealed=True)
    assert (first.computed, again.reused, again.computed) == (3, 3, 3)
    assert seal.read_seal(out) == before
    file.write_text(ESTIMATOR.replace("BETA_1", "0.9"))
    with pytest.raises(FdbenchError, match="sealed with other estimators"):
        run([scenario], [str(file)], 2, out, sealed=True)


def test_public_and_sealed_runs_do_not_mix(tmp_path: Path, scenario: Path) -> None:
    out = tmp_path / "out"
    run([scenario], ["least_squares"], 1, out, sealed=True)
    assert run([scenario], ["least_squares"], 1, out).computed == 3


def test_what_is_stored_comes_out_again_or_is_told(tmp_path: Path, scenario: Path) -> None:
    out = tmp_path / "out"
    run([scenario], ["least_squares"], 2, out, sealed=True)
    found = verify(out, 3, scenarios=[scenario])
    assert (found.runs, found.is_same) == (2, True)
    assert found.scores > 3
    assert found.largest < 1e-9
    key = RunKey("Short-v1", "least_squares", 1)
    text = Store(out).run_file(key).read_text()
    (stored,) = [one.value for one in Store(out).read_run(key).scores if one.metric == "parameter_error"]  # type: ignore[union-attr]
    Store(out).run_file(key).write_text(text.replace(f'"value": {stored!r}', f'"value": {0.9 * stored!r}'))  # type: ignore[operator]
    Store(out).merge(Store(out).run_keys())
    found = verify(out, 100, scenarios=[scenario])
    assert [(line.key, line.metric) for line in found.differences] == [(key, "parameter_error")]
    assert not found.is_same
    assert found.changed == ()
    drawn = json.loads((out / seal.FILE).read_text())
    (out / seal.FILE).write_text(json.dumps({**drawn, "nonce": "0" * 64}))
    assert verify(out, 1, scenarios=[scenario]).changed == ("the seal",)


@pytest.mark.parametrize("content", ["", "[]", '{"nonce": 3}', '{"nonce": "xyz"}', "[" * 100_000])
def test_a_file_that_is_no_seal_is_told(tmp_path: Path, content: str) -> None:
    (tmp_path / seal.FILE).write_text(content)
    with pytest.raises(FdbenchError, match=r"seal\.json: not a seal"):
        seal.read_seal(tmp_path)


def test_wrong_nonces_are_refused(tmp_path: Path, scenario: Path) -> None:
    with pytest.raises(SpecError, match="nonce: 'xyz' is not"):
        run([scenario], ["least_squares"], 1, tmp_path / "out", nonce="xyz")
    with pytest.raises(FdbenchError, match="leave out one of the two"):
        run([scenario], ["least_squares"], 1, tmp_path / "out", nonce="ab" * 32, sealed=True)


def test_the_command_says_whether_all_is_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run(["ShakerConstant-v1"], ["least_squares"], 1, "results", sealed=True)
    result = CliRunner().invoke(app, ["verify", "--runs", "1"])
    assert result.exit_code == 0, result.output
    assert "1 runs made again" in result.output
    assert "the same; largest relative difference" in result.output
