"""Moves the nominal parameters and adds no effect; what moves too far is its cause, what is left is unknown."""

from collections.abc import Sequence
from typing import final

from fdbench.diagnosis.evidence.prepare import merged_runs
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.nominal_values import deviating_parameters
from fdbench.diagnosis.judge.reduction import channel_gaps, explained_fraction
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.search.search import Search
from fdbench.record import Record
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser


@final
class RecalibrationOnly(Diagnoser):
    """Ordinary identification: masses, frictions and a force offset are fitted in closed-loop simulation.

    The probability of an unknown cause is the share of the held-out gap that is then left and is not noise.
    """

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        readings, split = merged_runs(nominal, records, holdouts)
        paper = start(nominal)
        before = channel_gaps(readings, split, [paper])
        search = Search(Refinement(readings, split))
        fitted = search.refinement.refine(paper)
        after = float(channel_gaps(readings, split, [fitted]).mean())
        closed_share = 1.0 - after / max(float(before.mean()), 1e-12)
        values = deviating_parameters(search, fitted, closed_share, confidence.models()).causes
        causes = {cause.effect: cause.probability for cause in values}
        left = 1.0 - 1.0 / max(after, 1.0)
        none = (1.0 - left) * (1.0 - max(causes.values(), default=0.0))
        return CaseAnswer(
            effects=causes, unknown=left, none=none, closure=explained_fraction(float(before.mean()), after)
        )
