"""What every hypothesis may re-calibrate of a nominal model."""

import functools
from collections.abc import Sequence

from fdbench.diagnosis.model.axis_parameters import (
    Damping,
    EncoderDelay,
    EncoderZeros,
    ForceOffset,
    Mass,
    Stiffness,
    Viscous,
)
from fdbench.diagnosis.model.friction_parameters import (
    BristleForm,
    BristleStiffness,
    FrictionForm,
    FrictionSide,
    KnownAmplitude,
    KnownFurtherAmplitude,
    KnownPhase,
    TransitionVelocity,
)
from fdbench.diagnosis.model.loop_parameters import ControllerGain, LoopLag, ReferenceDelay, VelocityFilter
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameter import NominalParameter

KINDS: Sequence[type[NominalParameter]] = (
    Mass,
    Viscous,
    Stiffness,
    Damping,
    KnownAmplitude,
    KnownFurtherAmplitude,
    KnownPhase,
    TransitionVelocity,
    BristleStiffness,
    ForceOffset,
    EncoderZeros,
    EncoderDelay,
    FrictionForm,
    BristleForm,
    FrictionSide,
    ReferenceDelay,
    VelocityFilter,
    LoopLag,
    ControllerGain,
)


@functools.lru_cache(maxsize=16)
def nominal_parameters(nominal: Nominal) -> tuple[NominalParameter, ...]:
    """Return what every hypothesis may re-calibrate, as far as a model has it and is in doubt of it."""
    return tuple(item for kind in KINDS for item in kind.of(nominal))
