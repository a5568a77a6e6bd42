"""The next experiment: the motion of a menu after which the true cause is expected to be most probable."""

from collections.abc import Sequence

from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.expected_information import Forecast, Forecaster, VerdictReader
from fdbench.diagnosis.experiment.menu import menu_of
from fdbench.diagnosis.experiment.trajectory import Trajectory
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.search.stage import Stage
from fdbench.diagnosis.settings import EXPERIMENT


def most_open(stages: Sequence[Stage], reader: VerdictReader) -> Stage | None:
    """Return the stage that is furthest from a decision; None where all are decided.

    Beside what was found, rivals count only if one of them is there more likely than not: beside effects, and beside a
    value, what readings show or no gap, if the verdict is sure of it.
    """
    is_settled = reader.settled >= EXPERIMENT.sure
    found = [
        stage for stage in stages if stage.rivals and (stage.present() >= 0.5 or not (stage.base.effects or is_settled))
    ]
    surest = [max(reader.probabilities(stage).values()) for stage in found]
    open_ = [(p, stage) for p, stage in zip(surest, found, strict=True) if p < EXPERIMENT.sure]
    return min(open_, key=lambda item: item[0])[1] if open_ else None


def design(
    readings: Readings,
    split: Split,
    stages: Sequence[Stage],
    nominal: Nominal,
    reader: VerdictReader,
    trajectories: Sequence[Trajectory] | None = None,
) -> Forecast | None:
    """Return the motion after which the truth is expected to be most probable, its time paid for, or None.

    Parameters
    ----------
    readings : Readings
        Of the runs of the split.
    split : Split
        Runs, for the clock and the positions visited, and floors.
    stages : sequence of Stage
        Whose rivals may compete.
    nominal : Nominal
    reader : VerdictReader
    trajectories : sequence of Trajectory, optional
        In place of the menu for the drive's limits.

    Returns
    -------
    Forecast or None
        None where no two candidates compete, or no motion would tell them apart.
    """
    stage = most_open(stages, reader)
    if stage is None:
        return None
    forecaster = Forecaster(readings, split, stage, reader)
    every = menu_of(split, nominal) if trajectories is None else trajectories
    followed = [item for item in forecaster.forecasts(every) if item is not None]
    found = [item for item in followed if item.gain() >= EXPERIMENT.smallest_gain]
    return max(found, key=Forecast.utility, default=None)
