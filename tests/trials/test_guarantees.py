"""What cause sets and false alarms rest on: the axes of a trial that nothing was learned from."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fdbench.cli import app
from fdbench.diagnosis.judge import cause_sets, false_alarms, probability_models
from fdbench.errors import SpecError
from fdbench.specification import load_toml, read
from fdbench.trials import guarantees
from fdbench.trials.score import AnswerTable, OpenedTrial

# Two effects; axes with one cause, none, two, one beside an unlisted one, one cause, none.
CHANCES = [[0.7, 0.1], [0.2, 0.3], [0.9, 0.8], [0.6, 0.0], [0.25, 0.5], [0.0, 0.0]]
PRESENT = [[1.0, 0.0], [0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [1.0, 0.0], [0.0, 0.0]]
UNKNOWN = [0.01, 0.02, 0.03, 0.9, 0.005, 0.06]


def trial(monkeypatch: pytest.MonkeyPatch, tier: str = "G", nonce: str = "ab" * 32, rows: slice = slice(None)) -> None:
    table = AnswerTable(
        effects=["backlash", "cogging"],
        types=["play", "actuator"],
        chances=np.array(CHANCES),
        present=np.array(PRESENT),
        unknown=np.array(UNKNOWN),
        none=np.zeros(6),
        has_unknown=np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]),
        closure=np.full(6, np.nan),
        oracle_closure=np.full(6, np.nan),
    ).rows(np.arange(6)[rows])
    parts: dict[str, Any] = {"manifest": {"tier": tier}, "key": {"nonce": nonce}, "answers": {}}
    monkeypatch.setattr(guarantees, "open_trial", lambda *paths: OpenedTrial(table=table, **parts))


def test_axes_with_one_cause_and_with_none_are_read_as_they_were_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    trial(monkeypatch)
    folder = tmp_path / "new"
    result = CliRunner().invoke(app, ["trial", "guarantees", "t", "a.json", "--key", "k.json", "-o", str(folder)])
    assert result.exit_code == 0, result.output
    single = read(cause_sets.AxesWithOneCause, load_toml(folder / cause_sets.FILE.name), "")
    empty = read(false_alarms.AxesWithoutCause, load_toml(folder / false_alarms.FILE.name), "")
    assert (single.truth, single.unknown) == ((0.25, 0.7), (0.005, 0.01))
    assert (empty.surest, empty.unknown) == ((0.0, 0.3), (0.02, 0.06))
    assert single.source == f"tier G, 2 axes with one cause, nonce {'ab' * 32}"
    assert empty.source == f"tier G, 2 axes without a cause, nonce {'ab' * 32}"


def test_a_trial_to_judge_by_or_to_learn_from_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    paths = (Path("t"), Path("a"), Path("k"))
    trial(monkeypatch, tier="F")
    with pytest.raises(SpecError, match="t: a trial of tier F; of tier G is expected"):
        guarantees.guarantees(*paths)
    learned = probability_models.models().source.rpartition("nonce ")[2][:64]
    trial(monkeypatch, nonce=learned)
    with pytest.raises(SpecError, match="learned from this trial; make another one"):
        guarantees.guarantees(*paths)
    trial(monkeypatch, rows=slice(1, 4))
    with pytest.raises(SpecError, match="make more cases"):
        guarantees.guarantees(*paths)
