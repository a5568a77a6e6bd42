"""How well values of a model are known: all known effects alike, or single ones by their names."""

import dataclasses
from pathlib import Path

import axis_lab
import pytest

from fdbench.diagnosis.model.as_nominal import as_nominal
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation, Uncertainty, load_nominal
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.repaired import table_of, toml_lines
from fdbench.effects import effects
from fdbench.errors import SpecError

COULOMB, LUGRE, CABLE = (effects.get(name) for name in ("coulomb_friction", "lugre_friction", "cable_stiffness"))


def nominal() -> Nominal:
    """Return an axis whose friction is known worse than its cables."""
    doubt = Uncertainty(known_effects=0.05, effects={"coulomb_friction": 0.25})
    drive = dataclasses.replace(axis_lab.drive(), effects=(COULOMB.typical(), CABLE.typical()))
    return Nominal(plant=drive, simulation=Simulation(substeps=10), uncertainty=doubt)


def test_each_known_effect_is_as_sure_as_is_said_of_it() -> None:
    sizes = {item.name: item.deviation for item in nominal_parameters(nominal()) if item.kind == "known_effects"}
    assert sizes == {"known_coulomb_friction": 0.25, "known_cable_stiffness": 0.05}


def test_what_is_known_in_place_of_an_effect_is_as_sure_as_that() -> None:
    known = nominal().knowing([LUGRE.typical(), CABLE.typical()])
    assert [known.uncertainty.of_effect(item) for item in known.drive.effects] == [0.25, 0.05]


def test_a_model_in_which_it_is_replaced_says_nothing_of_it() -> None:
    replaced = as_nominal(start(nominal()).with_effect(LUGRE.typical(), replaces=0))
    assert not replaced.uncertainty.effects
    assert as_nominal(start(nominal())).uncertainty.effects == {"coulomb_friction": 0.25}


def test_it_is_written_as_it_is_read_and_a_wrong_name_is_told(tmp_path: Path) -> None:
    path, text = tmp_path / "model.toml", "\n".join(toml_lines(table_of(nominal(), Nominal)))
    path.write_text(text)
    assert load_nominal(path) == nominal()
    path.write_text(text.replace("coulomb_friction = 0.25", "colomb_friction = 0.25"))
    with pytest.raises(SpecError, match=r"uncertainty\.effects\.colomb_friction: .* mean coulomb_friction\?"):
        load_nominal(path)
    path.write_text(text.replace("coulomb_friction = 0.25", "coulomb_friction = 0.0"))
    with pytest.raises(SpecError, match=r"effects\.coulomb_friction: 0 is not allowed; it must be above 0"):
        load_nominal(path)
