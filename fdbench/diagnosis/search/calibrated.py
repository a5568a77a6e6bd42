"""A model re-calibrated on records, and what it costs: as controllers are compared that act in different ways."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evidence.evidence import Evidence, gather
from fdbench.diagnosis.evidence.prepare import Aligned
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.loop_parameters import LoopLag
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.settings import SEARCH


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibrated:
    r"""Records beside a model, and what re-calibration makes of it.

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
        misfit, cost = _judged(*_alone(refinement, found), found)
        return cls(ready=ready, refinement=refinement, hypothesis=found, misfit=misfit, cost=cost)

    def surpassed_by(self, ready: Aligned) -> "Calibrated | None":
        """Return another model re-calibrated, where it brings more than naming a cause costs; else None.

        It is not fitted where a linear fit about the nominal parameters found here does not promise that.
        """
        enough = self.cost - self.hypothesis.cost_of_a_cause
        if _promised_cost(ready, self.hypothesis) > enough:
            return None
        tried = Calibrated.of(ready)
        return None if tried.cost > enough else tried

    def cost_if_late(self) -> float:
        """Return the least cost: as it is, or of a loop that is late by more than the trace that each one is."""
        kinds = [kind for kind in self.ready.nominal.library if kind.trace_of == LoopLag.kind]
        late = [self.refinement.refine(self.hypothesis.with_effect(kind.typical())) for kind in kinds]
        return min([self.cost, *(_judged(*_alone(self.refinement, item), item)[1] for item in late)])


def _promised_cost(ready: Aligned, near: Hypothesis) -> float:
    """Return the cost of a model that a linear fit about the nominal parameters of another one promises."""
    refinement, given = _refinement(ready)
    return _judged(*refinement.promise(dataclasses.replace(given, shifts=near.shifts)))[1]


def _refinement(ready: Aligned) -> tuple[Refinement, Hypothesis]:
    given = start(ready.nominal)
    return Refinement(ready.readings.coarsened(given, ready.split.noise_models), ready.split), given


def _alone(refinement: Refinement, hypothesis: Hypothesis) -> tuple[Evidence, float]:
    """Return the evidence about a hypothesis, and its weighted squares on the training segments."""
    evidence = gather(refinement.readings, refinement.split, hypothesis, ())
    return evidence, float(evidence.squares(held_out=False)[0])


def _judged(evidence: Evidence, squares: float, hypothesis: Hypothesis) -> tuple[float, float]:
    """Return the misfit of weighted squares on the training segments, and what the hypothesis costs with it."""
    inside = ~evidence.held_out
    misfit = squares / max(float((evidence.weights * evidence.counts)[inside].sum()), 1e-12)
    n = min(SEARCH.effective_samples, float(len(np.unique(evidence.group[inside]))))
    return misfit, n * math.log(max(misfit, 1e-9)) + hypothesis.named_penalty()
