"""Nominal systems on which the effects act: one plant, one file."""

from fdbench.plants._linear_system import LinearisedPlant, LinearSystem
from fdbench.plants._plant import (
    LinearModel,
    NetworkPlant,
    Plant,
    RespondingPlant,
    SpectralPlant,
    StateSpace,
    StateSpacePlant,
    plants,
)

__all__ = [
    "LinearModel",
    "LinearSystem",
    "LinearisedPlant",
    "NetworkPlant",
    "Plant",
    "RespondingPlant",
    "SpectralPlant",
    "StateSpace",
    "StateSpacePlant",
    "plants",
]
