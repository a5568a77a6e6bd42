"""A screen ranks classes of effects by linear fits, with responses of the size of the gap, read by one substep."""

import dataclasses

import numpy as np
import pytest
from search_lab import NOMINAL, search

from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.candidates import Candidate
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.search.screen import Screen
from fdbench.effects import Effect, effects

COGGING, STRIBECK = effects.get("cogging"), effects.get("stribeck_friction")
PITCHES_M = (0.0005, 0.0011, 0.005, 0.0071, 0.013)


def screen_of(*extra: Effect) -> Screen:
    """Return a screen in which both runs are fitted."""
    own = search(*extra)
    split = Split(
        runs=own.split.runs,
        held_out=[np.zeros(run.n_samples, dtype=np.bool_) for run in own.split.runs],
        noise_models=own.split.noise_models,
    )
    own.refinement.look_at(own.readings, split)
    return Screen(own.refinement, start(NOMINAL))


def waves(scale: float = 1.0) -> list[Candidate]:
    quarter = np.pi / 2.0
    return [
        Candidate(
            members=tuple(COGGING.typical(pitch_m=pitch_m, phase_rad=own).scaled(scale) for own in (0.0, quarter))
        )
        for pitch_m in PITCHES_M
    ]


def shapes() -> list[Candidate]:
    grid = next(item.grid for item in STRIBECK.parameters() if item.grid)
    name = next(item.name for item in STRIBECK.parameters() if item.grid)
    return [Candidate(members=(STRIBECK.typical(**{name: value}),)) for value in grid]


def test_the_right_wave_fits_best_and_its_class_comes_first() -> None:
    own = screen_of(COGGING.typical(pitch_m=0.005))
    found = own.fitted([*shapes(), *waves()], own.fits((), own.split.fitted).gap)
    assert [item.kind for item in found.every] == [STRIBECK] * len(shapes()) + [COGGING] * len(PITCHES_M)
    assert own.takes_any(found)
    assert own.best_of_class(found)[COGGING][0].members[0].pitch_m == 0.005
    sized, alone = own.sized(found)
    assert next(iter(sized)) is COGGING
    assert own.worthwhile(sized, alone) == {COGGING}


def test_only_the_best_classes_go_on_where_few_are_asked_for() -> None:
    own = screen_of(COGGING.typical(pitch_m=0.005))
    found = own.fitted([*shapes(), *waves()], own.fits((), own.split.fitted).gap, n_classes=1)
    assert {item.kind for item in found.every} == {COGGING}


@pytest.mark.parametrize("scale", [1.0, 40.0])
def test_what_is_tried_far_too_large_is_made_smaller_before_it_is_judged(scale: float) -> None:
    own = screen_of(COGGING.typical(pitch_m=0.005))
    found = own.fitted(waves(scale), own.fits((), own.split.fitted).gap)
    best, fit = own.best_of_class(found)[COGGING]
    assert best.members[0].pitch_m == 0.005
    assert best.members[0].values()[0] == pytest.approx(COGGING.typical().values()[0], rel=0.1)
    assert fit.train < 1.5


def test_a_response_by_one_substep_ranks_as_one_by_all(monkeypatch: pytest.MonkeyPatch) -> None:
    own = screen_of(COGGING.typical(pitch_m=0.005))
    roughly = own.fits([*waves(), *shapes()], own.split.fitted)
    monkeypatch.setattr(type(own.refinement.readings), "roughly", lambda readings, hypothesis: readings)
    closely = own.fits([*waves(), *shapes()], own.split.fitted)
    assert dataclasses.astuple(roughly.alone)[1:] == pytest.approx(dataclasses.astuple(closely.alone)[1:])
    for one, other in zip(roughly.fits, closely.fits, strict=True):
        assert one.train == pytest.approx(other.train, rel=0.02)
