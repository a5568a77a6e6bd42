"""In place of a value: an effect of its type that leaves it as known, and none that does not."""

import pytest
from search_lab import NOMINAL, search

from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.search.in_place_of_a_value import Exchange, in_place_of_a_value
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect, effects

DRAG = effects.get("quadratic_drag").typical(quadratic_drag_N_s2_per_m2=4000.0)
VISCOUS = effects.get("viscous_friction").typical(viscous_friction_N_s_per_m=300.0)


def moved(hypothesis: Hypothesis) -> float:
    shifts = zip(nominal_parameters(NOMINAL), hypothesis.shifts, strict=True)
    return max(abs(shift) for item, shift in shifts if item.cause(NOMINAL) == "viscous_friction")


def exchanged(planted: Effect, rival: Effect) -> Exchange | None:
    own = search(planted, speeds_m_per_s=(0.1, 0.03))
    base = own.refinement.calibrate(start(NOMINAL))
    assert moved(base) > JUDGE.beyond_doubt
    stage = own.compared(base, [(type(rival), base.with_effect(rival), True)])
    return in_place_of_a_value(own, base, stage)


def test_a_drag_takes_the_place_of_a_viscous_friction_that_is_as_known() -> None:
    found = exchanged(DRAG, DRAG)
    assert found is not None
    assert (found.value, found.kind.name) == ("viscous_friction", "quadratic_drag")
    assert found.odds > 0.99
    assert moved(found.hypothesis) < JUDGE.beyond_doubt < moved(found.without)


def test_a_viscous_friction_that_is_wrong_stays_so_beside_a_drag() -> None:
    found = exchanged(VISCOUS, DRAG)
    assert found is None or found.odds < 0.01


@pytest.mark.parametrize("name", ["cogging", "torque_ripple"])
def test_an_effect_of_another_type_is_not_tried(name: str) -> None:
    assert exchanged(DRAG, effects.get(name).typical()) is None
