"""Gains of the controller that somebody has set anew since a baseline: known from the records, and no cause."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from fdbench.diagnosis.model.loop_parameters import ControllerGain
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.records.asked_force import law_misfit
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.diagnosis.settings import SEARCH
from fdbench.plants.feed_drive import Cascade


def gains_set_anew(found: Calibrated) -> dict[str, float]:
    """Return the gains that differ from those of the baseline, by their names, and by what share of themselves.

    In closed loop a gain may move for what changed in the machine. One that was set anew also makes the law of the
    controller, of its own readings alone, ask for the force that was logged.
    """
    nominal, hypothesis = found.ready.nominal, found.hypothesis
    moved = {
        item.name: item.value(nominal.drive, shift) / item.value(nominal.drive, 0.0) - 1.0
        for item, shift in zip(nominal_parameters(nominal), hypothesis.shifts, strict=True)
        if isinstance(item, ControllerGain)
    }
    gains = {name: share for name, share in moved.items() if abs(share) > SEARCH.set_anew}
    if not gains:
        return {}
    before, now = (
        _misfit_of_law(nominal, found.ready.runs),
        _misfit_of_law(with_gains(nominal, gains), found.ready.runs),
    )
    return gains if now < SEARCH.law_left * before else {}


def _misfit_of_law(nominal: Nominal, runs: Sequence[RecordedRun]) -> float:
    """Return the sum of the mean squares that forces are beside the law of a controller, of runs that tell it."""
    controller, loops = nominal.drive.controller, nominal.simulation.cycles
    if not isinstance(controller, Cascade):
        return 0.0
    return sum(law_misfit(run.as_read(), controller, loops) or 0.0 for run in runs)


def with_gains(nominal: Nominal, gains: dict[str, float]) -> Nominal:
    """Return a model with gains of its controller changed by shares of themselves."""
    controller: Any = nominal.drive.controller
    changed = {name: getattr(controller, name) * (1.0 + share) for name, share in gains.items()}
    return replace(nominal, plant=replace(nominal.drive, controller=replace(controller, **changed)))
