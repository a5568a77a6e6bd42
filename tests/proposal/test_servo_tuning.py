"""A result of Automatic Servo Tuning becomes the model that it was written from, with its measured response."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from proposal import servo_tuning_writer as written
from typer.testing import CliRunner, Result

from fdbench import cli
from fdbench.diagnosis.model.nominal import load_nominal
from fdbench.errors import FdbenchError
from fdbench.proposal import of_tuning
from fdbench.reading import format_of
from fdbench.reading.servo_tuning import read_servo_tuning
from fdbench.report._measured_response import read_response


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli.app, list(map(str, arguments)))


def test_base_85_of_the_real_producer(tmp_path: Path) -> None:
    """The first frequencies and values of a file that a SINUMERIK wrote."""
    written.servo_tuning(tmp_path / "a.xml")
    text = (tmp_path / "a.xml").read_text()
    frequencies = "kI]nm*9lJ3kKRyC*9lJ3"
    values = "ZN7RO@z}N~ZOtp@A`u/hkF}hk8H~`wZQsW7ky*C5"
    for name, digits in (("m_ValueVector", values), ("m_FrequencyVector", frequencies)):
        text = re.sub(
            rf'(name="{name}">.*?CDATA\[).*?(\]\]>)',
            lambda f, d=digits: f[1] + d + f[2],
            text,
            count=1,
            flags=re.DOTALL,
        )
    (tmp_path / "a.xml").write_text(text)
    found = read_servo_tuning(tmp_path / "a.xml")
    np.testing.assert_allclose(found.frequency_Hz, [4000 / 8176, 8000 / 8176], rtol=1e-6)
    np.testing.assert_allclose(found.response[0], -0.02307470036807582 - 0.037868662085730496j, rtol=1e-15)


def test_import_writes_the_model_and_the_response(tmp_path: Path) -> None:
    written.servo_tuning(tmp_path / "x.xml")
    result = run("import", tmp_path / "x.xml")
    assert result.exit_code == 0, result.output
    assert "FILL IN travel_m and velocity_limit_m_per_s" in result.output
    assert "CHECK the filter of the current set-point" in result.output
    assert "NumeratorFrequency 200" in result.output  # that of the controller in operation
    gear = 2.0 * math.pi / 0.01
    drive = load_nominal(tmp_path / "model.toml").drive
    assert drive.motor.mass_kg == pytest.approx(written.MOTOR * gear**2, rel=1e-5)
    assert drive.mass_kg == pytest.approx((written.MOTOR + written.LOAD) * gear**2, rel=1e-5)
    assert drive.motor.viscous_friction_N_s_per_m == pytest.approx(written.VISCOUS * gear**2, rel=1e-5)
    assert drive.screw is not None
    assert drive.screw.stiffness_N_per_m == pytest.approx(written.STIFFNESS * gear**2, rel=1e-5)
    text = (tmp_path / "model.toml").read_text()
    assert "# position_gain_per_s = 50 " in text
    assert f"# velocity_gain_N_s_per_m = {2.0 * gear**2:.6g}" in text
    assert f"# integral_gain_N_per_m = {2.0 / 0.01 * gear**2:.6g}" in text


def test_the_measured_response_lies_on_that_of_the_model(tmp_path: Path) -> None:
    written.servo_tuning(tmp_path / "x.xml")
    run("import", tmp_path / "x.xml")
    measured = read_response(tmp_path / "x_response.csv")
    assert measured.is_of_plant
    assert measured.frequency_Hz[0] == 6.0  # what is below 5.5 Hz is not usable
    assert 77.0 not in measured.frequency_Hz  # nor what is not coherent
    undamped = re.sub(r"damping_N_s_per_m = .*", "damping_N_s_per_m = 0.0", (tmp_path / "model.toml").read_text())
    (tmp_path / "undamped.toml").write_text(undamped)  # a ratio of 0.02 is guessed, what was written has none
    system = load_nominal(tmp_path / "undamped.toml").drive.linear_system(1e-3)
    modelled = system.plant_response(measured.frequency_Hz)[0, 0]
    assert measured.phase_rad is not None
    given = measured.magnitude * np.exp(1j * measured.phase_rad)
    np.testing.assert_allclose(given, modelled, rtol=3e-3)  # of 6 digits, beside the resonance
    shown = run(
        "show",
        tmp_path / "model.toml",
        tmp_path / "x_response.csv",
        "--sampling-time",
        "1e-3",
        "-o",
        tmp_path / "p.html",
    )
    assert shown.exit_code == 0, shown.output
    assert "x_response.csv" in (tmp_path / "p.html").read_text()


def test_a_rotary_axis_behind_a_gear(tmp_path: Path) -> None:
    written.servo_tuning(tmp_path / "c.xml", rotary_axis=True)
    assert run("import", tmp_path / "c.xml").exit_code == 0
    nominal = load_nominal(tmp_path / "model.toml")
    assert nominal.axis == "rotary"
    assert nominal.drive.mass_kg == pytest.approx(0.007 * 20.0**2, rel=1e-5)
    assert (tmp_path / "c_response.csv").read_text().startswith("frequency_Hz,magnitude_rad_per_Nm,")
    shown = run("show", tmp_path / "model.toml", "--sampling-time", "1e-3", "--json")
    assert shown.exit_code == 0, shown.output


def test_two_masses_that_do_not_fit_are_a_rigid_axis(tmp_path: Path) -> None:
    written.servo_tuning(tmp_path / "x.xml", zero_Hz=20.0)
    tuned = of_tuning(tmp_path / "x.xml")
    assert any("CHECK the model is rigid: antiresonance 20 Hz" in line for line in tuned.to_do)
    assert "[plant.screw]" not in tuned.model


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("m_dTotalInertia", "m_dTotalInertias", "has no m_dTotalInertia"),
        ("</DynamicModelAxisController>", "", r"The file was cut there"),
        ('m_bMotorIsRotary">true', 'm_bMotorIsRotary">yes', "m_bMotorIsRotary is 'yes', not true or false"),
        ("CDATA[\n", "CDATA[\n%", "'%', no digit of base 85"),
        ("CDATA[\n", "CDATA[\n~~~~~", "no word of base 85"),
        ("CDATA[\n", "CDATA[\n.", "ends within a number|no word of base 85"),
        ("<DynamicModelList", "<!DOCTYPE x><DynamicModelList", "not valid XML|a document type"),
        (f'm_dMotorInertia">{written.MOTOR}', 'm_dMotorInertia">nan', "m_dMotorInertia is nan"),
    ],
)
def test_a_damaged_file_is_refused(old: str, new: str, words: str, tmp_path: Path) -> None:
    written.servo_tuning(tmp_path / "x.xml")
    (tmp_path / "x.xml").write_text((tmp_path / "x.xml").read_text().replace(old, new))
    with pytest.raises(FdbenchError, match=words):
        of_tuning(tmp_path / "x.xml")


def test_as_a_record_it_is_named(tmp_path: Path) -> None:
    written.servo_tuning(tmp_path / "x.xml")
    with pytest.raises(FdbenchError, match=r"Automatic Servo Tuning, which holds no record\. `fdbench import`"):
        format_of(tmp_path / "x.xml")
    (tmp_path / "y.xml").write_text('<?xml version="1.0"?>\n<!-- 4.7 -->\n<ResponseTestCustom ver="4.7">')
    with pytest.raises(FdbenchError, match="measuring function"):
        format_of(tmp_path / "y.xml")
    both = run("import", tmp_path / "x.xml", tmp_path / "y.xml")
    assert both.exit_code == 2
    assert "is imported alone" in both.output
