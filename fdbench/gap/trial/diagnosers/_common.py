"""What reference diagnosers share: runs and replay of a case, and the two gates."""

import math
from collections.abc import Sequence

from fdbench.gap.diagnose import split_runs
from fdbench.gap.evidence import Split
from fdbench.gap.floor import floors
from fdbench.gap.nominal import Nominal
from fdbench.gap.replay import Replay
from fdbench.gap.runs import prepare
from fdbench.record import Record

TOO_SMALL, STEEP = 1.3, 20.0  # mean squared gap in units of the floor that is as likely noise as not
MEASURABLE = 1.5  # mean squared gap in units of the floor below which its closure means nothing


def prepared(nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> tuple[Replay, Split]:
    """Return the replay of a model and its runs, repeats merged."""
    runs, others = ([prepare(item, nominal.drive) for item in group] for group in (records, holdouts))
    split, _ = split_runs(runs, others, floors([*runs, *others]))
    replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
    return replay.coarsened(split.runs, split.floors), split


def gap_probability(mean_square: float) -> float:
    """Return the probability that a mean squared gap in units of the floor is more than noise."""
    return 1.0 / (1.0 + math.exp(-max(min(STEEP * (mean_square - TOO_SMALL), 60.0), -60.0)))


def closed(before: float, after: float) -> float | None:
    """Return the share of the excess over the floor that is closed, or None where there is too little of it.

    >>> closed(11.0, 3.0), closed(1.2, 1.0)
    (0.8, None)
    """
    return 1.0 - (after - 1.0) / (before - 1.0) if before > MEASURABLE else None
