"""The diagnosis on a sealed case of each tier of the second implementation: enough to notice that it broke."""

from pathlib import Path

import pytest

from fdbench.trials import seal
from fdbench.trials.answer import answer
from fdbench.trials.make import make
from fdbench.trials.score import score
from fdbench.virtual_axes.cases import Tier

NONCE = "0ddba11" + "0" * 57


@pytest.mark.parametrize("tier", ["B", "C", "D"])
def test_a_case_whose_injected_effects_are_the_surest(tmp_path: Path, tier: str) -> None:
    folder, key, answers = tmp_path / "trial", tmp_path / "key.json", tmp_path / "answers.json"
    make(folder, key, Tier(tier), 1, NONCE)
    found = answer(folder, "fdbench", answers)
    assert [case["message"] for case in found["cases"].values() if case["status"] != "ok"] == []
    (case,), (known,) = found["cases"].values(), seal.read_json(key, "the key of a trial")["cases"].values()
    injected = {item["name"] for item in known["truth"]["listed"]}
    surest = sorted(case["effects"], key=lambda name: -case["effects"][name])
    assert set(surest[: len(injected)]) == injected
    quantities = score(folder, answers, key)["quantities"]
    if tier == "D":  # of its two effects a LuGre friction has 0.46, and is not named
        assert quantities["micro_f1"]["value"] > 0.6
    else:
        assert quantities["exact_set"]["value"] == 1.0
    assert quantities["brier"]["value"] < 0.05
