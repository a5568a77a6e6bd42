"""Findings: what a search came to, from which the verdict is drawn."""

from collections.abc import Sequence
from dataclasses import dataclass

from fdbench.diagnosis.evidence.sensor_artefacts import Artefact
from fdbench.diagnosis.judge.reduction import Reductions
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.search.beside_the_known import Remainder
from fdbench.diagnosis.search.in_place_of_a_value import Exchange
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.search.stage import Stage
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """What the search came to, from which the verdict is drawn.

    Attributes
    ----------
    search : Search
    as_given : (n_channels,) array
        Mean squared held-out gap of the model as given, in units of the floor.
    where_fitted : (n_channels,) array
        The same of the re-calibrated model without effects, of what it was fitted to.
    calibrated, base, sought, final, weighed : Hypothesis
        The re-calibrated model without effects, what the search began with, what it ended with, with effects, that as
        it is judged, drawn and written, and that as hypotheses are compared: nominal parameters that hardly matter are
        where they were.
    stages, contests : sequences of Stage
        Of the search, and for each final effect the model without it beside its rivals.
    exchange : Exchange or None
        The most probable effect in place of a value; it is in ``final`` where it is more probable than the value.
    remainder : Remainder or None
        A known effect that stays beside a final one that is to take its place.
    reductions : Reductions
    beside_changes : Reductions or None
        The same of what was sought, beside what friction may change by from run to run: where this may be why the gap
        that is left shows nothing of an effect.
    artefacts : sequence of Artefact
        Effects that are seen in the readings themselves.
    """

    search: Search
    as_given: FloatArray
    where_fitted: FloatArray
    calibrated: Hypothesis
    base: Hypothesis
    sought: Hypothesis
    final: Hypothesis
    weighed: Hypothesis
    stages: Sequence[Stage]
    contests: Sequence[Stage]
    exchange: Exchange | None
    remainder: Remainder | None
    reductions: Reductions
    beside_changes: Reductions | None
    artefacts: Sequence[Artefact]

    @property
    def shown_by(self) -> dict[int, Reductions]:
        """For each final effect that a gap is smaller with, beside all others, the reductions of that gap.

        It is that of the model for all runs, else that beside what friction changes by from run to run.
        """
        every, beside = range(len(self.final.effects)), self.beside_changes
        found = {index: self.reductions for index in every if self.reductions.loses_by(index) < 0.0}
        if beside is not None:
            hidden = filter(self.reductions.may_hide, every)
            found |= {index: beside for index in hidden if beside.loses_by(index) < 0.0}
        return found
