"""The diagnosis on a sealed case of each tier of the second implementation: enough to notice that it broke."""

from pathlib import Path

import pytest

from fdbench.trials.answer import answer
from fdbench.trials.make import make
from fdbench.trials.score import score
from fdbench.virtual_axes.cases import Tier

NONCE = "0ddba11" + "0" * 57


@pytest.mark.parametrize("tier", ["B", "C", "D"])
def test_a_case_whose_injected_set_is_named_exactly(tmp_path: Path, tier: str) -> None:
    folder, key, answers = tmp_path / "trial", tmp_path / "key.json", tmp_path / "answers.json"
    make(folder, key, Tier(tier), 1, NONCE)
    found = answer(folder, "fdbench", answers)
    assert [case["message"] for case in found["cases"].values() if case["status"] != "ok"] == []
    quantities = score(folder, answers, key)["quantities"]
    assert quantities["exact_set"]["value"] == 1.0
    assert quantities["brier"]["value"] < 0.05
