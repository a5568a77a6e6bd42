"""Blind trials: second implementation, seals, the chain from make to score, and the score sheet."""

import ast
import json
import math
import shutil
import sys
import types
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fdbench.cli import app
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.effects import effects
from fdbench.errors import PluginError, SpecError, UnknownName
from fdbench.nonce import check_nonce, new_nonce
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.specification import load_toml, read
from fdbench.trials import seal
from fdbench.trials.answer import answer, as_listed
from fdbench.trials.board import board
from fdbench.trials.diagnoser import CaseAnswer, diagnosers
from fdbench.trials.make import MANIFEST, listed_effects, make, read_manifest
from fdbench.trials.score import AnswerTable, score, sheet
from fdbench.virtual_axes import cases as tiers
from fdbench.virtual_axes import independent_axis as independent_axis
from fdbench.virtual_axes import independent_simulator as independent_simulator
from fdbench.virtual_axes import protocol
from fdbench.virtual_axes.bench import ERRORS
from fdbench.virtual_axes.cases import Tier
from fdbench.virtual_axes.independent_axis import IndependentBench, injectables
from fdbench.virtual_axes.library_axis import LibraryBench
from fdbench.virtual_axes.oracle import held_out_gaps, oracle_closure

NONCE = "5eed" * 16
PERIOD_S = protocol.PERIOD_S
NO_ERRORS = dict.fromkeys(ERRORS, 0.0)
SIDES = ("motor_position_m", "table_position_m")


def nominal() -> Nominal:
    """Return the nominal axis as it stands in its file."""
    return read(Nominal, load_toml(tiers.AXIS), "axis.toml")


def bench_apart() -> IndependentBench:
    """Return a machine of the second implementation that is as its nominal model, without latency."""
    bench = IndependentBench(nominal(), NO_ERRORS, PERIOD_S, np.random.default_rng(0))
    bench.sensors = bench.sensors._replace(latency=0.0)
    bench.sliding = 1.0
    return bench


STROKES = moves((0.0, 0.02, 0.0, 0.004), (0.1, 0.02), 4.0, PERIOD_S, 0.2)


# ---- the second implementation ----


def test_second_implementation_imports_nothing_of_the_package() -> None:
    tree = ast.parse(Path(independent_simulator.__file__).read_text("utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module or "." for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in imported} == {"numpy", "numba", "typing"}


def test_healthy_axes_of_both_implementations_agree() -> None:
    apart = bench_apart().axis({}).readings(STROKES, None)
    library = LibraryBench(nominal(), NO_ERRORS, PERIOD_S).axis({}).readings(STROKES, None)
    for name in ("motor_position_m", "table_position_m", "motor_force_N"):
        difference = np.std(apart[name] - library[name])
        assert difference < 1e-3 * np.std(library[name]), name


def test_every_injected_form_changes_what_is_read_and_stays_finite() -> None:
    bench, rng = bench_apart(), np.random.default_rng(1)
    clean = bench.axis({}).readings(STROKES, None)
    names = [*bench.names(listed=True), *bench.names(listed=False)]
    assert len(bench.names(listed=True)) >= 12
    for name in names:
        found = bench.axis({name: bench.draw(name, rng)}).readings(STROKES, None)
        assert all(np.isfinite(values).all() for values in found.values()), name
        assert any(np.std(found[key] - clean[key]) > 0.0 for key in clean), name


def test_listed_forms_are_effects_of_the_library_and_unlisted_ones_are_not() -> None:
    names = {item.name for item in injectables().listed}
    assert names <= set(listed_effects())
    assert not {item.name for item in injectables().unlisted} & set(effects.names())


@pytest.mark.parametrize(
    ("values", "expected_N"),
    [
        ({}, 120.0 + 600.0 * 0.1),
        ({"preload_friction_N": 30.0}, 150.0 + 600.0 * 0.1),
        ({"weight_N": 20.0}, 140.0 + 600.0 * 0.1),
        ({"uneven_friction_N": 7.0, "uneven_viscous_N_s_per_m": 40.0}, 127.0 + 640.0 * 0.1),
        ({"presliding_distance_m": 1e-5}, 120.0 + 600.0 * 0.1),
        ({"drag_N_at_1_m_per_s": 500.0}, 120.0 + 600.0 * 0.1 + 500.0 * 0.1**1.75),
        ({"line_force_N": 20.0, "line_frequency_Hz": 50.0}, 120.0 + 600.0 * 0.1),
        ({"loop_force_N": 25.0}, 120.0 + 600.0 * 0.1),
    ],
)
def test_steady_force_at_constant_speed(values: dict[str, float], expected_N: float) -> None:
    reference = moves((0.0, 0.12), (0.1,), 4.0, PERIOD_S)
    force = bench_apart().axis({"it": values}).readings(reference, None)["motor_force_N"]
    middle = len(reference) // 2
    assert np.mean(force[middle : middle + 100]) == pytest.approx(expected_N, rel=2e-3)


def test_geometry_of_screw_and_gap() -> None:
    reference = moves((0.0, 0.1, 0.0), (0.05,), 2.0, PERIOD_S, 0.5)
    clean, sloped, loose = (
        bench_apart().axis({"it": values}).readings(reference, None)
        for values in ({}, {"screw_slope": 1e-4}, {"gap_m": 2e-5})
    )

    def behind(found: dict[str, np.ndarray]) -> np.ndarray:
        return found["motor_position_m"] - found["table_position_m"]

    there = np.flatnonzero(reference[:, 0] > 0.0999)[-1]
    assert behind(sloped)[there] - behind(clean)[there] == pytest.approx(-1e-4 * 0.1, rel=0.02)
    moving = np.abs(reference[:, 1]) > 0.049
    forwards, backwards = moving & (reference[:, 1] > 0.0), moving & (reference[:, 1] < 0.0)
    lost = np.median((behind(loose) - behind(clean))[forwards]) - np.median((behind(loose) - behind(clean))[backwards])
    assert lost == pytest.approx(2e-5, rel=0.05)


def test_late_force_is_late_by_what_is_asked() -> None:
    reference = moves((0.0, 0.05), (0.2,), 8.0, PERIOD_S)
    on_time, late = (
        bench_apart().axis({"it": values}).readings(reference, None)["table_position_m"]
        for values in ({}, {"late_s": 2e-3})
    )
    start_of = [int(np.flatnonzero(values > 1e-9)[0]) for values in (on_time, late)]
    assert start_of[1] - start_of[0] == 2


def test_noise_has_the_colour_and_size_that_are_asked() -> None:
    noise = independent_simulator.coloured(np.random.default_rng(0), 200_000, 0.4)
    assert np.std(noise) == pytest.approx(1.0, abs=0.02)
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(0.4, abs=0.02)


# ---- drawing ----


def test_every_effect_of_the_library_can_be_drawn_within_its_bounds() -> None:
    bench = LibraryBench(nominal(), NO_ERRORS, PERIOD_S)
    for seed, name in enumerate(bench.names(listed=True)):
        drawn = bench.draw(name, np.random.default_rng(seed))
        effect = effects.get(name)(**drawn)
        assert effect != effects.get(name).typical(), name


def test_nominal_values_are_drawn_beyond_their_uncertainty() -> None:
    model, rng = nominal(), np.random.default_rng(0)
    bench = LibraryBench(model, NO_ERRORS, PERIOD_S)
    for _ in range(20):
        extra_kg = bench.draw("inertia_mismatch", rng)["extra_mass_kg"]
        assert extra_kg > 2.5 * model.uncertainty.mass * math.hypot(60.0, model.drive.motor.mass_kg)


@pytest.mark.parametrize("tier", [Tier.A, Tier.D, Tier.L])
def test_a_sheet_says_what_its_owner_knows(tier: Tier) -> None:
    """What an axis may be off by is in doubt by more than that; a tier to learn from says no more than any sheet."""
    drawn = tiers.draw_case(tier, listed_effects(), np.random.default_rng(2))
    stated = read(Nominal, drawn.model, "model").uncertainty
    assert stated.mass > ERRORS["table_mass"]
    assert stated.viscous > ERRORS["table_viscous"]
    assert stated.known_effects > ERRORS["known"]
    assert (stated.stiffness, stated.controller_gains) == ((0.05, 0.02) if tier is Tier.L else (0.02, 0.0))
    latency, sliding = (max(independent_axis.LATENCY), max(independent_axis.SLIDING) - 1.0)
    assert stated.loop_lag == {Tier.A: 0.0, Tier.D: 0.6 * latency, Tier.L: 0.05}[tier]
    assert stated.transition_velocity == {Tier.A: 0.0, Tier.D: pytest.approx(0.6 * sliding), Tier.L: 1.0}[tier]


def test_numbers_of_effects_follow_the_protocol() -> None:
    rng = np.random.default_rng(0)
    counts = np.bincount([tiers.how_many(Tier.B, rng)[0] for _ in range(4000)]) / 4000
    assert counts == pytest.approx([0.15, 0.45, 0.25, 0.15], abs=0.03)
    unlisted = [tiers.how_many(Tier.C, rng) for _ in range(4000)]
    assert set(unlisted) == {(0, 1), (1, 1), (1, 0)}


# ---- seals ----


def test_commitment_is_bound_to_truth_and_salt_and_not_to_layout() -> None:
    salt = seal.salt(NONCE, "000")
    truth = {"listed": [{"name": "a", "parameters": {"x": 0.1, "y": 2.0}}], "case": "000"}
    sealed = seal.commitment(salt, truth)
    shuffled = json.loads(json.dumps({"case": "000", "listed": truth["listed"]}, indent=3))
    assert seal.commitment(salt, shuffled) == sealed
    assert seal.commitment(seal.salt(NONCE, "001"), truth) != sealed
    assert seal.commitment(salt, {**truth, "case": "001"}) != sealed


@pytest.mark.parametrize("nonce", ["", "xyz", "12345678901234567", "ab"])
def test_what_is_no_nonce_is_refused(nonce: str) -> None:
    with pytest.raises(SpecError, match="hexadecimal"):
        check_nonce(nonce)


def test_fresh_nonces_differ() -> None:
    assert new_nonce() != new_nonce()


# ---- the chain ----


def short_cycle(rng: np.random.Generator) -> protocol.Protocol:
    """Return a cycle of two seconds."""
    speed = float(rng.uniform(0.3, 0.5))
    return protocol.Protocol(records={"cycle": moves((0.0, 0.1, 0.0), (speed,), 10.0, PERIOD_S, 0.4)}, holdouts={})


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """Record short cycles in this file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(protocol, "production_cycle", short_cycle)
        yield


@pytest.fixture(scope="module")
def trial(quick: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a trial of thin records in ``trial`` and its key in ``key.json``."""
    folder = tmp_path_factory.mktemp("blind")
    make(folder / "trial", folder / "key.json", Tier.D, 3, NONCE)
    return folder


def test_the_folder_tells_nothing_of_the_key(trial: Path) -> None:
    key = json.loads((trial / "key.json").read_text("utf-8"))
    secrets = [key["nonce"], *(case["salt"] for case in key["cases"].values())]
    secrets += [
        repr(value)
        for case in key["cases"].values()
        for item in case["truth"]["listed"]
        for value in item["parameters"].values()
    ]
    secrets += [repr(own["oracle"]) for case in key["cases"].values() for own in case["truth"]["held_out"].values()]
    written = b"".join(path.read_bytes() for path in (trial / "trial").rglob("*") if path.is_file())
    assert len(secrets) > 4
    assert not [secret for secret in secrets if secret.encode() in written and len(secret) > 6]


def test_the_manifest_has_what_it_promises(trial: Path) -> None:
    manifest = read_manifest(trial / "trial")
    key = json.loads((trial / "key.json").read_text("utf-8"))
    assert manifest["tier"] == "D"
    assert set(manifest) >= {"commit", "code_sha256", "nonce_sha256", "effects", "cases"}
    for name, case in manifest["cases"].items():
        sealed = key["cases"][name]
        assert seal.commitment(sealed["salt"], sealed["truth"]) == case["truth_sha256"]
        assert len(sealed["truth"]["listed"]) <= 3
        assert {Path(file).parts[0] for file in case["files"]} == {"model.toml", "records"}


def test_oracle_leaves_the_noise_of_repeats_and_the_nominal_model_what_is_injected() -> None:
    model = nominal()
    bench = LibraryBench(model, NO_ERRORS, PERIOD_S)
    axis = bench.axis({"quadratic_drag": {"quadratic_drag_N_s2_per_m2": 2500.0}})
    rng = np.random.default_rng(0)
    records = [tiers.record_of("strokes", STROKES, axis.readings(STROKES, rng), SIDES) for _ in range(4)]
    told, untold = (
        held_out_gaps(
            model,
            records,
            [],
            lambda command, own=own: tiers.record_of("", command, own.readings(command, None), SIDES),
        )
        for own in (axis, bench.axis({}))
    )
    assert set(told) == {"motor_force_N", "position_m", "motor_minus_table_position_m"}
    for own in told.values():
        assert own["oracle"] == pytest.approx(own["noise_floor"], rel=0.15)
    assert told["motor_force_N"]["on_paper"] > 2.0 * told["motor_force_N"]["noise_floor"]
    for own in untold.values():
        assert own["oracle"] == pytest.approx(own["on_paper"], rel=0.02)


def test_oracle_has_no_background_effects_and_no_effect_that_is_not_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("LIMITED_DATA", 1.0), ("TAKEN_OUT", 1.0), ("HOW_MANY", (0.0, 1.0, 0.0, 0.0))):
        monkeypatch.setattr(tiers, name, value)
    asked: list[Callable[[np.ndarray], Record]] = []
    monkeypatch.setattr(tiers, "held_out_gaps", lambda *given: asked.append(given[-1]))
    cases = (tiers.draw_case(Tier.L, listed_effects(), np.random.default_rng(seed)) for seed in range(9))
    lacking = next(case for case in cases if case.truth["unlisted"])
    assert lacking.truth["listed"] == []
    model = read(Nominal, {key: part for key, part in lacking.model.items() if key != "exclude"}, "model")
    expected = LibraryBench(model, lacking.truth["errors"], PERIOD_S).axis({}).readings(STROKES, None)
    found = asked[-1](STROKES)
    assert np.array_equal(found["motor_force_N"], expected["motor_force_N"])


def test_closure_of_the_oracle_by_hand() -> None:
    def truth(*gaps: tuple[float, float, float]) -> dict[str, object]:
        names = ("noise_floor", "on_paper", "oracle")
        return {"held_out": {str(place): dict(zip(names, own, strict=True)) for place, own in enumerate(gaps)}}

    # Squares in units of the floor: before 25 and 1, mean 13; after 4 and 1, mean 2.5.
    assert oracle_closure(truth((2.0, 10.0, 4.0), (1e-7, 1e-7, 1e-7))) == pytest.approx(1.0 - 1.5 / 12.0)
    assert oracle_closure(truth((2.0, 2.2, 2.0))) is None
    assert oracle_closure({"listed": [], "unlisted": []}) is None


def test_keys_without_an_oracle_are_scored_without_it(trial: Path, tmp_path: Path) -> None:
    shutil.copytree(trial / "trial", tmp_path / "trial")
    key, manifest = (json.loads(path.read_text("utf-8")) for path in (trial / "key.json", trial / "trial" / MANIFEST))
    for name, case in key["cases"].items():
        del case["truth"]["held_out"]
        manifest["cases"][name]["truth_sha256"] = seal.commitment(case["salt"], case["truth"])
    seal.write_json(tmp_path / "key.json", key)
    seal.write_json(tmp_path / "trial" / MANIFEST, manifest)
    sheets = []
    for folder in (tmp_path, trial):
        answers = tmp_path / f"{len(sheets)}.json"
        answer(folder / "trial", "random", answers)
        sheets.append(score(folder / "trial", answers, folder / "key.json"))
    old, new = sheets
    assert set(new["quantities"]) - set(old["quantities"]) == {"oracle_closure"}
    assert "closure of the oracle" not in board([old])
    assert "closure of the oracle" in board([old, new])


def test_the_same_nonce_gives_the_same_trial(trial: Path, tmp_path: Path) -> None:
    again = make(tmp_path / "again", tmp_path / "key.json", Tier.D, 1, NONCE)
    assert again["cases"]["000"] == read_manifest(trial / "trial")["cases"]["000"]


def test_records_of_a_case_are_repeats_of_one_command(trial: Path) -> None:
    files = sorted((trial / "trial" / "000" / "records").iterdir())
    records = [read_record(file) for file in files]
    assert len(records) == protocol.REPEATS
    assert all(np.array_equal(records[0]["reference_position_m"], other["reference_position_m"]) for other in records)
    assert not np.array_equal(records[0]["motor_force_N"], records[1]["motor_force_N"])
    assert "table_position_m" not in records[0]


def test_key_within_the_folder_and_used_places_are_refused(trial: Path, tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="must not see it"):
        make(tmp_path / "new", tmp_path / "new" / "key.json", Tier.D, 1)
    with pytest.raises(SpecError, match="not empty"):
        make(trial / "trial", tmp_path / "key.json", Tier.D, 1)
    with pytest.raises(SpecError, match="never overwritten"):
        make(tmp_path / "new", trial / "key.json", Tier.D, 1)


def command(*arguments: object) -> tuple[int, str]:
    """Run the command line and return its exit code and output."""
    result = CliRunner().invoke(app, ["trial", *map(str, arguments)])
    return result.exit_code, result.output


@pytest.mark.parametrize("name", ["null", "random", "largest_correlation", "recalibration_only"])
def test_reference_diagnosers_answer_and_are_scored(trial: Path, tmp_path: Path, name: str) -> None:
    output = tmp_path / "answers.json"
    code, text = command("answer", trial / "trial", "--diagnoser", name, "-o", output, "--jobs", 1)
    assert code == 0, text
    assert "0 failed" in text
    assert (tmp_path / "answers.sha256").read_text("utf-8").split()[0] == seal.file_digest(output)
    code, text = command("score", trial / "trial", output, "--key", trial / "key.json", "--json")
    assert code == 0, text
    found = json.loads(text)
    assert found["diagnoser"] == name
    assert found["constant_reference"] == (name == "null")
    for quantity in found["quantities"].values():
        low, high = quantity["ci95"]
        assert low <= high
    assert command("answer", trial / "trial", "--diagnoser", name, "-o", output)[0] == 2


@pytest.fixture
def handed_in(trial: Path, tmp_path: Path) -> Path:
    """Return answers that may be tampered with."""
    output = tmp_path / "answers.json"
    answer(trial / "trial", "random", output)
    return output


@pytest.mark.parametrize("changed", [None, "code_sha256", "diagnoser_sha256", "manifest_sha256"])
def test_interrupted_answers_go_on_where_nothing_changed(trial: Path, handed_in: Path, changed: str | None) -> None:
    content = json.loads(handed_in.read_text("utf-8"))
    first = next(iter(content["cases"]))
    content["cases"] = {first: {**content["cases"][first], "none": 0.125}}
    if changed is not None:
        content[changed] = "0" * 64
    output = handed_in.with_name("again.json")
    kept = output.with_name("again.json.partial")
    kept.write_text(json.dumps(content), "utf-8")
    found = answer(trial / "trial", "random", output)["cases"]
    assert (found[first]["none"] == 0.125) == (changed is None)
    assert len(found) == 3
    assert not kept.exists()


def test_an_effect_that_is_newer_than_a_trial_is_an_unknown_cause() -> None:
    given = CaseAnswer(effects={"cogging": 0.2, "backlash": 0.7}, unknown=0.3, none=0.1)
    assert as_listed(given, ["cogging", "backlash"]) == given
    assert as_listed(given, ["cogging"]) == CaseAnswer(effects={"cogging": 0.2}, unknown=0.7, none=0.1)
    with pytest.raises(SpecError, match=r"coging: not an effect of this trial\. Did you mean cogging\?"):
        as_listed(CaseAnswer(effects={"coging": 0.2}), ["cogging"])


def test_changed_answers_are_refused(trial: Path, handed_in: Path) -> None:
    text = handed_in.read_text("utf-8")
    handed_in.write_text(text.replace('"none": ', '"none":  ', 1), "utf-8")
    with pytest.raises(SpecError, match="changed since it was handed in"):
        score(trial / "trial", handed_in, trial / "key.json")


def test_answers_without_digest_are_refused(trial: Path, handed_in: Path) -> None:
    handed_in.with_suffix(".sha256").unlink()
    with pytest.raises(SpecError, match=r"no answers\.sha256"):
        score(trial / "trial", handed_in, trial / "key.json")


def test_another_truth_than_the_sealed_one_is_refused(trial: Path, handed_in: Path, tmp_path: Path) -> None:
    key = json.loads((trial / "key.json").read_text("utf-8"))
    key["cases"]["001"]["truth"]["listed"] = [{"name": "backlash", "parameters": {"gap_m": 1e-5}, "mean_square": 9.0}]
    (tmp_path / "key.json").write_text(json.dumps(key), "utf-8")
    with pytest.raises(SpecError, match="case 001 is not the one that was sealed"):
        score(trial / "trial", handed_in, tmp_path / "key.json")


def test_another_key_is_refused(trial: Path, handed_in: Path, tmp_path: Path) -> None:
    key = json.loads((trial / "key.json").read_text("utf-8"))
    (tmp_path / "key.json").write_text(json.dumps({**key, "nonce": "ab" * 32}), "utf-8")
    with pytest.raises(SpecError, match="not the key of the trial"):
        score(trial / "trial", handed_in, tmp_path / "key.json")


@pytest.mark.parametrize("constant", [0.0, 0.7])
def test_probabilities_that_do_not_vary_are_refused(trial: Path, handed_in: Path, constant: float) -> None:
    given = json.loads(handed_in.read_text("utf-8"))
    for case in given["cases"].values():
        case["effects"] = dict.fromkeys(case["effects"], constant)
        case["unknown"] = case["none"] = constant
    handed_in.write_text(json.dumps(given), "utf-8")
    seal.write_digest(handed_in)
    code, text = command("score", trial / "trial", handed_in, "--key", trial / "key.json")
    assert code == 2
    assert "do not vary" in text


def test_missing_cases_and_impossible_probabilities_are_refused(trial: Path, handed_in: Path) -> None:
    given = json.loads(handed_in.read_text("utf-8"))
    for change, message in (
        (lambda cases: cases.pop("001"), "case 001"),
        (lambda cases: cases["002"].update(none=1.5), "outside"),
        (lambda cases: cases["002"].pop("unknown"), "probability of unknown is None"),
        (lambda cases: cases["002"]["effects"].update(backlsh=0.5), "Did you mean backlash"),
        (lambda cases: cases.update({"000": []}), "a table is expected"),
    ):
        copy = json.loads(json.dumps(given))
        change(copy["cases"])
        handed_in.write_text(json.dumps(copy), "utf-8")
        seal.write_digest(handed_in)
        with pytest.raises(SpecError, match=message):
            score(trial / "trial", handed_in, trial / "key.json")


def test_changed_records_are_refused(trial: Path, tmp_path: Path) -> None:
    shutil.copytree(trial / "trial", tmp_path / "trial")
    with next((tmp_path / "trial" / "000" / "records").iterdir()).open("ab") as file:
        file.write(b"\0")
    with pytest.raises(SpecError, match="changed since the trial was made"):
        answer(tmp_path / "trial", "null", tmp_path / "answers.json")


FAULTY = '''"""Fails on one case, and says what it was given."""
from fdbench.errors import RecordError
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser
from fdbench.record import Record

class Faulty(Diagnoser):
    calls = 0
    def diagnose(self, nominal, records, holdouts):
        Faulty.calls += 1
        assert type(nominal) is Nominal and all(type(item) is Record for item in (*records, *holdouts))
        assert not {"seed", "scenario"}.intersection(*(item.provenance for item in records))
        if Faulty.calls == 2:
            raise RecordError("the second is too much for me")
        return CaseAnswer(none=0.1 * Faulty.calls)
'''


def test_a_diagnoser_from_a_file_sees_records_and_model_and_may_fail(trial: Path, tmp_path: Path) -> None:
    (tmp_path / "faulty.py").write_text(FAULTY, "utf-8")
    output = tmp_path / "answers.json"
    code, text = command("answer", trial / "trial", "--diagnoser", tmp_path / "faulty.py", "-o", output, "--jobs", 1)
    assert code == 0, text
    assert "1 failed" in text
    cases = json.loads(output.read_text("utf-8"))["cases"]
    assert [case["status"] for case in cases.values()] == ["ok", "failed", "ok"]
    assert cases["001"]["message"] == "the second is too much for me"
    code, text = command("score", trial / "trial", output, "--key", trial / "key.json")
    assert code == 0, text
    assert "1 failed" in text


ALIKE = """
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser

class Alike(Diagnoser):
    def diagnose(self, nominal, records, holdouts):
        return CaseAnswer(none=1.0 / (1.0 + abs(float(records[0]["position_m"][-1]))))
"""


def test_processes_side_by_side_answer_as_one_does(trial: Path, tmp_path: Path) -> None:
    (tmp_path / "alike.py").write_text(ALIKE, "utf-8")
    found = []
    for jobs in (1, 2):
        output = tmp_path / f"answers_{jobs}.json"
        code, text = command(
            "answer", trial / "trial", "--diagnoser", tmp_path / "alike.py", "-o", output, "--jobs", jobs
        )
        assert code == 0, text
        found.append(json.loads(output.read_text("utf-8"))["cases"])
    assert [*found[0]] == [*found[1]]
    assert [case["none"] for case in found[0].values()] == [case["none"] for case in found[1].values()]
    assert len({case["none"] for case in found[0].values()}) == len(found[0])


def test_registered_diagnosers() -> None:
    expected = ["fdbench", "largest_correlation", "null", "random", "recalibration_only", "sparse_regression"]
    assert set(diagnosers.names()) >= {*expected, "untempered_evidence"}
    with pytest.raises(UnknownName, match="Did you mean random"):
        diagnosers.get("randon")


def test_answers_are_probabilities() -> None:
    with pytest.raises(SpecError, match="outside"):
        CaseAnswer(effects={"a": 1.2})


def test_unknown_tier_is_refused(tmp_path: Path) -> None:
    code, text = command("make", tmp_path / "x", "--key", tmp_path / "k", "--tier", "Z")
    assert code == 2
    assert "unknown tier" in text


# ---- reference diagnosers on a case whose cause is plain ----


@pytest.fixture(scope="module")
def plain_case() -> tuple[list[Record], list[Record]]:
    """Return records and hold-outs of a library axis with much quadratic drag and nothing else."""
    axis = LibraryBench(nominal(), NO_ERRORS, PERIOD_S).axis({"quadratic_drag": {"quadratic_drag_N_s2_per_m2": 2500.0}})
    fast = moves((0.0, 0.15, 0.0, 0.1), (0.45, 0.2), 8.0, PERIOD_S)
    other = moves((0.1, 0.0, 0.12), (0.35, 0.1), 6.0, PERIOD_S)
    rng = np.random.default_rng(0)
    return (
        [tiers.record_of("fast", fast, axis.readings(fast, rng), SIDES) for _ in range(3)],
        [tiers.record_of("other", other, axis.readings(other, rng), SIDES)],
    )


@pytest.mark.parametrize("name", ["largest_correlation", "sparse_regression"])
def test_regressions_find_a_plain_cause(plain_case: tuple[list[Record], list[Record]], name: str) -> None:
    given = diagnosers.get(name)().diagnose(nominal(), *plain_case)
    top = max(given.effects, key=lambda effect: given.effects[effect])
    assert given.effects["quadratic_drag"] > 0.5
    assert given.effects["quadratic_drag"] == given.effects[top]
    assert given.none < 0.01


def test_pysindy_is_asked_for_where_it_is_missing(
    plain_case: tuple[list[Record], list[Record]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pysindy.optimizers", None)
    monkeypatch.setitem(sys.modules, "pysindy", None)
    with pytest.raises(PluginError, match="pip install"):
        diagnosers.get("pysindy_regression")().diagnose(nominal(), *plain_case)


def test_pysindy_keeps_what_its_models_keep(
    plain_case: tuple[list[Record], list[Record]], monkeypatch: pytest.MonkeyPatch
) -> None:
    package, optimizers = types.ModuleType("pysindy"), types.ModuleType("pysindy.optimizers")

    class Bagged:
        """Plain least squares on the strongest column, twice."""

        def __init__(self, optimizer: object, bagging: bool, n_models: int) -> None:
            assert bagging
            assert n_models == 20

        def fit(self, design: np.ndarray, target: np.ndarray) -> None:
            match = np.abs(design.T @ target[:, 0])
            found = np.zeros((1, design.shape[1]))
            best = int(np.argmax(match))
            found[0, best] = design[:, best] @ target[:, 0] / (design[:, best] @ design[:, best])
            self.coef_list = [found, found]

    package.optimizers = optimizers
    optimizers.EnsembleOptimizer, optimizers.STLSQ = Bagged, lambda **_: None
    monkeypatch.setitem(sys.modules, "pysindy", package)
    monkeypatch.setitem(sys.modules, "pysindy.optimizers", optimizers)
    given = diagnosers.get("pysindy_regression")().diagnose(nominal(), *plain_case)
    assert [name for name, chance in given.effects.items() if chance > 0.5] == ["quadratic_drag"]
    assert given.unknown < 0.2
    assert given.none < 0.01


def test_recalibration_alone_leaves_the_cause_unknown(plain_case: tuple[list[Record], list[Record]]) -> None:
    given = diagnosers.get("recalibration_only")().diagnose(nominal(), *plain_case)
    assert given.unknown > 0.9
    assert given.effects.get("quadratic_drag", 0.0) == 0.0


# ---- the score sheet ----


def table(
    chances: Sequence[Sequence[float]], present: Sequence[Sequence[float]], **others: Sequence[float]
) -> AnswerTable:
    """Return a table whose other columns are zero unless given."""
    n = len(chances)
    columns = {name: np.zeros(n) for name in ("unknown", "none", "has_unknown")}
    columns |= {name: np.full(n, np.nan) for name in ("closure", "oracle_closure")}
    columns |= {name: np.array(values) for name, values in others.items()}
    return AnswerTable(
        effects=["a", "b", "c", "d"],
        types=["x", "y", "y", "x"],
        chances=np.array(chances),
        present=np.array(present),
        **columns,
    )


SHEET = table(
    [[0.9, 0.1, 0.0, 0.0], [0.3, 0.2, 0.6, 0.0], [0.8, 0.7, 0.0, 0.0], [0.0, 0.0, 0.0, 0.6], [0.0, 0.0, 0.0, 0.0]],
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]],
    unknown=[0.1, 0.2, 0.3, 0.2, 0.9],
    none=[0.0, 0.0, 0.0, 0.4, 0.0],
    has_unknown=[0.0, 0.0, 0.0, 0.0, 1.0],
    closure=[0.9, 0.5, np.nan, np.nan, 0.7],
    oracle_closure=[0.99, 1.01, np.nan, 0.9, 0.98],
)


@pytest.mark.parametrize(
    ("name", "expected", "cases"),
    [
        ("top_1", 1 / 2, 2),
        ("top_3", 1.0, 2),
        ("type_top_1", 1.0, 2),
        ("exact_set", 3 / 5, 5),
        ("micro_f1", 2 * 3 / (5 + 4), 5),
        ("probability_of_truth", (0.9 + 0.2 + 0.75 + 0.4 + 0.9) / 5, 5),
        ("brier", (0.01 + 0.01 + 0.09 + 0.64 + 0.36 + 0.04 + 0.09 + 0.36) / 20, 5),
        ("brier_skill", 1.0 - 1.6 / 20 / (0.2 * 0.8), 5),
        # Bins: 0.1; 0.2 and hit; 0.3; 0.6 twice; 0.7 hit; 0.8 hit; 0.9 hit.
        ("calibration_error", (0.1 + 0.8 + 0.3 + 1.2 + 0.3 + 0.2 + 0.1) / 8, 5),
        ("false_alarms", 1.0, 1),
        ("closure", 0.7, 3),
        ("oracle_closure", 0.985, 4),
        ("auroc_unknown", 1.0, 4),
        ("confidently_wrong", 0.0, 1),
    ],
)
def test_score_sheet_by_hand(name: str, expected: float, cases: int) -> None:
    found = sheet(SHEET)[name]
    assert found["value"] == pytest.approx(expected)
    assert found["cases"] == cases
    assert found["ci95"][0] <= found["value"] <= found["ci95"][1]


def test_quantities_without_cases_are_left_out() -> None:
    found = sheet(table([[0.9, 0.0, 0.0, 0.0]] * 2, [[1.0, 0.0, 0.0, 0.0]] * 2))
    assert {"false_alarms", "auroc_unknown", "closure", "oracle_closure", "confidently_wrong"}.isdisjoint(found)


def test_nobody_wins_by_saying_nothing() -> None:
    silent = sheet(table([[0.0] * 4] * 3, [[1.0, 0.0, 0.0, 0.0]] * 3))
    assert silent["top_1"]["value"] == silent["top_3"]["value"] == 0.0


def test_interval_of_a_share_is_that_of_the_binomial() -> None:
    n, hits = 100, 80
    chances = [[0.9, 0.0, 0.0, 0.0]] * hits + [[0.0, 0.9, 0.0, 0.0]] * (n - hits)
    low, high = sheet(table(chances, [[1.0, 0.0, 0.0, 0.0]] * n))["top_1"]["ci95"]
    expected = 1.96 * math.sqrt(0.8 * 0.2 / n)
    assert high - 0.8 == pytest.approx(expected, rel=0.25)
    assert 0.8 - low == pytest.approx(expected, rel=0.25)
