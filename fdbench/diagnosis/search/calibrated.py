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

    def surpassed_by(self, ready: Aligned, *, late: bool = False, as_likely: bool = False) -> "Calibrated | None":
        """Return another model re-calibrated, where it brings more than naming a cause costs; else None.

        One that is ``as_likely`` beforehand has to bring no more than this one. It is not fitted where noise alone is
        left, or where a linear fit about what was found here does not promise that. Both may be ``late``, by more than
        the trace that each loop is, where that could be taken for the other.
        """
        own = self._if_late() if late else self
        enough = own.cost - (0.0 if as_likely else own.hypothesis.cost_of_a_cause)
        if own.misfit < SEARCH.noise_alone or _promised_cost(ready, own.hypothesis) > enough:
            return None
        tried = Calibrated.of(ready)
        return None if (tried._if_late() if late else tried).cost > enough else tried

    def _if_late(self) -> "Calibrated":
        """Return it with a loop that is late, where that costs less."""
        kind = LoopLag.unknown(self.ready.nominal)
        if kind is None:
            return self
        hypothesis = self.refinement.refine(self.hypothesis.with_effect(kind.typical()))
        misfit, cost = _judged(*_alone(self.refinement, hypothesis), hypothesis)
        return self if self.cost <= cost else dataclasses.replace(self, hypothesis=hypothesis, misfit=misfit, cost=cost)


def _promised_cost(ready: Aligned, near: Hypothesis) -> float:
    """Return the cost of a model that a linear fit about what was found of another one promises."""
    refinement, given = _refinement(ready)
    return _judged(*refinement.promise(dataclasses.replace(given, shifts=near.shifts, effects=near.effects)))[1]


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
