"""The next experiment: its menu, its forecast, what is proposed and when nothing is; and that the motion is written."""

import dataclasses
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from search_lab import refined_rival
from typer.testing import CliRunner

from fdbench.cli import app
from fdbench.diagnosis.answer.experiment import Experiment
from fdbench.diagnosis.diagnose import write_experiment
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.expected_information import (
    NOTHING,
    OTHER,
    Forecast,
    Forecaster,
    VerdictReader,
)
from fdbench.diagnosis.experiment.menu import Limits, menu, menu_of
from fdbench.diagnosis.experiment.proposal import design, most_open
from fdbench.diagnosis.experiment.trajectory import Trajectory, moves
from fdbench.diagnosis.judge.probability_models import ProbabilityModel, models
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.search.stage import Stage
from fdbench.diagnosis.settings import EXPERIMENT
from fdbench.effects import Effect, effects
from fdbench.reading import read_record
from fdbench.scenario import load_scenario
from fdbench.specification import load_toml, read
from fdbench.virtual_axes import cases as tiers

PERIOD_S = 1e-3
FLOORS = {"motor_force_N": 4.0, "position_m": 5e-7, "motor_minus_table_position_m": 5e-8}
GAP = effects.get("backlash").typical(gap_m=5e-6)
SOFT = effects.get("axial_compliance").typical(stiffness_loss_percent=20.0)
Lab = tuple[Readings, Split]


def nominal() -> Nominal:
    """Return the nominal axis of the trials."""
    return read(Nominal, load_toml(tiers.AXIS), "axis.toml")


@pytest.fixture(scope="module")
def lab() -> Lab:
    """Return a slow run of an axis with a gap, which a soft screw would explain as well."""
    model = nominal()
    replay = Replay(model.drive, model.library, model.simulation.substeps)
    reference = moves((0.0, 0.05, 0.0), (0.02,), 1.0, PERIOD_S)
    still = dict.fromkeys(FLOORS, np.zeros(len(reference)))
    run = RecordedRun(name="slow", period_s=PERIOD_S, reference=reference, channels=still, lap=None)
    simulated = replay.simulate(run, [start(model).with_effect(GAP).variant])
    run = dataclasses.replace(run, channels={name: values[0] for name, values in simulated.items()})
    noise_models = {name: white(rms, measured=True) for name, rms in FLOORS.items()}
    held_out = [np.zeros(len(reference), dtype=np.bool_)]
    return Readings(replay, [run]), Split(runs=[run], held_out=held_out, noise_models=noise_models)


def stage(*rivals: tuple[Effect, float], alone: float = 2.0, size: float = 100.0) -> Stage:
    """Return a stage in which effects of one size compete that leave these misfits."""
    base = start(nominal())
    return Stage(
        base=base,
        misfit=alone,
        penalty=0.0,
        test_count=1000.0,
        rivals=tuple(refined_rival(base, item, misfit, size) for item, misfit in rivals),
    )


READER = VerdictReader()
OPEN = stage((GAP, 1.20), (SOFT, 1.22), (effects.get("cogging").typical(), 3.0))


@pytest.fixture(scope="module")
def chosen(lab: Lab) -> Forecast:
    """Return what is proposed where a gap and a soft screw compete."""
    found = design(*lab, [OPEN], nominal(), READER)
    assert found is not None
    return found


# ---- the menu ----


@pytest.mark.parametrize("visited", [(0.0, 0.1), (-0.2, 0.25), (0.1, 0.101)])
def test_menu_keeps_to_the_limits_and_starts_and_ends_at_rest(visited: tuple[float, float]) -> None:
    drive = nominal().drive
    found = menu(Limits.of(drive, np.array(visited)), PERIOD_S)
    assert len({item.words for item in found}) == len(found) >= 12
    for item in found:
        position, velocity, acceleration = item.reference.T
        assert position.min() >= visited[0] - 1e-9, item.words
        assert position.max() <= max(visited[1], 0.5 * drive.travel_m) + 1e-9, item.words
        assert np.abs(velocity).max() <= drive.velocity_limit_m_per_s, item.words
        assert np.abs(acceleration).max() <= drive.controller.force_limit_N / drive.mass_kg, item.words
        assert abs(velocity[0]) < 1e-4 > abs(velocity[-1]), item.words
        slope = np.diff(position) / PERIOD_S
        largest = PERIOD_S * np.abs(acceleration).max()
        assert np.abs(slope - 0.5 * (velocity[1:] + velocity[:-1])).max() < largest, item.words


@pytest.mark.parametrize("period_s", [0.01, 0.1])
def test_no_motion_has_a_frequency_that_the_samples_do_not_show(period_s: float) -> None:
    found = menu(Limits.of(nominal().drive, np.array([0.0, 0.1])), period_s)
    said = [float(text) for item in found for text in re.findall(r"to ([\d.]+) Hz", item.words)]
    assert said
    assert max(said) == pytest.approx(0.4 / period_s)


def test_no_menu_without_room() -> None:
    drive = dataclasses.replace(nominal().drive, travel_m=0.2)
    run = SimpleNamespace(reference=np.full((10, 3), 0.15), period_s=PERIOD_S)
    model: Any = SimpleNamespace(drive=drive)
    assert menu_of(SimpleNamespace(runs=[run]), model) == []  # type: ignore[arg-type]


# ---- candidates ----


def test_unlikely_rivals_are_left_out() -> None:
    assert [rival.kind.name for rival in READER.shortlisted(OPEN).rivals] == ["backlash", "axial_compliance"]
    assert 0.9 < sum(READER.probabilities(OPEN).values()) <= 1.0


def test_the_stage_in_doubt_is_taken() -> None:
    decided = stage((GAP, 1.0), (SOFT, 3.0), alone=9.0)
    assert most_open([decided], READER) is None
    found = most_open([decided, OPEN], READER)
    assert found is OPEN


def test_effects_that_hardly_compete_beside_a_found_one_are_no_doubt() -> None:
    later = stage((SOFT, 1.18), (effects.get("cogging").typical(), 1.19), alone=1.22)
    assert later.present() < 0.5
    assert most_open([later], READER) is not None
    beside = dataclasses.replace(later, base=later.base.with_effect(GAP))
    assert most_open([beside], READER) is None


def test_effects_that_hardly_compete_beside_what_the_verdict_is_sure_of_are_no_doubt() -> None:
    later = stage((SOFT, 1.18), (effects.get("cogging").typical(), 1.19), alone=1.22)
    assert most_open([later], dataclasses.replace(READER, settled=0.8)) is later
    assert most_open([later], dataclasses.replace(READER, settled=0.95)) is None
    assert most_open([later, OPEN], dataclasses.replace(READER, settled=0.95)) is OPEN


def test_a_stage_that_decides_more_surely_than_such_claims_have_earned_is_open() -> None:
    poor = stage((GAP, 1.25), alone=1.6, size=0.1)
    assert max(poor.probabilities()) > EXPERIMENT.sure > READER.probabilities(poor)["backlash"]
    assert sum(READER.probabilities(poor).values()) < 1.0
    assert most_open([poor], READER) is poor


# ---- the forecast ----


def by_hand(after: list[list[float]], seconds: float = 2.0) -> Forecast:
    reference = np.zeros((round(seconds / PERIOD_S), 3))
    reference[1, 0], reference[2, 1], reference[3, 2] = 0.02, -0.3, 4.0
    trajectory = Trajectory(kind="sine", words="sine: by hand", period_s=PERIOD_S, reference=reference)
    now = np.array([0.6, 0.3, 0.1])
    return Forecast(trajectory=trajectory, names=["a", "b", NOTHING], now=now, before=now, after=np.array(after))


def test_gain_and_log_odds_by_hand() -> None:
    found = by_hand([[0.9, 0.05, 0.05], [0.1, 0.8, 0.1], [0.3, 0.2, 0.5]])
    now, after = 0.36 + 0.09 + 0.01, 0.6 * 0.9 + 0.3 * 0.8 + 0.1 * 0.5
    assert found.gain() == pytest.approx(after - now)
    odds = (2 * (np.log(0.9 / 0.05) - np.log(0.6 / 0.3)) + (np.log(0.8 / 0.1) - np.log(0.3 / 0.6))) / 3
    assert found.log_odds(0, 1) == pytest.approx(odds)
    said = found.experiment()
    assert said.to_separate == ("a", "b")
    assert said.expected_log_odds == pytest.approx(odds)
    assert dataclasses.asdict(said)["expected_probability"] == pytest.approx({"now": now, "after": after})
    assert said.expected_gain_per_s == pytest.approx((after - now) / 2.0)
    assert said.trajectory == "sine: by hand; 2 s"
    assert (said.kind, said.amplitude_m, said.position_m) == ("sine", 0.01, (0.0, 0.02))
    assert (said.velocity_m_per_s, said.acceleration_m_per_s2, said.duration_s) == (0.3, 4.0, 2.0)
    assert said.separates[0].effects == ("a", "b")


def test_pair_that_is_mixed_up_least_afterwards_is_named() -> None:
    found = by_hand([[0.6, 0.39, 0.01], [0.65, 0.34, 0.01], [0.01, 0.01, 0.98]])
    assert found.experiment().to_separate == ("a", NOTHING)


def test_other_effects_are_named_together() -> None:
    reference = np.zeros((2000, 3))
    now = np.array([0.6, 0.2, 0.1, 0.1])
    found = Forecast(
        trajectory=Trajectory(kind="sine", words="sine: by hand", period_s=PERIOD_S, reference=reference),
        names=["a", OTHER, OTHER, NOTHING],
        now=now,
        before=now,
        after=np.array([[0.9, 0.0, 0.0, 0.1], [0.1, 0.8, 0.0, 0.1], [0.2, 0.0, 0.7, 0.1], [0.6, 0.2, 0.1, 0.1]]),
    )
    said = found.experiment()
    pairs = [item.effects for item in said.separates]
    assert said.to_separate == ("a", OTHER)
    assert said.expected_log_odds == pytest.approx(0.5 * (found.log_odds(0, 1) + found.log_odds(0, 2)))
    assert pairs.count(("a", OTHER)) == 1
    assert (OTHER, OTHER) not in pairs


def test_time_of_the_machine_is_paid_for() -> None:
    after = [[0.9, 0.05, 0.05], [0.1, 0.8, 0.1], [0.3, 0.2, 0.5]]
    assert by_hand(after).gain() == by_hand(after, 100.0).gain()
    assert by_hand(after).utility() > by_hand(after, 100.0).utility()


def test_a_motion_that_the_axis_does_not_follow_has_no_forecast(lab: Lab) -> None:
    readings, split = lab
    jump = np.zeros((400, 3))
    jump[100:, 0] = 0.04
    there = Trajectory(kind="jump", words="jump", period_s=PERIOD_S, reference=jump)
    assert Forecaster(readings, split, READER.shortlisted(OPEN), READER).forecasts([there]) == [None]


def test_old_records_again_hardly_help(lab: Lab, chosen: Forecast) -> None:
    readings, split = lab
    again = Trajectory(kind="again", words="again", period_s=PERIOD_S, reference=split.runs[0].reference)
    (repeated,) = Forecaster(readings, split, READER.shortlisted(OPEN), READER).forecasts([again])
    assert repeated is not None
    assert repeated.gain() < 0.5 * chosen.gain()


def test_motions_together_have_the_forecasts_that_they_have_alone(lab: Lab) -> None:
    jump = np.zeros((400, 3))
    jump[100:, 0] = 0.04
    there = Trajectory(kind="jump", words="jump", period_s=PERIOD_S, reference=jump)
    first, second = menu_of(lab[1], nominal())[:2]
    forecaster = Forecaster(*lab, READER.shortlisted(OPEN), READER)
    together = forecaster.forecasts([first, there, second])
    for trajectory, found in zip((first, there, second), together, strict=True):
        (alone,) = forecaster.forecasts([trajectory])
        assert (found is None) == (alone is None) == (trajectory is there)
        if found is not None and alone is not None:
            assert found.trajectory is trajectory
            np.testing.assert_array_equal(found.after, alone.after)


# ---- the proposal ----


def test_proposal_separates_what_competes(chosen: Forecast) -> None:
    found = chosen.experiment()
    json.dumps(dataclasses.asdict(found), allow_nan=False)
    odds = {item.effects: item.expected_log_odds for item in found.separates}
    assert odds["backlash", "axial_compliance"] > 3.0
    assert found.expected_log_odds == odds[found.to_separate[0], found.to_separate[1]]
    expected = found.expected_probability
    assert expected is not None
    assert expected.after > 0.8 > 0.5 > expected.now


def test_nothing_is_proposed_where_nothing_competes(lab: Lab) -> None:
    decided = stage((GAP, 1.0), (SOFT, 3.0), alone=9.0)
    assert design(*lab, [decided], nominal(), READER) is None
    assert design(*lab, [stage()], nominal(), READER) is None
    assert design(*lab, [], nominal(), READER) is None


def test_what_is_in_doubt_depends_on_the_models_that_are_given() -> None:
    sure = ProbabilityModel(bias=5.0, features={}, claims=98, right=98)
    poor = stage((GAP, 1.25), alone=1.6, size=0.1)
    assert most_open([poor], READER) is poor
    assert most_open([poor], VerdictReader(models=dataclasses.replace(models(), effect=sure))) is None


def test_nothing_found_is_no_nothing_where_an_unknown_cause_is_probable() -> None:
    empty = stage((GAP, 1.5), alone=1.0)
    assert READER.probabilities(empty)[NOTHING] > EXPERIMENT.sure
    assert most_open([empty], READER) is None
    doubtful = VerdictReader(unknown=0.8)
    assert doubtful.probabilities(empty)[NOTHING] == pytest.approx(0.2)
    assert most_open([empty], doubtful) is empty


def test_no_motion_separates_equivalent_effects(lab: Lab) -> None:
    same = Forecaster(*lab, stage((GAP, 1.20), (GAP, 1.21), alone=9.0), READER)
    some = menu_of(lab[1], nominal())[::4]
    for trajectory, found in zip(some, same.forecasts(some), strict=True):
        assert found is not None
        assert abs(found.log_odds(0, 1)) < 0.5, trajectory.words


def test_other_effects_count_as_large_as_they_may_be_hidden(lab: Lab) -> None:
    found = Forecaster(*lab, OPEN, READER)
    kinds = [rival.kind.name for rival in found.stage.rivals]
    assert kinds[:2] == found.names[:2] == ["backlash", "axial_compliance"]
    assert len(set(kinds)) == len(kinds) > 15
    assert set(found.names[2:-1]) == {OTHER}
    assert found.now.sum() == pytest.approx(1.0)
    assert found.now[2:-1].sum() >= EXPERIMENT.overlooked / (1.0 + EXPERIMENT.overlooked)
    # A force of one period stands out of a slow run; a saturation needs more force than one has.
    sizes = dict(zip(kinds, found.sizes, strict=True))
    assert sizes["cogging"] < 0.5
    assert sizes["force_saturation"] > sizes["cogging"]
    assert sizes["backlash"] == 1.0


@dataclasses.dataclass(frozen=True)
class Said:
    """An answer that says nothing else."""

    next_experiment: Experiment | None
    axis: str = "linear"

    def as_json(self) -> dict[str, Any]:
        return dataclasses.asdict(self)


@dataclasses.dataclass(frozen=True)
class Found:
    """A diagnosis, as far as its experiment goes."""

    answer: Said
    forecast: Forecast | None


def diagnosis(forecast: Forecast | None) -> Any:
    return Found(Said(None if forecast is None else forecast.experiment()), forecast)


def test_proposed_motion_is_written_and_named(chosen: Forecast, tmp_path: Path) -> None:
    before, path = diagnosis(chosen), str(tmp_path / "next.csv")
    found = write_experiment(before, path)
    assert found.answer.next_experiment == dataclasses.replace(chosen.experiment(), trajectory=path, file=path)
    assert before.answer.next_experiment == chosen.experiment()
    written = read_record(path)
    assert list(written) == [
        *("time_s", "reference_position_m", "reference_velocity_m_per_s", "reference_acceleration_m_per_s2")
    ]
    columns = np.column_stack([written[name] for name in list(written)[1:]])
    np.testing.assert_array_equal(columns, chosen.trajectory.reference)
    assert written.sampling_time_s == pytest.approx(PERIOD_S)


def test_nothing_is_written_where_nothing_is_proposed(tmp_path: Path) -> None:
    before = diagnosis(None)
    assert write_experiment(before, tmp_path / "next.csv") is before
    assert not (tmp_path / "next.csv").exists()


# ---- the command ----


def test_command_writes_the_motion(chosen: Forecast, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    load_scenario("BallScrewAxis-v0").record(0).save("axis.csv")
    command = ["diagnose", "axis.csv", "--model", str(tiers.AXIS), "--json", "-", "--next-experiment"]
    monkeypatch.setattr("fdbench.api._diagnosis.find", lambda *_: diagnosis(chosen))
    result = CliRunner().invoke(app, [*command, "next.csv"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["next_experiment"]["trajectory"] == "next.csv"
    assert read_record("next.csv")["reference_position_m"].shape == chosen.trajectory.reference[:, 0].shape
    monkeypatch.setattr("fdbench.api._diagnosis.find", lambda *_: diagnosis(None))
    result = CliRunner().invoke(app, [*command, "none.csv"])
    assert result.exit_code == 0, result.output
    assert "no none.csv" in result.stderr
    assert not Path("none.csv").exists()
    result = CliRunner().invoke(app, [*command, "next.txt"])
    assert result.exit_code != 0
    assert "written as .csv" in str(result.exception or "") + result.output
