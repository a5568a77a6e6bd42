"""Probability models learned on simulated cases of the user's own machine, motions and noise."""

import dataclasses
import json
import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import open_loop
import pytest
from axis_lab import case, drive
from conftest import REPOSITORY, shared_file
from rotary_servo import SERVO

from fdbench.diagnosis.answer.answer import from_json
from fdbench.diagnosis.answer.cause import VALUE
from fdbench.diagnosis.diagnose import diagnose, judged
from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.probability_models import ProbabilityModel
from fdbench.diagnosis.model.nominal import Nominal, Simulation, load_nominal
from fdbench.effects import effects
from fdbench.errors import SpecError
from fdbench.plants.feed_drive import FeedDrive, Following, LinearMotor
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.report.diagnosis_text import summary
from fdbench.trials import learn, likeness, machine_calibration, recording_setup, virtual_machine
from fdbench.trials.learn import Claim
from fdbench.virtual_axes.library_axis import USUAL

Records = tuple[Nominal, list[Record], list[Record]]


@pytest.fixture(scope="module")
def given() -> Records:
    """Nominal model, two repeats of a short motion, and another motion."""
    nominal, fitted, judged = case((), seed=3)
    return nominal, fitted[2:], judged[1:]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(machine_calibration, "cache_folder", lambda: tmp_path)
    return tmp_path


def with_columns(records: list[Record], changes: dict[str, Any]) -> list[Record]:
    """Return records with columns added, or left out where they are None."""
    found = []
    for item in records:
        columns = dict(item) | {name: change and change(item) for name, change in changes.items()}
        found.append(Record({name: own for name, own in columns.items() if own is not None}, {}, item.source))
    return found


# ---- cases are drawn once ----


def test_a_calibration_goes_on_where_it_stopped_and_is_kept(
    given: Records, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    found: list[Any] = []

    def diagnosed(nominal: Nominal, records: list[Record], holdouts: list[Record]) -> Any:
        if len(asked) == 1:
            asked.append(0)
            raise KeyboardInterrupt
        asked.append(len(records))
        if not found:  # how cases are kept does not depend on what each of them shows
            found.append(judged(nominal, records, holdouts))
        return found[0]

    monkeypatch.setattr(recording_setup, "judged", diagnosed)
    with pytest.raises(KeyboardInterrupt):
        machine_calibration.calibration(*given, 3)
    models = machine_calibration.calibration(*given, 3).models
    assert asked == [2, 0, 2, 2]  # two repeats in each case, and no case twice
    assert models.source == "machine-specific calibration, 3 cases of this machine and its motions"
    assert models.unknown == confidence.models().unknown
    assert models != dataclasses.replace(confidence.models(), source=models.source)
    monkeypatch.setattr(recording_setup.RecordingSetup, "noises", None)  # neither simulated nor diagnosed again
    assert machine_calibration.calibration(*given, 3).models == models
    assert "2 cases" in machine_calibration.calibration(*given, 2).models.source
    assert len(asked) == 4
    assert len(list(cache.iterdir())) == 1


def test_what_is_kept_belongs_to_one_machine_and_its_noise(given: Records) -> None:
    nominal, fitted, judged = given
    heavier = dataclasses.replace(nominal.drive, table=dataclasses.replace(nominal.drive.table, mass_kg=61.0))
    rng = np.random.default_rng(0)

    def louder(item: Record) -> Any:
        return item["motor_torque_Nm"] + 0.01 * rng.standard_normal(item.n_samples)

    others = [
        (dataclasses.replace(nominal, plant=heavier), fitted, judged),
        (dataclasses.replace(nominal, exclude=("cogging",)), fitted, judged),
        (nominal, fitted[:1], judged),
        (nominal, with_columns(fitted, {"motor_torque_Nm": louder}), judged),
    ]
    digests = {recording_setup.recording_setup(*other).digest for other in (given, *others)}
    assert len(digests) == 5
    assert recording_setup.recording_setup(*given).digest in digests


@pytest.mark.parametrize("kind", ["without controller", "rigid with a current"])
def test_other_records_than_those_of_tier_l(given: Records, kind: str) -> None:
    nominal, fitted, judged = given
    gone: dict[str, Any] = {"position_m": None, "table_position_m": None}
    plant: FeedDrive = nominal.drive
    if kind == "without controller":
        gone |= {"reference_position_m": None, "reference_velocity_m_per_s": None}
        plant = dataclasses.replace(plant, controller=Following())
    else:
        motor = LinearMotor(mass_kg=178.0, viscous_friction_N_s_per_m=600.0, force_constant_N_per_A=100.0)
        plant = dataclasses.replace(plant, motor=motor, table=None, screw=None)
        gone |= {"motor_torque_Nm": None, "motor_current_A": lambda item: drive().motor_force(item) / 100.0}
    records = [with_columns(group, gone) for group in (fitted, judged)]
    setup = recording_setup.recording_setup(Nominal(plant=plant, simulation=Simulation(substeps=10)), *records)
    found = machine_calibration._case(setup, setup.noises(), 4)
    assert set(found["features"]) == set(learn.KINDS)
    assert set(found["truth"]) == {"listed", "unlisted"}


# ---- what is refused ----


def test_two_positions_need_a_screw(given: Records) -> None:
    nominal, *records = given
    rigid = dataclasses.replace(nominal, plant=dataclasses.replace(nominal.drive, screw=None))
    with pytest.raises(SpecError, match=r"has motor_position_m and table_position_m, but .* no \[plant.screw\]"):
        machine_calibration.calibration(rigid, *records, 4)


def test_floors_that_no_noise_gives_are_refused(given: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        recording_setup.RecordingSetup, "_made_by", lambda *_: np.array([[0.5, 1.0, 0.0], [0.5, 0.0, 0.01]])
    )
    with pytest.raises(SpecError, match="the measured floor of motor_minus_table_position_m"):
        machine_calibration.calibration(*given, 4)


def test_draws_that_never_work_are_refused(given: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    def diverged(*_: object) -> None:
        raise SpecError("too stiff.")

    monkeypatch.setattr(recording_setup.RecordingSetup, "case", diverged)
    with pytest.raises(SpecError, match=r"case 8: 5 draws, none of them usable; the last: too stiff\."):
        machine_calibration._case(recording_setup.recording_setup(*given), USUAL, 7)


# ---- how far models move ----


def claims_of(kind: str, model: ProbabilityModel, n: int, right: bool) -> list[Claim]:
    """Return claims with the mean features of those that a model was learned from."""
    features = {name: feature.centre for name, feature in model.features.items()}
    return [Claim(kind=kind, features=features, right=right)] * n


@pytest.mark.parametrize("kind", ["effect", "suspect", "value"])
def test_few_claims_change_little_and_many_convince(kind: str) -> None:
    shipped = confidence.models()
    prior: ProbabilityModel = getattr(shipped, kind)
    before = prior.probability(claims_of(kind, prior, 1, True)[0].features)
    surprising = before < 0.5
    one, many = (
        getattr(machine_calibration.adapted(claims_of(kind, prior, n, surprising), shipped, "x"), kind)
        for n in (1, 300)
    )
    own = claims_of(kind, prior, 1, True)[0].features
    assert 0.0 < abs(one.probability(own) - before) < 0.1
    assert (many.probability(own) > 0.5) == surprising
    assert [feature.centre for feature in one.features.values()] == [
        feature.centre for feature in prior.features.values()
    ]


def test_models_that_no_claims_bear_on_stay() -> None:
    shipped = confidence.models()
    found = machine_calibration.adapted(claims_of("unknown", shipped.unknown, 9, True), shipped, "x")
    assert found == dataclasses.replace(shipped, source="x")


# ---- models reach the answer ----


def test_the_answer_is_drawn_from_the_models_that_are_given(given: Records) -> None:
    even = ProbabilityModel(bias=0.0, features={}, claims=98, right=49)
    models = dataclasses.replace(
        confidence.models(), unknown=even, value=even, source="machine-specific calibration, of a test"
    )
    found = diagnose(*given, models=models)
    assert [cause.probability for cause in found.answer.causes if cause.kind == VALUE] == [pytest.approx(0.5)]
    assert found.answer.unknown_probability <= 0.5
    assert found.answer.probabilities_from == "machine-specific calibration, of a test"
    assert "machine-specific calibration, of a test" in " ".join(summary(found.answer).split())
    assert confidence.models().unknown.probability(found.features["unknown"]["unknown"]) != 0.5


def test_the_command_line_passes_models_on(given: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from fdbench.cli import app

    given[1][0].save(tmp_path / "axis.parquet")
    seen: list[object] = []

    def found(*arguments: object) -> SimpleNamespace:
        seen.append(arguments[4])
        return SimpleNamespace(answer=SimpleNamespace(as_json=dict), features={})

    def learned(*arguments: object) -> SimpleNamespace:
        return SimpleNamespace(models=("models", arguments[3], arguments[5]), outcome=lambda features: None)

    monkeypatch.setattr("fdbench.api._diagnosis.find", found)
    monkeypatch.setattr("fdbench.api._diagnosis.replace", lambda item, **changes: item)
    monkeypatch.setattr(machine_calibration, "calibration", learned)
    arguments = ["diagnose", str(tmp_path / "axis.parquet"), "--model", "scenarios/EMPS-v0.toml", "--json", "-"]
    for more in ([], ["--calibrate", "80", "--jobs", "3"], ["--rehearse", "40", "--jobs", "1"]):
        result = CliRunner().invoke(app, [*arguments, *more])
        assert result.exit_code == 0
        assert ("--rehearse is called --calibrate now" in result.stderr) == ("--rehearse" in more)
    assert seen == [None, ("models", 80, 3), ("models", 40, 1)]


# ---- virtual machines are like the measured one ----


def emps() -> Records:
    example = REPOSITORY / "examples" / "emps"
    record = read_record(example / "emps.toml", shared_file("data", "emps", "DATA_EMPS.mat").parent)
    return load_nominal(example / "model.toml"), [record], []


def test_a_record_of_repeated_laps_is_simulated_with_as_many_and_as_much_noise() -> None:
    setup = recording_setup.recording_setup(*emps())
    noises = setup.noises()
    made, _ = setup.recorded(setup.axis(setup.visibility.given, noises), np.random.default_rng(1))
    found = aligned(setup.nominal, made, [])
    assert [run.lap for run in found.runs] == [run.lap for run in setup.ready.runs] == [6240]
    for name, floor in found.split.noise_models.items():
        assert floor.measured
        assert floor.rms == pytest.approx(setup.ready.split.noise_models[name].rms, rel=0.3)
    # The axis is in motion from the first sample on, and no farther from its command than later.
    followed = np.abs(made[0]["position_m"] - made[0]["reference_position_m"])
    assert followed[0] < 1.2 * followed.max()
    assert made[0]["motor_force_N"][0] == pytest.approx(setup.ready.runs[0].whole.channels["motor_force_N"][0], rel=0.3)


def test_repeats_in_open_loop_are_repeats_on_a_virtual_machine() -> None:
    """Each moves it apart from the others; a virtual machine that followed each motion would repeat none."""
    frictions = enumerate((30.0, 33.0, 36.0))
    setup = recording_setup.recording_setup(
        open_loop.NOMINAL, [open_loop.recorded(open_loop.STAIRS, friction, seed) for seed, friction in frictions], ()
    )
    given = setup.visibility.given
    records, _ = setup.recorded(setup.axis(given, recording_setup.SILENT), np.random.default_rng(0))
    assert [item.source for item in records] == ["run 0", "run 1", "run 2"]
    for item in records[1:]:
        np.testing.assert_array_equal(item["position_m"], records[0]["position_m"])


def test_an_axis_that_turns_stays_one_and_runs_up_to_its_speed(tmp_path: Path) -> None:
    """A servo in a steady turn, as short as can be diagnosed, is calibrated with effects of its own size."""
    (tmp_path / "servo.toml").write_text(SERVO)
    nominal, rng = load_nominal(tmp_path / "servo.toml"), np.random.default_rng(2)
    time = np.arange(1500) * 1e-3
    angle = 6.0 * time + 0.2 * np.sin(9.0 * time) + 1e-5 * rng.standard_normal(1500)
    torque = 0.067 - 1.9e-4 * 16.2 * np.sin(9.0 * time) + 1e-3 * rng.standard_normal(1500)
    record = Record({"time_s": time, "position_rad": angle, "motor_torque_Nm": torque}, source="servo")
    setup = recording_setup.recording_setup(nominal, [record], [])
    assert setup.with_run_up(setup.ready.runs[0])[0, 1] == 0.0
    causes = setup.visibility.draw(np.random.default_rng(5))
    (made,), _ = setup.recorded(setup.axis(causes.machine, setup.noises()), rng)
    assert set(made) == {"time_s", "position_rad", "motor_torque_Nm"}
    speed = np.gradient(made["position_rad"], time)[10:20].mean()
    assert speed == pytest.approx(np.gradient(angle, time)[10:20].mean(), rel=0.1)


def test_causes_show_and_are_no_larger_than_the_measured_gap_asks_for(given: Records) -> None:
    visibility = recording_setup.recording_setup(*given).visibility
    most = max(virtual_machine.MOST * visibility.gap, 4.0 * virtual_machine.LEAST)
    for seed in range(6):
        causes = visibility.draw(np.random.default_rng(seed))
        for name, size in causes.mean_squares.items():
            place = visibility.replaced_by(effects.get(name))
            assert size >= virtual_machine.LEAST
            assert size < 2.0 * most or name in visibility.deviations or place is not None


def test_a_process_of_its_own_finds_the_same_case(given: Records) -> None:
    setup = recording_setup.recording_setup(*given)
    noises = setup.noises()
    asked = machine_calibration._CaseAsked(setup=pickle.dumps(given), effect_files=(), noises=noises, number=9)
    beside = machine_calibration._case_beside(asked)
    assert json.dumps(beside) == json.dumps(machine_calibration._case(setup, noises, 9))


# ---- what is said of them ----


def a_case(listed: list[str], unlisted: list[str], named: list[list[str]], left: float) -> dict[str, Any]:
    truth = {"listed": [{"name": name} for name in listed], "unlisted": [{"name": name} for name in unlisted]}
    return {"truth": truth, "named": named, "features": {"unknown": {"unknown": {"misfit": left}}}}


def test_how_often_virtual_machines_were_diagnosed_rightly_is_counted() -> None:
    cases = [
        a_case(["cogging"], [], [["cogging", "torque_ripple"]], 0.1),
        a_case(["cogging", "backlash"], [], [["stribeck_friction"], ["cogging"]], 0.2),
        a_case(["backlash"], ["cogging"], [], 3.0),
        a_case([], [], [], 0.0),
        a_case([], [], [["cogging"]], 0.0),
        a_case([], ["cogging"], [["cogging"]], 4.0),
    ]
    found = likeness.outcome(cases, {"unknown": {"unknown": {"misfit": 0.15}}})
    assert (found.cases, found.with_cause, found.named_rightly) == (6, 3, 1)
    assert (found.without_cause, found.named_falsely, found.compared) == (2, 1, 4)
    assert found.likeness == pytest.approx(2 / 5)


@pytest.mark.parametrize(
    ("n", "left", "words"),
    [(30, 0.5, "exchangeable as far as one can tell"), (30, 2.0, "not exchangeable"), (8, 2.0, "too few to say")],
)
def test_a_machine_unlike_the_virtual_ones_is_told_as_one(given: Records, n: int, left: float, words: str) -> None:
    cases = [a_case(["cogging"], [], [["cogging"]], place / n) for place in range(n)]
    answer = dataclasses.replace(
        diagnose(given[0], given[1][:1]).answer,
        virtual_machines=likeness.outcome(cases, {"unknown": {"unknown": {"misfit": left}}}),
    )
    text = " ".join(summary(answer).split())
    assert f"of {n} with a cause that the library has, the cause named first is there in {n}: 100 %" in text
    assert text.count(words) == (1 if words.startswith("exch") else 2)  # among the doubts, too
    assert from_json(answer.as_json()).virtual_machines == answer.virtual_machines
