"""How often the controller acts between two samples of a log, where the model does not say."""

import dataclasses
from collections.abc import Callable

from fdbench.diagnosis.evidence.prepare import Aligned
from fdbench.diagnosis.model.nominal import Simulation
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.diagnosis.search.command_rates import BACKWARD
from fdbench.diagnosis.settings import SEARCH
from fdbench.plants._controllers import Following, OpenLoop


def at_likely_rate(best: Calibrated, anew: Callable[[Simulation], Aligned]) -> Calibrated:
    """Return the re-calibrated model at the rate of its loop that is told, or else at the likeliest.

    Controllers often act two, four or eight times between samples of their log, and are late by less then. A rate is
    taken where it brings more than naming a cause costs, and a higher one beside it where it brings more at all; a loop
    as fast as the log, which leaves noise alone, is.

    Parameters
    ----------
    best : Calibrated
        With one cycle a sample, where none are told.
    anew : callable
        Returns the records prepared for a model with another rate.
    """
    ready = best.ready
    if ready.nominal.simulation.loops is not None or isinstance(ready.nominal.drive.controller, OpenLoop):
        return best
    for loops in SEARCH.loops:
        if best.misfit < SEARCH.noise_alone:
            break
        tried = best.surpassed_by(_at_rate(ready, loops, anew), as_likely=best.ready is not ready)
        if tried is None:
            break
        best = tried
    return best


def _at_rate(ready: Aligned, loops: int, anew: Callable[[Simulation], Aligned]) -> Aligned:
    said = (
        f"The controller seems to act {loops} times between two samples of the log, or more often: with one cycle a "
        "sample the model fits worse, whatever its values. Write how often under [simulation] of the model, as "
        f"`loops = {loops}`, or `loops = 1` if that is wrong."
    )
    simulation = dataclasses.replace(ready.nominal.simulation, loops=loops)
    # What is followed depends on the rate of the loop, and so do rates that the controller differences backwards.
    if isinstance(ready.nominal.drive.controller, Following) or simulation.command_rates == BACKWARD:
        at_rate = anew(simulation)
    else:
        nominal = dataclasses.replace(ready.nominal, simulation=simulation)
        readings = Readings(ready.readings.replay.with_loops(loops), ready.split.runs)
        at_rate = dataclasses.replace(ready, nominal=nominal.beside(ready.nominal.covered), readings=readings)
    return at_rate.assuming(said)
