"""Probability models learned on simulated cases of the user's own machine, motions and noise."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from axis_lab import case, drive

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.probability_models import ProbabilityModel
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.errors import SpecError
from fdbench.plants.feed_drive import FeedDrive, Following, LinearMotor
from fdbench.record import Record
from fdbench.report.diagnosis_text import summary
from fdbench.trials import learn, machine_calibration
from fdbench.trials.learn import Claim

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

    def diagnosed(nominal: Nominal, records: list[Record], holdouts: list[Record]) -> Any:
        if len(asked) == 1:
            asked.append(0)
            raise KeyboardInterrupt
        asked.append(len(records))
        return diagnose(nominal, records, holdouts)

    monkeypatch.setattr(machine_calibration, "diagnose", diagnosed)
    with pytest.raises(KeyboardInterrupt):
        machine_calibration.calibrated_models(*given, 3)
    models = machine_calibration.calibrated_models(*given, 3)
    assert asked == [2, 0, 2, 2]  # two repeats in each case, and no case twice
    assert models.source == "machine-specific calibration, 3 cases of this machine and its motions"
    assert (models.none, models.unknown) == (confidence.models().none, confidence.models().unknown)
    assert models != dataclasses.replace(confidence.models(), source=models.source)
    monkeypatch.setattr(machine_calibration.RecordingSetup, "noises", None)  # neither simulated nor diagnosed again
    assert machine_calibration.calibrated_models(*given, 3) == models
    assert "2 cases" in machine_calibration.calibrated_models(*given, 2).source
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
        (nominal, [*fitted, fitted[0]], judged),
        (nominal, with_columns(fitted, {"motor_torque_Nm": louder}), judged),
    ]
    digests = {machine_calibration.recording_setup(*other).digest for other in (given, *others)}
    assert len(digests) == 5
    assert machine_calibration.recording_setup(*given).digest in digests


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
    setup = machine_calibration.recording_setup(Nominal(plant=plant, simulation=Simulation(substeps=10)), *records)
    found = machine_calibration._case(setup, setup.noises(), 0)
    assert set(found["features"]) == set(learn.KINDS)
    assert set(found["truth"]) == {"listed", "unlisted"}


# ---- what is refused ----


def test_two_positions_need_a_screw(given: Records) -> None:
    nominal, *records = given
    rigid = dataclasses.replace(nominal, plant=dataclasses.replace(nominal.drive, screw=None))
    with pytest.raises(SpecError, match=r"has motor_position_m and table_position_m, but .* no \[plant.screw\]"):
        machine_calibration.calibrated_models(rigid, *records, 4)


def test_floors_that_no_noise_gives_are_refused(given: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        machine_calibration.RecordingSetup, "_made_by", lambda *_: np.array([[0.5, 1.0, 0.0], [0.5, 0.0, 0.01]])
    )
    with pytest.raises(SpecError, match="the measured floor of motor_minus_table_position_m"):
        machine_calibration.calibrated_models(*given, 4)


def test_draws_that_never_work_are_refused(given: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    def diverged(*_: object) -> None:
        raise SpecError("too stiff.")

    monkeypatch.setattr(machine_calibration.RecordingSetup, "case", diverged)
    with pytest.raises(SpecError, match=r"case 8: 5 draws, none of them usable; the last: too stiff\."):
        machine_calibration._case(machine_calibration.recording_setup(*given), machine_calibration.USUAL, 7)


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
    assert found.answer.unknown_probability == 0.5
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
        return SimpleNamespace(answer=SimpleNamespace(as_json=dict))

    monkeypatch.setattr("fdbench.api._diagnosis.find", found)
    monkeypatch.setattr(machine_calibration, "calibrated_models", lambda *arguments: ("models", arguments[3]))
    arguments = ["diagnose", str(tmp_path / "axis.parquet"), "--model", "scenarios/EMPS-v0.toml", "--json", "-"]
    for more in ([], ["--calibrate", "80"], ["--rehearse", "40"]):
        result = CliRunner().invoke(app, [*arguments, *more])
        assert result.exit_code == 0
        assert ("--rehearse is called --calibrate now" in result.stderr) == ("--rehearse" in more)
    assert seen == [None, ("models", 80), ("models", 40)]
