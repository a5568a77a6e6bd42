"""The numbers of a hypothesis as one vector, which a fit moves."""

import dataclasses
import math

import numpy as np

from fdbench.diagnosis.model.hypothesis import Adjustable, Hypothesis
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.record import FloatArray


def adjustables_of(hypothesis: Hypothesis) -> list[Adjustable]:
    """Return what a fit may move: the shifts of the nominal parameters, then the numbers of each effect."""
    found = [
        Adjustable(name=item.name, step=1.0, low=-math.inf, high=math.inf, prior=True)
        for item in nominal_parameters(hypothesis.nominal)
    ]
    for effect in hypothesis.effects:
        found += hypothesis.numbers(effect)
    return found


def parameter_vector(hypothesis: Hypothesis) -> FloatArray:
    """Return the numbers of a hypothesis in the order of `adjustables_of`."""
    values = list(hypothesis.shifts)
    for effect in hypothesis.effects:
        values += [item.of(effect) for item in hypothesis.numbers(effect)]
    return np.array(values)


def with_parameters(hypothesis: Hypothesis, values: FloatArray) -> Hypothesis:
    """Return a hypothesis with other numbers, kept within the bounds of its effects."""
    n = len(hypothesis.shifts)
    place = n
    effects = []
    for effect in hypothesis.effects:
        changes: dict[str, float] = {}
        for item in hypothesis.numbers(effect):
            value = float(min(max(values[place], item.low), item.high))
            changes[item.name] = value + changes.get(item.above, 0.0)
            place += 1
        phases = {item.name for item in type(effect).parameters() if item.phase}
        changes |= {name: math.remainder(changes[name], 2.0 * math.pi) for name in phases & changes.keys()}
        effects.append(effect.within(**changes))
    return dataclasses.replace(hypothesis, shifts=tuple(values[:n].tolist()), effects=tuple(effects))
