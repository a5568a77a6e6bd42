"""What probabilities are drawn from, how it is learned, and the board of published trials."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize

from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.probability_models import Feature, ProbabilityModel
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.errors import RecordError, SpecError
from fdbench.specification import load_toml, read
from fdbench.trials import board, learn
from fdbench.trials.learn import Claim
from fdbench.trials.make import make
from fdbench.virtual_axes import cases as tiers
from fdbench.virtual_axes.cases import Tier

WEIGHTS = np.array([-0.5, 1.5, -0.8])
FREE = np.array([1e-6, learn.RIDGE, learn.RIDGE])  # bias and weights of a model that is learned from nothing


def drawn(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    design = np.column_stack((np.ones(n), rng.standard_normal((n, 2))))
    right = rng.random(n) < 1.0 / (1.0 + np.exp(-design @ WEIGHTS))
    return design, right.astype(float)


def test_newton_finds_the_maximum_of_the_penalised_likelihood() -> None:
    design, right = drawn(80, np.random.default_rng(1))

    share = np.linspace(0.2, 1.5, 80)

    def loss(weights: np.ndarray) -> float:
        z = design @ weights
        return float(share @ (np.logaddexp(0.0, z) - right * z) + 0.5 * learn.RIDGE * np.sum(weights[1:] ** 2))

    expected = minimize(loss, np.zeros(3), method="BFGS", options={"gtol": 1e-8}).x
    np.testing.assert_allclose(learn.newton(design, right, share, np.zeros(3), FREE), expected, atol=2e-5)


def test_newton_survives_claims_that_signs_tell_apart_wholly() -> None:
    design = np.column_stack((np.ones(40), np.linspace(-1.0, 1.0, 40)))
    weights = learn.newton(design, (design[:, 1] > 0.0).astype(float), np.ones(40), np.zeros(2), FREE[:2])
    assert np.isfinite(weights).all()
    assert weights[1] > 1.0


def test_balanced_claims_are_right_as_often_as_asked() -> None:
    found = claims_of("unknown", 90, np.random.default_rng(4))
    given = learn.balanced(found, 0.25)
    total = sum(claim.weight for claim in given)
    assert total == pytest.approx(90.0)
    assert sum(claim.weight for claim in given if claim.right) == pytest.approx(0.25 * total)


def claims_of(kind: str, n: int, rng: np.random.Generator) -> list[learn.Claim]:
    design, right = drawn(n, rng)
    return [
        learn.Claim(kind=kind, features={"one": 5.0 + 3.0 * row[1], "two": row[2]}, right=bool(value))
        for row, value in zip(design, right, strict=True)
    ]


def test_learned_probabilities_are_calibrated_on_other_claims() -> None:
    rng = np.random.default_rng(2)
    model = learn.fitted(claims_of("effect", 800, rng))
    others = claims_of("effect", 4000, rng)
    chances = np.array([model.probability(claim.features) for claim in others])
    right = np.array([claim.right for claim in others])
    for low in (0.0, 0.25, 0.5, 0.75):
        inside = (chances >= low) & (chances < low + 0.25)
        assert abs(chances[inside].mean() - right[inside].mean()) < 0.06


def test_what_is_seldom_right_by_its_name_is_less_probable() -> None:
    rng = np.random.default_rng(12)
    known = [dataclasses.replace(claim, names=("backlash",)) for claim in claims_of("effect", 400, rng)]
    never = [dataclasses.replace(claim, names=("cogging",), right=False) for claim in claims_of("effect", 20, rng)]
    model = learn.fitted([*known, *never])
    features = known[0].features
    chances = [model.probability(features, names) for names in (["backlash"], ["backlash", "cogging"], ["cogging"])]
    assert chances[2] < chances[1] < chances[0]
    assert model.names["cogging"] < -1.0 < -0.5 < model.names["backlash"]
    assert model.probability(features, ["dead_time"]) == model.probability(features)
    further = learn.fitted(never[:3], model)
    assert model.names["backlash"] == pytest.approx(further.names["backlash"], abs=0.1)
    assert further.names["cogging"] < model.names["cogging"] + 0.1


def test_models_are_read_as_they_were_written(tmp_path) -> None:
    rng = np.random.default_rng(3)
    found = [claim for kind in learn.KINDS for claim in claims_of(kind, 60, rng)]
    file = tmp_path / "models.toml"
    learn.write_models(found, file, "tier L, 60 cases, nonce abc")
    models = read(confidence.ProbabilityModels, load_toml(file), file.name)
    assert models.source == "tier L, 60 cases, nonce abc"
    own = [claim for claim in found if claim.kind == "value"]
    assert models.value.claims == 60
    assert models.value.right == sum(claim.right for claim in own)
    expected = learn.fitted(own)
    for claim in own:
        assert models.value.probability(claim.features) == pytest.approx(expected.probability(claim.features), abs=1e-3)


def test_models_are_learned_further_from_those_before(tmp_path) -> None:
    rng = np.random.default_rng(8)
    files = [tmp_path / name for name in ("before.toml", "after.toml")]
    many, few = ([claim for kind in learn.KINDS for claim in claims_of(kind, n, rng)] for n in (400, 12))
    learn.write_models(many, files[0], "many")
    before = read(confidence.ProbabilityModels, load_toml(files[0]), files[0].name)
    learn.write_models(few, files[1], "few", before)
    after = read(confidence.ProbabilityModels, load_toml(files[1]), files[1].name)
    anew = learn.fitted([claim for claim in few if claim.kind == "value"])
    moved = abs(after.value.features["one"].weight - before.value.features["one"].weight)
    assert after.value.claims == 412
    assert 0.0 < moved < abs(anew.features["one"].weight - before.value.features["one"].weight)


def test_a_model_is_never_surer_than_its_claims() -> None:
    model = ProbabilityModel(
        bias=0.0, features={"s": Feature(centre=0.0, scatter=1.0, weight=50.0)}, claims=98, right=49
    )
    assert model.probability({"s": 1e9}) == pytest.approx(0.99)
    assert model.probability({"s": -1e9}) == pytest.approx(0.01)
    assert model.probability({"s": 0.0}) == 0.5


def unknown_features(**changes: float) -> dict[str, float]:
    usual = {"misfit": 2.0, "worst": 9.0, "strain": 5.0, "closed": 0.9, "surest": 0.3}
    return confidence.unknown_features(**{**usual, "measured": True, "at_limits": 0, **changes})


def test_the_shipped_models_read_the_features_that_are_given() -> None:
    models = confidence.models()
    given = {
        "value": confidence.value_features(3.0, 1.0, 1.0),
        "unknown": unknown_features(),
    }
    for kind, features in given.items():
        model: ProbabilityModel = getattr(models, kind)
        assert set(model.features) == set(features)
        assert 0.0 < model.probability(features) < 1.0
    assert {field.name for field in dataclasses.fields(models)} == {*learn.KINDS, "source"}
    usual = models.unknown.probability(unknown_features())
    assert models.unknown.probability(unknown_features(misfit=8.0, worst=60.0)) > usual
    assert models.unknown.probability(unknown_features(strain=40.0)) > usual
    assert models.unknown.probability(unknown_features(at_limits=1)) > usual
    assert models.unknown.probability(unknown_features(closed=0.5)) > usual
    assert models.unknown.probability(unknown_features(surest=0.99)) < usual


def test_claims_are_judged_by_the_truth() -> None:
    features = {"effect": {"a": {"s": 1.0}, "b": {"s": 2.0}}, "suspect": {}, "value": {"c": {"s": 0.0}}}
    features |= {"unknown": {"unknown": {"s": 0.0}}}
    truth = {"listed": [{"name": "a"}], "unlisted": [{"name": "odd"}]}
    judged = [(claim.kind, claim.right) for claim in learn.claims(features, truth)]
    assert judged == [("effect", True), ("effect", False), ("value", False), ("unknown", True)]


# ---- the board ----


def sheet(diagnoser: str, tier: str, exact: float) -> dict:
    quantity = {"quantity": "exact set", "value": exact, "ci95": [exact - 0.1, exact + 0.1], "cases": 10}
    effect = {"effect": "backlash", "cases": 3, "recall": 0.67, "mean_probability": 0.6, "mistaken_for": {"cogging": 1}}
    form = {"form": "bump", "cases": 2, "mean_unknown_probability": 0.8, "mistaken_for": {}}
    return {
        "diagnoser": diagnoser,
        "tier": tier,
        "cases": 10,
        "failed": 0,
        "seconds_per_case": 7.25,
        "made_by_commit": "0123456789abcdef",
        "nonce": "feed",
        "quantities": {"exact_set": quantity},
        "effects": [effect],
        "unlisted": [form] if tier == "C" else [],
    }


def test_board_ranks_diagnosers_within_a_tier() -> None:
    text = board.board([sheet("null", "B", 0.15), sheet("fdbench", "B", 0.8), sheet("fdbench", "C", 0.7)])
    assert text.index("### Tier B") < text.index("| `fdbench` | 0.80 (0.70 to 0.90)") < text.index("| `null` | 0.15")
    assert text.index("| `null`") < text.index("### Tier C")
    assert "10 cases, made by 0123456789ab, nonce `feed`." in text
    assert "| `backlash` | 3 | 0.67 | 0.60 | `cogging` 1 |" in text
    assert "| bump | 2 | 0.80 |  |" in text


def test_no_board_without_sheets() -> None:
    assert board.board([]) == ""


def test_published_sheets_make_a_board() -> None:
    sheets = board.published()
    text = board.board(sheets)
    for item in sheets:
        assert item["tier"] in board.TIERS
        assert f"| `{item['diagnoser']}` |" in text
        assert json.dumps(item["quantities"])


# ---- learning from a trial ----


@pytest.fixture(scope="module")
def two_cases(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the folder of a trial to learn from, and its key."""
    place = tmp_path_factory.mktemp("trial")
    folder, key = place / "L", place / "key.json"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(tiers, "LIMITED_DATA", 1.0)
        make(folder, key, Tier.L, 2, "feed" * 16)
    return folder, key


def test_learning_goes_on_where_it_stopped(
    two_cases: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output, asked = tmp_path / "models.toml", []

    def diagnosed(nominal: Nominal, records: object, holdouts: object) -> SimpleNamespace:
        asked.append(nominal)
        if len(asked) == 2:
            raise KeyboardInterrupt
        features = {kind: {f"{kind} {place}": {"s": float(place)} for place in range(4)} for kind in learn.KINDS[:3]}
        return SimpleNamespace(features={**features, "unknown": {"unknown": {"s": 0.0}}})

    monkeypatch.setattr(learn, "diagnose", diagnosed)
    with pytest.raises(KeyboardInterrupt):
        learn.learn([two_cases], output)
    assert not output.exists()
    with pytest.raises(SpecError, match="claims of kind 'effect' that are right and wrong"):
        learn.learn([two_cases], output)
    assert len(asked) == 3  # the first case is not diagnosed again


def test_a_case_that_cannot_be_diagnosed_is_left_out_and_named(
    two_cases: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output, asked = tmp_path / "models.toml", []

    def diagnosed(nominal: Nominal, records: object, holdouts: object) -> SimpleNamespace:
        asked.append(nominal)
        if len(asked) == 1:
            raise RecordError("the axis leaves its limits")
        return SimpleNamespace(features={"own": len(asked)})

    def claimed(features: dict[str, int], truth: object, of_case: float) -> list[Claim]:
        assert features == {"own": 2}
        assert of_case == 0.5  # the axes of this tier are of one kind
        return [
            Claim(kind=kind, features={"s": sign}, right=sign > 0.0) for kind in learn.KINDS for sign in (-1.0, 1.0)
        ]

    monkeypatch.setattr(learn, "diagnose", diagnosed)
    monkeypatch.setattr(learn, "claims", claimed)
    found = learn.learn([two_cases], output)
    assert len(found.claims) == 2 * len(learn.KINDS)
    (words,) = found.left_out
    assert words.startswith(str(two_cases[0]))
    assert "leaves its limits" in words
    assert output.exists()


def test_a_share_is_right_whatever_the_cases_weigh() -> None:
    found = [
        Claim(kind="unknown", features={}, right=right, weight=weight)
        for right, weight in [(True, 1.0), (True, 0.5), (False, 0.5), (False, 2.0), (False, 1.0)]
    ]
    weights = [claim.weight for claim in learn.balanced(found, 0.2)]
    assert sum(weights) == pytest.approx(5.0)
    assert sum(weights[:2]) == pytest.approx(1.0)
    assert weights[0] == pytest.approx(2.0 * weights[1])


@pytest.mark.parametrize(("name", "is_hidden"), [("quadratic_drag", True), ("constant_force", False)])
def test_tier_to_learn_from_excludes_effects_from_the_library(
    name: str, is_hidden: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tiers, "LIMITED_DATA", 1.0)
    monkeypatch.setattr(tiers, "TAKEN_OUT", 1.0)
    monkeypatch.setattr(tiers, "HOW_MANY", (0.0, 1.0, 0.0, 0.0))
    case = tiers.draw_case(Tier.L, [name], np.random.default_rng(7))
    listed, unlisted = ([item["name"] for item in case.truth[part]] for part in ("listed", "unlisted"))
    assert unlisted == case.model.get("exclude", [])
    assert (listed, unlisted) == (([], [name]) if is_hidden else ([name], []))  # a nominal parameter stays listed
    library = [kind.name for kind in read(Nominal, case.model, "model").library]
    assert (name in library) != is_hidden
