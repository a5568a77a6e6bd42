"""How often the controller acts between two samples of a log, where the model does not say."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evidence.evidence import Evidence, gather
from fdbench.diagnosis.evidence.prepare import Aligned
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.settings import SEARCH
from fdbench.plants._controllers import Following, OpenLoop


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibrated:
    r"""Records beside a model at one rate of its loop, and what re-calibration makes of it.

    Attributes
    ----------
    ready : Aligned
    refinement : Refinement
    hypothesis : Hypothesis
    misfit : float
        What is left on the training segments; 1 is noise alone.
    cost : float
        Minus twice the tempered log evidence, :math:`n \ln M + p`.
    """

    ready: Aligned
    refinement: Refinement
    hypothesis: Hypothesis
    misfit: float
    cost: float

    @classmethod
    def of(cls, ready: Aligned, *, narrow: bool = False) -> "Calibrated":
        """Re-calibrate the nominal parameters of a model; ``narrow`` says that they are known to a few per cent."""
        refinement, given = _refinement(ready)
        found = refinement.calibrate(given, narrow=narrow)
        evidence = gather(refinement.readings, ready.split, found, ())
        misfit, cost = _judged(evidence, float(evidence.squares(held_out=False)[0]), found)
        return cls(ready=ready, refinement=refinement, hypothesis=found, misfit=misfit, cost=cost)


def promised_cost(ready: Aligned, near: Hypothesis) -> float:
    """Return the cost of a model that a linear fit about the nominal parameters of another one promises."""
    refinement, given = _refinement(ready)
    return _judged(*refinement.promise(dataclasses.replace(given, shifts=near.shifts)))[1]


def _refinement(ready: Aligned) -> tuple[Refinement, Hypothesis]:
    given = start(ready.nominal)
    return Refinement(ready.readings.coarsened(given, ready.split.noise_models), ready.split), given


def _judged(evidence: Evidence, squares: float, hypothesis: Hypothesis) -> tuple[float, float]:
    """Return the misfit of weighted squares on the training segments, and what the hypothesis costs with it."""
    inside = ~evidence.held_out
    misfit = squares / max(float((evidence.weights * evidence.counts)[inside].sum()), 1e-12)
    n = min(SEARCH.effective_samples, float(len(np.unique(evidence.group[inside]))))
    return misfit, n * math.log(max(misfit, 1e-9)) + hypothesis.named_penalty()


def at_likely_rate(ready: Aligned, anew: Callable[[int], Aligned]) -> Calibrated:
    """Return the re-calibrated model at the rate of its loop that is told, or else at the likeliest.

    Controllers often act two or four times between samples of their log, and are late by less then. A rate is taken
    where it brings more than naming a cause costs; a loop as fast as the log, which leaves noise alone, is.

    Parameters
    ----------
    ready : Aligned
    anew : callable
        Returns the records prepared for a model with another rate, on which those depend that are followed.
    """
    best = Calibrated.of(ready)
    if ready.nominal.simulation.loops is not None or isinstance(ready.nominal.drive.controller, OpenLoop):
        return best
    for loops in SEARCH.loops:
        if best.misfit < SEARCH.noise_alone:
            break
        at_rate, enough = _at_rate(ready, loops, anew), best.cost - 2.0 * math.log(len(ready.nominal.library))
        if promised_cost(at_rate, best.hypothesis) > enough:
            break
        tried = Calibrated.of(at_rate)
        if tried.cost > enough:
            break
        best = tried
    return best


def _at_rate(ready: Aligned, loops: int, anew: Callable[[int], Aligned]) -> Aligned:
    said = (
        f"The controller seems to act {loops} times between two samples of the log: with one cycle a sample the model "
        f"fits worse, whatever its values. Write `loops = {loops}` under [simulation] of the model, or `loops = 1` if "
        "that is wrong."
    )
    if isinstance(ready.nominal.drive.controller, Following):
        at_rate = anew(loops)
    else:
        simulation = dataclasses.replace(ready.nominal.simulation, loops=loops)
        nominal = dataclasses.replace(ready.nominal, simulation=simulation)
        readings = Readings(ready.readings.replay.with_loops(loops), ready.split.runs)
        at_rate = dataclasses.replace(ready, nominal=nominal.beside(ready.nominal.covered), readings=readings)
    return dataclasses.replace(at_rate, warnings=[*at_rate.warnings, said])
