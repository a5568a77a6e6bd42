"""The diagnosis names the injected effect, says nothing where there is none, and never reads what is withheld."""

import dataclasses
import functools
import json
from pathlib import Path

import pytest
from axis_lab import case, drive

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import Nominal, Simulation, load_nominal
from fdbench.effects import effects
from fdbench.record import Record
from fdbench.scenario import load_scenario, scenario_folder

ENCODERS = ("motor_position_m", "table_position_m")


@functools.cache
def answer_to(name: str) -> Answer:
    """Return what is said of an axis with this effect at its typical size."""
    return diagnose(*case((effects.get(name).typical(),), seed=1)).answer


@pytest.mark.parametrize(
    "name",
    [
        "backlash",
        "cogging",
        "current_loop_lag",
        "lead_error",
        "quadratic_drag",
        "shaker_force",
    ],
)
def test_a_hidden_effect_is_named_first(name: str) -> None:
    answer = answer_to(name)
    assert answer.causes, answer
    first = answer.causes[0]
    assert name == first.effect or name in first.indistinguishable_from
    assert first.probability > 0.5
    assert answer.no_gap_probability < 0.5
    assert answer.shrinkage.total > 0.5


@pytest.mark.parametrize(
    ("name", "teeth", "spindle_frequency_Hz", "angle_rad"),
    [
        ("tooth_passing_force", 3.0, 21.3, -0.5),
        ("runout_force", 2.0, 50.0, 2.0),
    ],
)
def test_an_axis_that_cuts_is_told_by_its_spindle(
    name: str, teeth: float, spindle_frequency_Hz: float, angle_rad: float
) -> None:
    kind = effects.get(name)
    cut = kind.typical(teeth=teeth, spindle_frequency_Hz=spindle_frequency_Hz, angle_rad=angle_rad)
    first = diagnose(*case((cut,), seed=1)).answer.causes[0]
    assert first.effect == name
    assert first.probability > 0.9
    found = {item: value.value for item, value in first.parameters.items()}
    assert found["teeth"] == teeth
    assert found["spindle_frequency_Hz"] == pytest.approx(spindle_frequency_Hz, rel=1e-3)
    assert found[kind.amplitude] == pytest.approx(getattr(cut, kind.amplitude), rel=0.05)


def test_the_same_signal_has_all_its_names() -> None:
    first = answer_to("shaker_force").causes[0]
    assert {"periodic_force", "shaker_force"} <= {first.effect, *first.indistinguishable_from}
    assert {"periodic_force", "shaker_force"} <= set(first.one_of)
    without = Nominal(plant=drive(), simulation=Simulation(substeps=10), exclude=("periodic_force",))
    assert "shaker_force" in {kind.name for kind in without.library}


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_named_where_nothing_is_hidden(seed: int) -> None:
    answer = diagnose(*case((), seed)).answer
    assert answer.no_gap_probability + answer.unknown_probability > 0.9
    assert not [cause for cause in answer.causes if cause.probability > 0.5]


def test_a_cause_that_the_library_lacks_is_not_given_the_name_of_a_small_part() -> None:
    nominal, fitted, judged = case((), seed=4)
    drive = nominal.drive
    other = 1.0 - drive.controller.velocity_feedforward
    as_nominal = dataclasses.replace(
        drive, controller=dataclasses.replace(drive.controller, velocity_feedforward=other)
    )
    answer = diagnose(dataclasses.replace(nominal, plant=as_nominal), fitted, judged).answer
    assert answer.unknown_probability > 0.9
    assert not [cause for cause in answer.causes if cause.probability > 0.5]


def test_a_log_of_the_scale_and_the_force_alone_is_diagnosed() -> None:
    nominal, fitted, judged = case((effects.get("cogging").typical(),), seed=5)
    drive = nominal.drive
    on_scale = dataclasses.replace(drive, controller=dataclasses.replace(drive.controller, feedback="table"))
    thin = [
        [Record({name: item[name] for name in item if name not in ENCODERS}, {}, item.source) for item in group]
        for group in (fitted[:2], judged[:1])
    ]
    answer = diagnose(dataclasses.replace(nominal, plant=on_scale), *thin).answer
    assert set(answer.gap.channels) == {"motor_force_N", "position_m"}
    json.dumps(answer.as_json(), allow_nan=False)


def test_shares_add_up_to_one() -> None:
    where = answer_to("cogging").where
    for part in (where.motion.values(), where.channel.values()):
        assert sum(part) == pytest.approx(1.0)
    for name in ("frequency", "position", "velocity", "time"):
        assert sum(cell.share for cell in getattr(where, name)) == pytest.approx(1.0)


def test_hidden_truth_of_a_scenario_file_is_not_read(tmp_path: Path) -> None:
    text = (scenario_folder() / "BallScrewAxis-v0.toml").read_text()
    other = tmp_path / "Other-v0.toml"
    other.write_text(text.replace("axial_depth_m = 1e-3", "axial_depth_m = 9e-3").replace("1e-8", "1e-5"))
    assert load_nominal(other) == load_nominal(scenario_folder() / "BallScrewAxis-v0.toml")


def test_what_a_milling_scenario_withholds_is_found() -> None:
    scenario = load_scenario("MillingUpDown-v0")
    records = [scenario.observe(seed)[0] for seed in (1, 2, 3)]
    nominal = load_nominal(scenario_folder() / "MillingUpDown-v0.toml")
    causes = {item.effect: item for item in diagnose(nominal, records).answer.causes}
    assert {"tooth_passing_force", "runout_force"} <= {name for name, item in causes.items() if item.probability > 0.9}
    depth = causes["tooth_passing_force"].parameters["axial_depth_m"].value
    runout = causes["runout_force"].parameters["radial_runout_m"].value
    assert depth == pytest.approx(1.5e-3, rel=0.06)
    assert runout == pytest.approx(1e-5, rel=0.15)
