"""A hypothesis as a nominal model of its own."""

import dataclasses

from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.known_effects import amplitude_of, with_amplitude
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.effects import Effect


def as_nominal(hypothesis: Hypothesis) -> Nominal:
    """Return a hypothesis as a model of its own: what it adds is known from now on, what it replaces is gone."""
    variant = hypothesis.variant
    effects = [item for index, item in enumerate(variant.plant.effects) if index not in hypothesis.replaced]
    for added in variant.extra:
        place = next((index for index, item in enumerate(effects) if _adds_up(item, added)), None)
        if place is None:
            effects.append(added)
        else:
            effects[place] = with_amplitude(added, amplitude_of(effects[place]) + amplitude_of(added))
    plant, doubt = dataclasses.replace(variant.plant, effects=tuple(effects)), hypothesis.nominal.uncertainty
    known = {item.name for item in effects}
    doubt = dataclasses.replace(doubt, effects={name: own for name, own in doubt.effects.items() if name in known})
    return dataclasses.replace(hypothesis.nominal, plant=plant, uncertainty=doubt)


def _adds_up(known: Effect, added: Effect) -> bool:
    """Return whether two effects of a re-calibrated kind are one with the sum of their amplitudes."""
    kind = type(added)
    if known.declared is not kind.declared or not kind.calibrates or kind.further_amplitudes:
        return False
    item = next(item for item in kind.parameters() if item.name == kind.amplitude)
    same = with_amplitude(known, amplitude_of(added)) == added
    return same and item.low <= amplitude_of(known) + amplitude_of(added) <= item.high
