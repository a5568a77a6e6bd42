"""A refinement comes to values that are far from those on paper."""

import dataclasses

import pytest
from axis_lab import case, drive, other_friction

from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.model.known_effects import amplitude_of
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.effects import effects


@pytest.mark.parametrize("factor", [0.3, 0.2])
def test_a_friction_far_from_paper_is_fitted_from_there(factor: float) -> None:
    """What is measured is 39 and 67 deviations off, from where a quadratic in place of a Student's t lets no fit go."""
    nominal, fitted, judged = case((), seed=1)
    wrong = dataclasses.replace(nominal, plant=other_friction(drive(), factor))
    right, found = (Calibrated.of(aligned(model, fitted, judged)) for model in (nominal, wrong))
    assert found.misfit < 1.1 * right.misfit
    names = [item.name for item in nominal_parameters(found.hypothesis.nominal)]
    shift = found.hypothesis.shifts[names.index("known_coulomb_friction")]
    assert 0.06 * shift == pytest.approx(1.0 / factor - 1.0, rel=0.05)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_known_play_that_has_grown_many_times_is_fitted_from_there(seed: int) -> None:
    """No step leads that far: beside the zero that motor and table have in common, a wider play says little."""
    play = effects.get("backlash")
    nominal, fitted, judged = case((play.typical(gap_m=3e-5),), seed=seed)
    known = (*nominal.drive.effects, play.typical(gap_m=2e-6))
    grown = dataclasses.replace(nominal, plant=dataclasses.replace(nominal.drive, effects=known))
    found = Calibrated.of(aligned(grown, fitted, judged)).hypothesis
    assert amplitude_of(found.variant.plant.effects[-1]) == pytest.approx(3e-5, rel=0.05)
