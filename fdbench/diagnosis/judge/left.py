"""What is left of a gap beside all that was found, and whether that is more than noise."""

from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evidence.evidence import gather
from fdbench.diagnosis.judge.composed import noise_alone
from fdbench.diagnosis.judge.findings import Findings
from fdbench.diagnosis.judge.reduction import channel_gaps
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True)
class Left:
    """What is left in units of the noise: misfit beside effects, worst stretch of time, share closed.

    See `fdbench.diagnosis.judge.probability_models.unknown_features`.
    """

    misfit: float
    worst: float
    closed: float


def left_of(found: Findings, repaired: FloatArray) -> Left:
    """Return what the model for all runs leaves, or that of the search, whichever is less.

    Where friction is another in each run, what the search ended with may leave noise, and one model for all more.
    """
    search, ends = found.search, (found.final, found.sought)
    stage = search.compared(found.base, [(Effect, item, True) for item in ends])
    given, *gaps = channel_gaps(search.readings, search.split, [start(found.base.nominal), *ends])
    return Left(
        misfit=min(rival.misfit for rival in stage.rivals),
        worst=min(gather(search.readings, search.split, item, ()).worst() for item in ends),
        closed=max(_closed(found.as_given, repaired), *(_closed(given, own) for own in gaps)),
    )


def within_repeats(found: Findings, recalibrated: FloatArray) -> float:
    """Return the probability that the gap is no more than what repeats differ by, however little it looks like noise.

    Such a gap lacks no cause, unless values of the loop went to their limits for it. Held-out motions need not come by
    the place where one is. They may be of a day on which friction was another one, as it is from repeat to repeat; that
    of records that were fitted is in the model. Where nothing was repeated, nobody knows.
    """
    plain = found.search.split.plain
    if found.weighed.at_limits > 0 or not plain.is_measured:
        return 0.0
    expected = np.array([floor.expected for floor in plain.noise_models.values()])
    judged, fitted = (
        float((gaps / expected).max()) / float(np.mean([plain.runs[place].repeats for place in places]))
        for gaps, places in (
            (np.minimum(recalibrated, _of_another_day(found)), plain.judged),
            (found.where_fitted, plain.fitted),
        )
    )
    return noise_alone(max(judged, fitted), of=JUDGE.measurable)


def _of_another_day(found: Findings) -> FloatArray:
    """Return the mean squared held-out gaps beside what may change from run to run, in units of the floor.

    Of the re-calibrated model without effects, (n_channels,); endless where a run would have changed by more than
    ``JUDGE.another_day`` deviations.
    """
    readings, split = found.search.readings, found.search.split
    for place in split.judged if split.changes else ():
        change = split.changes[place]
        if change is not None:
            gap = split.gap(place, readings.alone(place, found.calibrated))
            if change.deviation([*gap.values()]) > JUDGE.another_day:
                return np.full(len(split.noise_models), np.inf)
    within = [(floor.rms / floor.total) ** 2 for floor in split.noise_models.values()]
    return np.asarray(channel_gaps(readings, split, [found.calibrated])[0] * within)


def _closed(as_given: FloatArray, left: FloatArray) -> float:
    """Return the share of mean squared gaps beyond their floors that is closed, over all channels; of none all is."""
    beyond = float(as_given.mean()) - 1.0
    return 1.0 - min(max((float(left.mean()) - 1.0) / beyond, 0.0), 1.0) if beyond > JUDGE.rest_noise else 1.0
