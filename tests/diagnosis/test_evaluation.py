"""`fdbench evaluate`: exact on records of the model itself, equal to a naive twin, and told of measured data."""

import dataclasses
import json
import math
import sys
from pathlib import Path

import axis_lab
import numpy as np
import pytest
from conftest import shared_file

from fdbench import cli
from fdbench.diagnosis.evaluation.evaluate import BLOCK_S, Evaluated, evaluate
from fdbench.diagnosis.evaluation.result import ALL_RECORDS, PredictionScore
from fdbench.diagnosis.model.nominal import Nominal, Simulation, load_nominal
from fdbench.diagnosis.records.runs import settling_time_s
from fdbench.effects import effects
from fdbench.errors import FdbenchError, RecordError, SpecError
from fdbench.plants.feed_drive import FeedDrive, LinearMotor
from fdbench.reading import read_record
from fdbench.record import Record

EMPS = Path(__file__).resolve().parents[2] / "examples" / "emps"
PERIOD_S = 1e-3


def smooth_command(duration_s: float = 4.0) -> Record:
    t = np.arange(round(duration_s / PERIOD_S)) * PERIOD_S
    position = 0.03 * (1.0 - np.cos(2.0 * np.pi * 0.75 * t)) * np.minimum(1.0, t) ** 3
    return Record(
        {"time_s": t, "reference_position_m": position, "reference_velocity_m_per_s": np.gradient(position, t)}
    )


def simulated(drive: FeedDrive) -> Record:
    command = smooth_command()
    answered = drive.respond(command)
    return Record({**command.columns, **answered.columns}, {}, "own.csv")


def rigid(**changes: object) -> FeedDrive:
    drive = load_nominal(EMPS / "model.toml").drive
    return dataclasses.replace(drive, **changes)  # type: ignore[arg-type]


def model(drive: FeedDrive) -> Nominal:
    return Nominal(plant=drive, simulation=Simulation(substeps=10))


def score(found: Evaluated, way: str, channel: str, record: str | None = None, name: str = "own") -> PredictionScore:
    (item,) = (
        item
        for item in found.evaluation.scores
        if (item.way, item.channel, item.model) == (way, channel, name) and record in (None, item.record)
    )
    return item


@pytest.mark.parametrize("drive", [rigid(effects=()), axis_lab.drive()], ids=["rigid, linear", "elastic, friction"])
def test_a_record_of_the_model_itself_is_predicted_exactly(drive: FeedDrive) -> None:
    found = evaluate({"own": model(drive)}, [simulated(drive)])
    for channel in ("motor_force_N", "position_m"):
        assert score(found, "closed_loop", channel).relative_error < 1e-7
        assert score(found, "closed_loop", channel).fit_percent > 99.9999
    ahead = score(found, "one_step_ahead", "position_m")
    assert ahead.root_mean_square_error < (1e-14 if not drive.effects else 3e-10)
    assert score(found, "inverse_dynamics", "motor_force_N").relative_error < (3e-3 if not drive.effects else 0.05)


def test_scores_equal_a_naive_twin() -> None:
    """A rigid axis with viscous friction alone: difference equations and formulas, written down once more."""
    drive = rigid(effects=())
    record = simulated(drive)
    heavy = rigid(effects=(), motor=LinearMotor(mass_kg=100.0, viscous_friction_N_s_per_m=220.0))
    found = evaluate({"own": model(heavy)}, [record])
    x, force = record["motor_position_m"], record["motor_force_N"]
    m, b, h = 100.0, 220.0, PERIOD_S
    decay = math.exp(-b / m * h)
    travel = (1.0 - decay) * m / b
    expected = np.empty(len(x) - 2)
    for k in range(1, len(x) - 1):
        start = (x[k] - x[k - 1] - force[k - 1] / b * (h - travel)) / travel
        speed = decay * start + (1.0 - decay) / b * force[k - 1]
        expected[k - 1] = x[k] + travel * speed + (h - travel) / b * force[k]
    error = x[2:] - expected
    own = score(found, "one_step_ahead", "position_m")
    assert own.root_mean_square_error == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-5)
    speed = score(found, "one_step_ahead", "velocity_m_per_s")
    assert speed.root_mean_square_error == pytest.approx(np.sqrt(np.mean((error / h) ** 2)), rel=1e-5)
    assert own.relative_error == pytest.approx(np.sqrt(np.mean(error**2)) / np.std(x[2:]), rel=1e-5)
    assert own.fit_percent == pytest.approx(100.0 * (1.0 - own.relative_error))
    needed = m * np.gradient(np.gradient(x, h), h) + b * np.gradient(x, h)
    inside = slice(100, -100)
    twin = np.sqrt(np.mean((needed - 0.5 * (force + np.roll(force, 1)))[inside] ** 2))
    assert score(found, "inverse_dynamics", "motor_force_N").root_mean_square_error == pytest.approx(twin, rel=0.03)


def test_the_better_model_is_marked_and_its_interval_is_that_of_blocks() -> None:
    drive = rigid()
    noise = np.random.default_rng(5)
    clean = simulated(drive)
    noisy = {name: clean[name] + 0.5 * noise.standard_normal(clean.n_samples) for name in ("motor_force_N",)}
    record = Record({**clean.columns, **noisy}, {}, "noisy.csv")
    heavy = rigid(motor=LinearMotor(mass_kg=110.0, viscous_friction_N_s_per_m=203.5034))
    found = evaluate({"heavy": model(heavy), "own": model(drive)}, [record])
    comparison = next(item for item in found.evaluation.comparisons if item.way == "closed_loop")
    assert (comparison.channel, comparison.best, comparison.certain) == ("motor_force_N", "own", True)
    (ratio,) = comparison.ratios
    errors = [
        item.measured["motor_force_N"] - item.predicted["motor_force_N"]
        for name in ("heavy", "own")
        for item in found.predictions["closed_loop", name]
    ]
    assert ratio.value == pytest.approx(np.sqrt(np.mean(errors[0] ** 2) / np.mean(errors[1] ** 2)))
    length = round(BLOCK_S / PERIOD_S)
    blocks = np.add.reduceat(np.square(errors), np.arange(0, len(errors[0]), length), axis=1)
    drawn = np.random.default_rng(1).integers(0, blocks.shape[1], (4000, blocks.shape[1]))
    ratios = np.sqrt(blocks[0][drawn].sum(axis=1) / blocks[1][drawn].sum(axis=1))
    np.testing.assert_allclose(ratio.ci95, np.percentile(ratios, [2.5, 97.5]), rtol=0.05)


def test_what_depends_on_how_the_axis_stood_is_not_compared_in_the_closed_loop() -> None:
    """The one model settles later than the other; both are compared on the samples that are left of that."""
    drive = rigid()
    slower = rigid(controller=dataclasses.replace(drive.controller, position_gain_per_s=20.0))
    found = evaluate({"own": model(drive), "slower": model(slower)}, [simulated(drive)])
    (own,), (other,) = (found.predictions["closed_loop", name] for name in ("own", "slower"))
    (run,) = found.runs
    assert own.first == other.first == run.lead_in_samples(settling_time_s(slower)) > 0
    np.testing.assert_array_equal(own.measured["position_m"], run.channels["position_m"][own.first :])


def test_a_model_and_its_copy_are_not_told_apart() -> None:
    record = simulated(rigid())
    found = evaluate({"a": model(rigid(effects=())), "b": model(rigid(effects=()))}, [record])
    assert all(item.ratios[0].value == 1.0 and not item.certain for item in found.evaluation.comparisons)


def test_all_records_pool_their_samples() -> None:
    nominal, fitted, _ = axis_lab.case((), 3)
    found = evaluate({"own": nominal}, fitted)
    own = [item for item in found.evaluation.scores if (item.way, item.channel) == ("closed_loop", "motor_force_N")]
    *each, total = own
    assert total.record == ALL_RECORDS
    mean_square = sum(item.samples * item.root_mean_square_error**2 for item in each) / total.samples
    assert total.root_mean_square_error == pytest.approx(math.sqrt(mean_square))
    assert all(item.noise_measured for item in own)


def test_the_floor_of_one_step_ahead_is_that_of_second_differences() -> None:
    """With noise of deviation s in the position, the error is that of x[k+1] - 2 x[k] + x[k-1]: s times root 6."""
    drive, noise = rigid(effects=()), np.random.default_rng(2)
    clean = simulated(drive)
    records = []
    for name in ("a.csv", "b.csv"):
        read = clean["motor_position_m"] + 3e-8 * noise.standard_normal(clean.n_samples)
        records.append(Record({**clean.columns, "motor_position_m": read, "position_m": read}, {}, name))
    found = score(evaluate({"own": model(drive)}, records), "one_step_ahead", "position_m", ALL_RECORDS)
    assert found.noise_measured
    assert found.noise_floor == pytest.approx(3e-8 * math.sqrt(6.0), rel=0.03)
    assert found.root_mean_square_error == pytest.approx(found.noise_floor, rel=0.03)


def test_a_record_without_command_is_followed_and_that_is_said() -> None:
    record = simulated(rigid())
    columns = {name: values for name, values in record.items() if not name.startswith("reference_")}
    found = evaluate({"own": model(rigid())}, [Record(columns, {}, "blind.csv")])
    assert "virtual controller" in found.evaluation.warnings[0]
    assert score(found, "closed_loop", "motor_force_N").fit_percent > 95.0


def test_what_a_motion_does_not_tell_is_said() -> None:
    grid = effects.get("encoder_quantisation").typical()
    found = evaluate({"own": model(rigid(effects=(grid,)))}, [simulated(rigid())])
    assert any("without encoder_quantisation" in line for line in found.evaluation.warnings)
    drive = axis_lab.drive()
    one_side = {name: values for name, values in simulated(drive).items() if name != "table_position_m"}
    found = evaluate({"own": model(drive)}, [Record(one_side)])
    assert any("Only one side of the screw" in line for line in found.evaluation.warnings)


def test_bad_input_is_refused_in_words() -> None:
    with pytest.raises(SpecError, match="no models"):
        evaluate({}, [simulated(rigid())])
    with pytest.raises(RecordError, match="no records"):
        evaluate({"own": model(rigid())}, [])
    with pytest.raises(FdbenchError, match="Did you mean ShakerConstant-v2"):
        load_nominal("ShakerConstant-v9")


def test_the_command_writes_text_json_and_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    simulated(rigid()).save(tmp_path / "own.csv")
    other = (EMPS / "model.toml").read_text("utf-8").replace("95.1089", "104.0")
    (tmp_path / "heavy.toml").write_text(other, "utf-8")
    options = ["--model", str(EMPS / "model.toml"), "--model", str(tmp_path / "heavy.toml"), str(tmp_path / "own.csv")]
    outputs = ["--json", str(tmp_path / "found.json"), "--html", str(tmp_path / "found.html")]
    monkeypatch.setattr(sys, "argv", ["fdbench", "evaluate", *options, *outputs])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert not stop.value.code
    printed = capsys.readouterr().out
    assert "motor force: model is best; heavy has" in printed
    assert "model *" in printed
    found = json.loads((tmp_path / "found.json").read_text("utf-8"))
    assert found["models"] == ["model", "heavy"]
    assert {item["way"] for item in found["scores"]} == {"closed_loop", "inverse_dynamics", "one_step_ahead"}
    page = (tmp_path / "found.html").read_text("utf-8")
    assert "One step ahead" in page
    assert "own.csv: motor force" in page


def test_a_scenario_is_a_model_by_its_id() -> None:
    assert load_nominal("ShakerConstant-v1").drive == load_nominal("fdbench/ShakerConstant-v1").drive


def test_the_published_model_of_emps_predicts_2_newtons() -> None:
    folder = shared_file("data", "emps", "DATA_EMPS.mat").parent
    found = evaluate({"own": load_nominal(EMPS / "model.toml")}, [read_record(EMPS / "emps.toml", folder)])
    assert found.evaluation.band_Hz == pytest.approx(40.0)
    assert 1.9 < score(found, "inverse_dynamics", "motor_force_N").root_mean_square_error < 2.1
    assert 2.2 < score(found, "closed_loop", "motor_force_N").root_mean_square_error < 2.5
    assert score(found, "closed_loop", "position_m").root_mean_square_error < 2e-6
