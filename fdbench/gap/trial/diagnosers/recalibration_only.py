"""Moves the values on paper and adds no effect; what moves too far is its cause, what is left is unknown."""

from collections.abc import Sequence
from typing import final

from fdbench.gap import confidence
from fdbench.gap.hypothesis import start
from fdbench.gap.nominal import Nominal
from fdbench.gap.search import Search
from fdbench.gap.shrink import channel_gaps
from fdbench.gap.trial.diagnoser import Answer, Diagnoser
from fdbench.gap.trial.diagnosers._common import closed, prepared
from fdbench.gap.verdict import off_paper
from fdbench.record import Record


@final
class RecalibrationOnly(Diagnoser):
    """Ordinary identification: masses, frictions and a force offset are fitted in closed-loop simulation.

    The probability of an unknown cause is the share of the held-out gap that is then left and is not noise.
    """

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> Answer:
        replay, split = prepared(nominal, records, holdouts)
        paper = start(nominal)
        before = channel_gaps(replay, split, paper)
        search = Search(replay, split)
        fitted = search.refine(paper)
        after = float(channel_gaps(replay, split, fitted).mean())
        closed_share = 1.0 - after / max(float(before.mean()), 1e-12)
        values, _, _ = off_paper(search, fitted, closed_share, confidence.heads())
        causes = {cause["effect"]: float(cause["probability"]) for cause in values}
        left = 1.0 - 1.0 / max(after, 1.0)
        none = (1.0 - left) * (1.0 - max(causes.values(), default=0.0))
        return Answer(effects=causes, unknown=left, none=none, closure=closed(float(before.mean()), after))
