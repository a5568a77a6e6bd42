"""The physics: one effect, one file. Start with ``coulomb_friction`` and ``lugre_friction``."""

from fdbench.effects._effect import CAUSE_TYPES, Effect, LinearPart, Parameter, Port, effects, kernel, parameter
from fdbench.effects._scale import Scale, at_scale

__all__ = [
    "CAUSE_TYPES",
    "Effect",
    "LinearPart",
    "Parameter",
    "Port",
    "Scale",
    "at_scale",
    "effects",
    "kernel",
    "parameter",
]
