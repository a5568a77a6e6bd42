"""The diagnosis on a few sealed cases of each tier: far fewer than a trial needs, enough to notice that it broke."""

from pathlib import Path

import pytest

from fdbench.trials.answer import answer
from fdbench.trials.make import make
from fdbench.trials.score import score
from fdbench.virtual_axes.cases import Tier

NONCE = "0ddba11" + "0" * 57


@pytest.mark.parametrize(("tier", "count", "least"), [("A", 1, 1), ("B", 2, 1), ("C", 1, 1), ("D", 2, 1)])
def test_cases_whose_injected_set_is_named_exactly(tmp_path: Path, tier: str, count: int, least: int) -> None:
    folder, key, answers = tmp_path / "trial", tmp_path / "key.json", tmp_path / "answers.json"
    make(folder, key, Tier(tier), count, NONCE)
    found = answer(folder, "fdbench", answers)
    assert [case["message"] for case in found["cases"].values() if case["status"] != "ok"] == []
    quantities = score(folder, answers, key)["quantities"]
    assert round(quantities["exact_set"]["value"] * count) >= least
    assert quantities["brier"]["value"] < 0.05
