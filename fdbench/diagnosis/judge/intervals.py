"""Parameters of the named effects with their 95 % intervals."""

import math
from collections.abc import Mapping

import numpy as np

from fdbench.diagnosis.answer.quantity import Pair, Quantity
from fdbench.diagnosis.evidence.evidence import summed
from fdbench.diagnosis.model.candidates import one_of_each
from fdbench.diagnosis.model.hypothesis import Hypothesis, adjustables
from fdbench.diagnosis.model.parameter_vector import adjustables_of
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect
from fdbench.rotary import spoken_unit


def intervals(search: Search, final: Hypothesis) -> list[dict[str, Pair]]:
    """Return the 95 % interval of each fitted parameter of each effect.

    From the normal matrix and the scatter of its right-hand sides from segment to segment, which counts what is
    left as it is, correlated in time or not (White 1980; segments as clusters). Every other effect of the library may
    be there too, with a standard deviation of 5 % of its typical size, which the numbers may make up for.
    """
    if not final.effects:
        return []
    numbers, others = adjustables_of(final), one_of_each(final)
    evidence = search.refinement.responses(final, others, search.split.fitted, effects=True)
    inside = ~evidence.held_out
    n = len(numbers)
    prior = np.r_[[float(item.prior) for item in numbers], np.full(len(others), JUDGE.hidden**-2)]
    normal = evidence.sums[0, 1:, 1:] + np.diag(prior)
    sums = summed(evidence.weights[inside, None] * evidence.products[inside, 0, 1:], evidence.group[inside])
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-9, hermitian=True) / np.outer(scale, scale)
    spread = sums.T @ sums * len(sums) / max(len(sums) - n, 1)
    covariance = inverse @ (spread + np.diag(prior)) @ inverse
    found, first = [], len(final.shifts)
    for effect in final.effects:
        items = final.numbers(effect)
        of_effect = covariance[first : first + len(items), first : first + len(items)]
        lowest = {item.name: item.low for item in items}
        phases = {item.name for item in effect.parameters() if item.phase}
        own: dict[str, Pair] = {}
        for item in items:
            # What is fitted is by how much a parameter exceeds another one; its interval is that of their sum.
            parts = [other.step if other.name in (item.name, item.above) else 0.0 for other in items]
            half, value = 1.96 * float(np.sqrt(parts @ of_effect @ parts)), float(getattr(effect, item.name))
            half = min(half, math.pi) if item.name in phases else half
            own[item.name] = max(value - half, lowest.get(item.above, item.low)), min(value + half, item.high)
        found.append(own)
        first += len(items)
    return found


def parameters(effect: Effect, bounds: Mapping[str, Pair]) -> dict[str, Quantity]:
    """Return the parameters of an effect with units; those that no fit moves have no interval."""
    return {
        item.name: Quantity(value=getattr(effect, item.name), ci95=bounds.get(item.name), unit=spoken_unit(item.unit))
        for item in type(effect).parameters()
    }


def not_fitted(effect: Effect) -> list[str]:
    """Return the parameters that are neither searched nor fitted, nor known, so that they have their typical values."""
    fitted = {item.name for item in adjustables(effect)}
    others = (item for item in effect.parameters() if item.name not in fitted and not item.grid)
    return [item.name for item in others if getattr(effect, item.name) == item.typical]
