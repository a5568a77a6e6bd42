"""`fdbench show` of names: whatever is listed is shown, with what its code declares."""

import json

import pytest
from typer.testing import CliRunner, Result

from fdbench.cli import app
from fdbench.commands._sheets import plugin_sheets, print_sheet, registries, scenario_sheet
from fdbench.commands.list import Listed, _rows
from fdbench.scenario import load_scenario
from fdbench.units import UNITS


def show(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["show", *arguments])


@pytest.mark.parametrize("kind", [kind for kind in Listed if kind is not Listed.SCENARIOS])
def test_every_listed_name_has_a_sheet(kind: Listed) -> None:
    for row in _rows(kind):
        sheets = [
            sheet for sheet in plugin_sheets(row["name"]) if f"{sheet.kind}s" == kind.value or row["name"] == "oracle"
        ]
        assert len(sheets) == 1, row
        assert sheets[0].summary
        assert sheets[0].file.endswith(f"{row['name']}.py")
        assert all(own["unit"] in ("", *UNITS.values()) for own in sheets[0].arguments)


def test_scenarios_of_every_plant_have_sheets() -> None:
    for name in (
        "BallScrewAxis-v1",
        "EMPS-v1",
        "SensorNetwork-v1",
        "ServoSpiral-v1",
        "SlotMilling-v2",
        "SpindleStep-v1",
    ):
        facts = scenario_sheet(load_scenario(name), name).facts
        assert {"source", "plant", "drawn", "tracks", "versions", "model to identify"} <= set(facts)


def test_kinds_that_are_listed_are_those_that_are_shown() -> None:
    assert {f"{registry.kind}s" for registry in registries()} | {"scenarios"} == set(Listed)


def test_an_estimator_says_what_its_constructor_declares() -> None:
    (sheet,) = plugin_sheets("krls_t")
    budget = next(row for row in sheet.arguments if row["argument"] == "budget")
    assert budget["default"] == "50"
    length = next(row for row in sheet.arguments if row["argument"] == "sigma_1_s")
    assert (length["unit"], length["default"]) == ("s", "1.2")
    assert sheet.facts["made for"]


def test_an_effect_says_bounds_and_typical_size() -> None:
    (sheet,) = json.loads(show("cable_stiffness", "--json").stdout)
    row = next(row for row in sheet["arguments"] if row["argument"] == "dahl_force_N")
    assert (row["symbol"], row["unit"], row["typical"], row["bounds"]) == ("F_d", "N", "8", "0 to 500")
    assert "\\dot z" in sheet["text"]
    assert sheet["facts"]["port"] == "TABLE_FORCE"


def test_a_scenario_says_what_is_drawn_and_what_was_wrong() -> None:
    facts = scenario_sheet(load_scenario("ShakerConstant-v1"), "ShakerConstant-v1").facts
    assert "plant.motor.mass_kg (normal, relative deviation 0.05)" in facts["drawn"]
    assert facts["versions"] == "ShakerConstant-v0, ShakerConstant-v1, ShakerConstant-v2"
    assert "the position is read without noise" in facts["erratum of 0.2.0"]
    assert "erratum of 0.2.0" not in scenario_sheet(load_scenario("ShakerConstant-v2"), "").facts


def test_a_name_of_two_kinds_is_shown_as_both(capsys: pytest.CaptureFixture[str]) -> None:
    result = show("null")
    assert "null: estimator. " in result.stdout
    assert "null: diagnoser. " in result.stdout
    for sheet in plugin_sheets("pl_lssvm"):
        print_sheet(sheet)
    printed = capsys.readouterr().out
    assert "hyperparameters" in printed
    assert "pl_lssvm.py" in printed


def test_what_cannot_be_shown_is_told() -> None:
    for arguments, message in (
        (("krls",), "unknown name 'krls'. Did you mean krls_t?"),
        (("krls_t", "--output", "a.html"), "krls_t: a estimator, of which there is nothing to draw"),
    ):
        result = show(*arguments)
        assert result.exit_code == 2
        assert message in result.stderr.replace("an estimator", "a estimator")
