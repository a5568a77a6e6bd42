"""A rotary axis is diagnosed in its own units, as the arc at a radius of 1 m would be."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fdbench import diagnose
from fdbench.diagnosis.model.as_nominal import as_nominal
from fdbench.diagnosis.model.nominal import load_nominal
from fdbench.diagnosis.model.rotary_axis import plant_of_rotary, plant_on_the_arc
from fdbench.errors import RecordError, SpecError
from fdbench.plants.feed_drive import RotaryMotor
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.scenario import scenario_folder

PERIOD_S = 1e-3
MODEL = """
axis = "rotary"

[plant]
kind = "feed_drive"
travel_rad = 200.0
velocity_limit_rad_per_s = 40.0

[plant.motor]
kind = "torque_motor"
inertia_kg_m2 = 0.02
viscous_friction_Nm_s_per_rad = 0.01

[[plant.effects]]
kind = "coulomb_friction"
coulomb_force_Nm = 0.4
transition_velocity_rad_per_s = 0.05

[simulation]
substeps = 10

[uncertainty]
force_offset_Nm = 0.01
"""


def model(folder: Path, text: str = MODEL) -> Path:
    """Return the file of a model."""
    file = folder / "axis.toml"
    file.write_text(text, encoding="utf-8")
    return file


def turning(seed: int, cogging_Nm: float = 0.15) -> pd.DataFrame:
    """Return a record of turns both ways with cogging of 24 poles: inverse dynamics of a smooth motion, and noise."""
    random, time = np.random.default_rng(seed), np.arange(0.0, 4.0, PERIOD_S)
    slow, fast = 2.0 * math.pi * 0.25, 2.0 * math.pi * 1.5
    position = 6.0 * (1.0 - np.cos(slow * time)) + 0.3 * (1.0 - np.cos(fast * time))
    speed = 6.0 * slow * np.sin(slow * time) + 0.3 * fast * np.sin(fast * time)
    acceleration = 6.0 * slow**2 * np.cos(slow * time) + 0.3 * fast**2 * np.cos(fast * time)
    torque = 0.02 * acceleration + 0.01 * speed + 0.4 * np.tanh(speed / 0.05) + cogging_Nm * np.sin(24.0 * position)
    return pd.DataFrame(
        {
            "time_s": time,
            "position_rad": position + 1e-6 * random.standard_normal(len(time)),
            "motor_torque_Nm": torque + 2e-3 * random.standard_normal(len(time)),
        }
    )


def test_cogging_of_a_torque_motor_is_named_in_its_own_units(tmp_path: Path) -> None:
    found = diagnose(model(tmp_path), [turning(seed) for seed in range(3)])
    cause = found.answer.causes[0]
    assert cause.effect == "cogging"
    assert cause.probability > 0.8
    assert cause.parameters["pitch_m"].value == pytest.approx(2.0 * math.pi / 24.0, rel=0.01)
    assert cause.parameters["pitch_m"].unit == "rad"
    assert cause.parameters["cogging_force_N"].value == pytest.approx(0.15, rel=0.1)
    text = str(found)
    assert "mN m" in text
    assert " rad" in text
    for linear in ("motor_force_N", "position_m", " mN ", " mm"):
        assert linear not in text.replace("mN m", "")
    found.write_model(tmp_path / "repaired.toml")
    written = tomllib.loads((tmp_path / "repaired.toml").read_text())
    assert written["plant"]["motor"]["kind"] == "torque_motor"
    assert {"cogging", "coulomb_friction"} <= {item["kind"] for item in written["plant"]["effects"]}
    again = load_nominal(tmp_path / "repaired.toml").drive
    assert again == load_nominal(tmp_path / "repaired.toml").drive
    assert next(item for item in again.effects if item.name == "cogging").values()[0] == pytest.approx(0.15, rel=0.1)


GRAVITY = """
[[plant.effects]]
kind = "link_gravity"
gravity_force_Nm = 3.0
phase_rad = 0.0
"""


def swinging(seed: int) -> pd.DataFrame:
    """Return a record of a joint whose centre of mass lies 0.06 rad beside the line of its link."""
    random, time = np.random.default_rng(seed), np.arange(0.0, 8.0, PERIOD_S)
    slow, fast = 2.0 * math.pi * 0.25, 2.0 * math.pi * 1.0
    position = 1.2 * (1.0 - np.cos(slow * time)) - 1.0 + 0.1 * (1.0 - np.cos(fast * time))
    speed = 1.2 * slow * np.sin(slow * time) + 0.1 * fast * np.sin(fast * time)
    acceleration = 1.2 * slow**2 * np.cos(slow * time) + 0.1 * fast**2 * np.cos(fast * time)
    torque = 0.02 * acceleration + 0.01 * speed + 0.4 * np.tanh(speed / 0.05) + 3.0 * np.sin(position + 0.06)
    return pd.DataFrame(
        {
            "time_s": time,
            "position_rad": position + 1e-6 * random.standard_normal(len(time)),
            "motor_torque_Nm": torque + 2e-3 * random.standard_normal(len(time)),
        }
    )


def test_gravity_that_is_off_by_an_angle_is_no_cause(tmp_path: Path) -> None:
    text = MODEL.replace("\n[simulation]", f"{GRAVITY}\n[simulation]")
    records = [swinging(seed) for seed in range(3)]
    found = diagnose(model(tmp_path, text), records)
    assert max(found.answer.chances().values(), default=0.0) < 0.5
    phase = next(item for item in as_nominal(found.diagnosis.calibrated).drive.effects if item.name == "link_gravity")
    assert phase.values()[1] == pytest.approx(0.06, abs=0.01)
    exact = text.replace("[uncertainty]", "[uncertainty]\nknown_phase = 0.0")
    assert max(diagnose(model(tmp_path, exact), records).answer.chances().values()) > 0.5


def test_gravity_that_the_model_lacks_is_named(tmp_path: Path) -> None:
    found = diagnose(model(tmp_path), [swinging(seed) for seed in range(3)])
    cause = found.answer.causes[0]
    assert cause.effect == "link_gravity"
    assert cause.probability > 0.5
    assert cause.parameters["gravity_force_N"].value == pytest.approx(3.0, rel=0.05)
    assert cause.parameters["phase_rad"].value == pytest.approx(0.06, abs=0.03)


def test_a_linear_axis_has_no_gravity_over_an_angle(tmp_path: Path) -> None:
    linear = load_nominal(scenario_folder() / "EMPS-v0.toml")
    assert "link_gravity" not in {kind.name for kind in linear.library}
    assert "link_gravity" in {kind.name for kind in load_nominal(model(tmp_path)).library}


def test_the_plant_comes_back_from_its_arc() -> None:
    plant = tomllib.loads(MODEL)["plant"] | {
        "motor": {
            "kind": "geared_motor",
            "gear_ratio": 50.0,
            "inertia_kg_m2": 1e-4,
            "viscous_friction_Nm_s_per_rad": 2.0,
            "torque_constant_Nm_per_A": 0.3,
        },
        "load": {"inertia_kg_m2": 1.5, "viscous_friction_Nm_s_per_rad": 0.2},
        "shaft": {"stiffness_Nm_per_rad": 5e3, "damping_Nm_s_per_rad": 3.0},
    }
    arc = plant_on_the_arc(plant, "axis.toml: model.plant")
    assert arc["table"] == {"mass_kg": 1.5, "viscous_friction_N_s_per_m": 0.2}
    assert arc["screw"] == {"stiffness_N_per_m": 5e3, "damping_N_s_per_m": 3.0}
    assert arc["motor"]["lead_m"] == pytest.approx(2.0 * math.pi / 50.0)
    assert arc["effects"][0] == {
        "kind": "coulomb_friction",
        "coulomb_force_N": 0.4,
        "transition_velocity_m_per_s": 0.05,
    }
    back = plant_of_rotary(arc)
    assert back["motor"].pop("gear_ratio") == pytest.approx(50.0)
    plant["motor"].pop("gear_ratio")
    assert back == plant


def test_torque_is_that_in_front_of_the_gear(tmp_path: Path) -> None:
    text = MODEL.replace('kind = "torque_motor"', 'kind = "geared_motor"\ngear_ratio = 10.0')
    nominal = load_nominal(model(tmp_path, text))
    assert isinstance(nominal.drive.motor, RotaryMotor)
    assert nominal.drive.mass_kg == pytest.approx(2.0)
    (record,) = nominal.on_the_arc([Record({"time_s": [0.0, 1.0, 2.0], "motor_torque_Nm": [1.0, 2.0, 3.0]})])
    assert nominal.drive.motor_force(record).tolist() == pytest.approx([10.0, 20.0, 30.0])


def test_angles_that_start_anew_each_turn_are_unwound(tmp_path: Path) -> None:
    angles = np.linspace(0.0, 20.0, 100)
    record = Record({"time_s": np.arange(100) * 0.01, "position_rad": np.mod(angles, 2.0 * math.pi)})
    (found,) = load_nominal(model(tmp_path)).on_the_arc([record])
    np.testing.assert_allclose(found["position_m"], angles, atol=1e-12)


def test_degrees_and_turns_are_converted(tmp_path: Path) -> None:
    pd.DataFrame({"t": [0.0, 0.1, 0.2], "phi": [0.0, 90.0, 180.0], "n": [60.0, 60.0, 60.0]}).to_csv(
        tmp_path / "log.csv", index=False
    )
    mapping = tmp_path / "log.toml"
    mapping.write_text(
        '[record]\nfile = "log.csv"\n[columns]\ntime_s = { from = "t" }\n'
        'position_rad = { from = "phi", unit = "deg" }\n'
        'reference_velocity_rad_per_s = { from = "n", unit = "rpm" }\n'
    )
    record = read_record(mapping)
    np.testing.assert_allclose(record["position_rad"], [0.0, 0.5 * math.pi, math.pi])
    np.testing.assert_allclose(record["reference_velocity_rad_per_s"], 2.0 * math.pi)


def test_an_angle_in_degrees_is_told_by_the_limits_of_the_model(tmp_path: Path) -> None:
    record = turning(0)
    record["position_rad"] = np.degrees(record["position_rad"])
    with pytest.raises(RecordError, match=r'travel_rad is 200.* is not rad or s; a mapping file .* unit = "deg"'):
        diagnose(model(tmp_path), [record])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("inertia_kg_m2 = 0.02\n", "", r"plant\.motor\.inertia_kg_m2: missing key \[kg m\^2\]"),
        ('"torque_motor"', '"linear_motor"', r"'linear_motor'; a rotary axis has one of torque_motor, geared_motor"),
        ('axis = "rotary"', 'axis = "round"', r"axis: 'round'; allowed: linear, rotary"),
        ('"torque_motor"', '"geared_motor"\ngear_ratio = 0.0', r"gear_ratio: 0\.0; turns of the motor"),
        ("travel_rad = 200.0", "travel_rad = -1.0", r"travel_rad: -1 is outside"),
    ],
)
def test_errors_are_of_the_rotary_axis(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        load_nominal(model(tmp_path, MODEL.replace(old, new)))


def test_columns_of_the_other_kind_of_axis_are_refused(tmp_path: Path) -> None:
    linear = Record({"time_s": [0.0, 1.0, 2.0], "position_m": [0.0, 1.0, 2.0]}, {}, "log.csv")
    rotary = Record({"time_s": [0.0, 1.0, 2.0], "position_rad": [0.0, 1.0, 2.0]}, {}, "log.csv")
    with pytest.raises(RecordError, match=r"log\.csv: column position_m is of a linear axis, .* position_rad"):
        load_nominal(model(tmp_path)).on_the_arc([linear])
    with pytest.raises(RecordError, match=r'log\.csv: column position_rad is of a rotary axis.*axis = "rotary"'):
        load_nominal("BallScrewAxis-v1").on_the_arc([rotary])
