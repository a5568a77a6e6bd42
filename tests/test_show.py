"""`fdbench show`: what it prints and draws of a linear model, and what it refuses."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from fdbench import cli
from fdbench.catalogue import scenario_folder
from fdbench.diagnosis.model.nominal import load_nominal
from fdbench.diagnosis.model.virtual_controller import prepared
from fdbench.errors import RecordError, SpecError
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench.report._measured_response import of_record, read_response
from fdbench.scenario import load_scenario

MODEL = (scenario_folder() / "BallScrewAxis-v0.toml").read_text("utf-8")
MODEL = MODEL[MODEL.index("[plant]") : MODEL.index("[timing]")]


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("model.toml").write_text(MODEL, "utf-8")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(cli.app, ["show", *arguments])


def refused(*arguments: str) -> str:
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stderr.count("\n") == 1
    return result.stderr


def test_published_velocity_loop() -> None:
    """McPherson (2024): beta_1 = 0.8335, beta_2 = 0.1632; the gain may rise by (1 + beta_1 + beta_2) / beta_1."""
    result = run("ShakerConstant-v0", "--json")
    assert result.exit_code == 0, result.output
    answer = json.loads(result.stdout)
    loop = answer["loops"]["velocity"]
    assert loop["stable"]
    assert loop["gain_margin"] == pytest.approx((1.0 + 0.8335 + 0.1632) / 0.8335, rel=1e-3)
    # |L| = 1 where cos theta = (1 + p^2 - b^2) / 2 p.
    p, b = 0.8335 + 0.1632, 0.8335
    theta = math.acos((1.0 + p**2 - b**2) / (2.0 * p))
    assert loop["crossover_Hz"] == pytest.approx(theta * 333.0 / (2.0 * math.pi), rel=1e-3)
    assert answer["closed_loop_modes"][-1]["frequency_Hz"] == pytest.approx(
        -333.0 * math.log(0.1632) / (2.0 * math.pi), rel=1e-2
    )


def test_every_plant_that_is_linear_nominally_is_shown() -> None:
    for name in (
        "DriveCurrentOpen-v0",
        "ServoSpiral-v0",
        "ServoStaircase-v0",
        "SlotMilling-v0",
        "SpindleStep-v0",
        "SensorNetwork-v0",
    ):
        result = run(name, "--output", f"{name}.html")
        assert result.exit_code == 0, result.output
        assert "Modes of the plant" in result.stdout
        assert "Loops" not in result.stdout
        assert "over" in Path(f"{name}.html").read_text("utf-8")
    message = "no linear model is known of a spindle_testbed"
    assert message in run("SpindleTestbedRandom-v0").stdout
    assert (
        json.loads(run("SpindleTestbedRandom-v0", "--json").stdout)["scenario"]["facts"]["plant"] == "spindle_testbed"
    )
    assert message in run("SpindleTestbedRandom-v0", "--output", "page.html").stderr


def test_page_of_a_model_file_with_measured_responses_beside_it() -> None:
    frequencies = np.geomspace(1.0, 100.0, 20)
    rows = [
        f"{f},{20.0 * math.log10(1.0 / math.hypot(1.0, f / 30.0))},{-math.degrees(math.atan(f / 30.0))}"
        for f in frequencies
    ]
    Path("measured.csv").write_text("frequency_Hz,magnitude_dB,phase_deg\n" + "\n".join(rows), "utf-8")
    result = run("model.toml", "measured.csv", "--sampling-time", "1e-3", "--output", "page.html")
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("model: one sample each 1 ms")
    page = Path("page.html").read_text("utf-8")
    for words in ("Nyquist diagram: velocity", "Bode diagram", "measured.csv", "Closed loop: position", "Tracking"):
        assert words in page
    found = read_response(Path("measured.csv"))
    assert found.phase_rad is not None
    np.testing.assert_allclose(found.magnitude, 1.0 / np.hypot(1.0, frequencies / 30.0), rtol=1e-9)
    np.testing.assert_allclose(found.phase_rad, -np.arctan(frequencies / 30.0), rtol=1e-9)


def test_response_of_a_record_is_that_of_the_filter_that_made_it() -> None:
    """A first-order lag x_k = 0.8 x_{k-1} + 0.2 u_{k-1} of a random command."""
    command = np.cumsum(np.random.default_rng(3).standard_normal(40000)) * 1e-5
    position = np.zeros_like(command)
    for k in range(1, len(command)):
        position[k] = 0.8 * position[k - 1] + 0.2 * command[k - 1]
    record = Record({"time_s": np.arange(len(command)) * 1e-3, "reference_position_m": command, "position_m": position})
    found = of_record(record)
    z = np.exp(2j * np.pi * found.frequency_Hz * 1e-3)
    expected = 0.2 / (z - 0.8)
    assert found.phase_rad is not None
    assert len(found.frequency_Hz) > 1000
    np.testing.assert_allclose(found.magnitude * np.exp(1j * found.phase_rad), expected, atol=0.02)
    still = Record(
        {"time_s": np.arange(100) * 1e-3, "reference_position_m": np.zeros(100), "position_m": np.zeros(100)}
    )
    with pytest.raises(RecordError, match="fewer than 2 frequencies"):
        of_record(still)


def test_unstable_loop_is_shown_and_refused() -> None:
    Path("wild.toml").write_text(
        MODEL.replace("velocity_gain_N_s_per_m = 2.0e4", "velocity_gain_N_s_per_m = 2.0e5"), "utf-8"
    )
    result = run("wild.toml", "--sampling-time", "1e-3", "--output", "wild.html")
    assert result.exit_code == 2
    assert "UNSTABLE" in result.stdout
    assert "plant.controller: the loop is unstable at a sampling time of 1 ms: spectral radius" in result.stderr
    assert "gain margin -" in result.stderr
    assert "UNSTABLE" in Path("wild.html").read_text("utf-8")


def test_unstable_model_is_not_diagnosed() -> None:
    table = MODEL.replace("velocity_gain_N_s_per_m = 2.0e4", "velocity_gain_N_s_per_m = 2.0e5")
    Path("wild.toml").write_text(table + "\n[simulation]\nsubsteps = 10\n", "utf-8")
    with pytest.raises(SpecError, match="the loop is unstable at a sampling time of 1 ms"):
        prepared(load_nominal("wild.toml"), [load_scenario("BallScrewAxis-v0").record(0)])


def test_bad_input_is_refused_in_one_line() -> None:
    assert "add --sampling-time" in refused("model.toml")
    assert "which has its own" in refused("BallScrewAxis-v0", "--sampling-time", "1e-3")
    Path("empty.toml").write_text("[simulation]\nsubsteps = 3\n", "utf-8")
    assert "no table [plant]" in refused("empty.toml", "--sampling-time", "1e-3")
    Path("a.csv").write_text("frequency_Hz,magnitude\n1,1\n2,1\n", "utf-8")
    assert "name the page with --output" in refused("BallScrewAxis-v0", "a.csv")
    for text, message in (
        ("frequency_Hz,gain\n1,1\n2,1\n", "unknown column 'gain'"),
        (
            "frequency_Hz,phase_rad\n1,1\n2,1\n",
            "one column magnitude or magnitude_dB or magnitude_m_per_N or magnitude_rad_per_Nm is needed",
        ),
        ("frequency_Hz,magnitude\n1,1\n2,one\n", "a table of numbers"),
        ("frequency_Hz,magnitude\n0,1\n2,1\n", "positive frequency_Hz"),
    ):
        Path("a.csv").write_text(text, "utf-8")
        assert message in run("BallScrewAxis-v0", "a.csv", "--output", "page.html").stderr


def test_model_without_a_controller_is_its_plant_alone() -> None:
    Path("bare.toml").write_text(MODEL[: MODEL.index("[plant.controller]")], "utf-8")
    answer = json.loads(run("bare.toml", "--sampling-time", "1e-3", "--json").stdout)
    assert answer["loops"] == {}
    drive = load_scenario("BallScrewAxis-v0").plant
    assert isinstance(drive, FeedDrive)
    assert len(answer["modes"]) == len(drive.linear_system(1e-3).modes())
