"""Where no effect is worth adding by what is held out, that which explains most of what is fitted and another are."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from search_lab import NOMINAL, search

from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.search.stage import Rival, Stage
from fdbench.diagnosis.settings import SEARCH
from fdbench.effects import effects

BASE = start(NOMINAL)
DRAG, COGGING = (effects.get(name).typical() for name in ("quadratic_drag", "cogging"))


def rival(hypothesis: Hypothesis, misfit: float, fitted: float) -> Rival:
    kind = type(hypothesis.effects[-1])
    return Rival(
        kind=kind,
        hypothesis=hypothesis,
        misfit=misfit,
        fitted=fitted,
        penalty=0.0,
        refined=True,
        size=1.0,
        own_size=1.0,
    )


def stage_of(base: Hypothesis, misfit: float, fitted: float, *rivals: Rival) -> Stage:
    return Stage(base=base, misfit=misfit, fitted=fitted, penalty=0.0, test_count=1e3, rivals=rivals)


class Told(Search):
    """A search whose rounds are told: of which base, what stage; and what misfit a pair has in the end."""

    def __init__(self, stages: Sequence[Stage], of_the_pair: float) -> None:
        self._stages, self._of_the_pair = stages, of_the_pair
        self.progress = lambda text: None
        self.refinement: Any = SimpleNamespace(look_closely=lambda base: base)

    def stage(self, base: Hypothesis) -> Stage | None:
        return next((item for item in self._stages if item.base.effects == base.effects), None)

    def compared(self, base: Hypothesis, hypotheses: Sequence[tuple[Any, Hypothesis, bool]]) -> Stage:
        (item,) = hypotheses
        return stage_of(base, 10.0, 10.0, rival(item[1], self._of_the_pair, 1.0))


FIRST = BASE.with_effect(DRAG)
BOTH = FIRST.with_effect(COGGING)
LAST = stage_of(BASE, 10.0, 10.0, rival(BASE.with_effect(COGGING), 10.2, 9.9), rival(FIRST, 10.5, 4.0))
SECOND = stage_of(FIRST, 10.5, 4.0, rival(BOTH, 1.0, 1.0))
NOTHING_MORE = stage_of(BOTH, 1.0, 1.0)


def test_two_effects_are_found_of_which_neither_shows_alone() -> None:
    assert LAST.is_last()
    final, stages = Told([LAST, SECOND, NOTHING_MORE], of_the_pair=1.0).run(BASE)
    assert final is BOTH
    assert stages == [LAST, SECOND, NOTHING_MORE]


@pytest.mark.parametrize(
    ("stages", "of_the_pair"),
    [
        ([LAST, SECOND], 9.0),  # together they are worth less than two causes
        ([LAST, stage_of(FIRST, 10.5, 4.0, rival(BOTH, 10.4, 3.9))], 1.0),  # no second one
        ([LAST], 1.0),  # noise alone beside the first
        ([stage_of(BASE, 10.0, 10.0, rival(FIRST, 10.5, 9.5)), SECOND], 1.0),  # none explains what is fitted
        ([replace(LAST, rivals=(replace(LAST.rivals[1], refined=False),)), SECOND], 1.0),  # none was refined
        ([replace(LAST, misfit=0.9 * SEARCH.unexplained), SECOND], 1.0),  # hardly anything is left
    ],
)
def test_a_pair_is_not_added_lightly(stages: Sequence[Stage], of_the_pair: float) -> None:
    final, found = Told(stages, of_the_pair).run(BASE)
    assert final is BASE
    assert found == list(stages[:1])


def test_a_stage_knows_the_misfit_where_it_was_fitted() -> None:
    own = search(effects.get("direction_dependent_friction").typical(viscous_asymmetry_N_s_per_m=60.0))
    stage = own.stage(BASE)
    assert stage is not None
    best = stage.closest_where_fitted()
    assert best is stage.rivals[0]
    assert best.fitted == pytest.approx(1.0, abs=0.2)
    assert stage.fitted > 2.0
