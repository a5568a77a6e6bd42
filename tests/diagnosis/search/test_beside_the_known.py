"""Beside the known: bristles in place of a friction leave none of it, a hysteresis beside it leaves all."""

import dataclasses

import pytest
from search_lab import NOMINAL, search

from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.known_effects import resized
from fdbench.diagnosis.search.beside_the_known import Remainder, beside_the_known
from fdbench.diagnosis.search.search import Search
from fdbench.effects import Effect, effects

KNOWN = NOMINAL.drive.effects[0]
BRISTLES = effects.get("lugre_friction").in_place_of(KNOWN, {"bristle_stiffness_N_per_m": 1e6})
assert BRISTLES is not None
HALF = BRISTLES.changed(
    **{name: 0.5 * getattr(BRISTLES, name) for name in ("coulomb_force_N", "static_force_N")},
    bristle_stiffness_N_per_m=0.2 * BRISTLES.bristle_stiffness_N_per_m,
)


def recorded(share_of_known: float, planted: Effect) -> Search:
    machine = dataclasses.replace(NOMINAL, plant=resized(NOMINAL.drive, 0, share_of_known))
    return search(planted, speeds_m_per_s=(0.1, 0.01), nominal=machine)


def in_place(own: Search) -> Hypothesis:
    return own.refinement.refine(start(NOMINAL).with_effect(BRISTLES, 0))


def found(share_of_known: float, planted: Effect) -> Remainder | None:
    own = recorded(share_of_known, planted)
    return beside_the_known(own, in_place(own))


def test_bristles_in_place_of_a_friction_leave_none_of_it() -> None:
    remainder = found(0.0, BRISTLES)
    assert remainder is None or remainder.odds < 0.05


def test_a_hysteresis_beside_a_friction_leaves_it() -> None:
    remainder = found(1.0, HALF)
    assert remainder is not None
    assert remainder.kinds == (type(BRISTLES),)
    assert remainder.odds > 0.95


@pytest.mark.parametrize("name", ["stribeck_friction", "quadratic_drag"])
def test_what_replaces_nothing_has_nothing_beside_it(name: str) -> None:
    own = recorded(1.0, effects.get(name).typical())
    base = own.refinement.refine(start(NOMINAL).with_effect(effects.get(name).typical()))
    assert beside_the_known(own, base) is None
