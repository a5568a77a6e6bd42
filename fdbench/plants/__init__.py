"""Nominal systems on which the effects act: one plant, one file."""

from fdbench.plants._plant import (
    NetworkPlant,
    Plant,
    RespondingPlant,
    SpectralPlant,
    StateSpace,
    StateSpacePlant,
    plants,
)

__all__ = ["NetworkPlant", "Plant", "RespondingPlant", "SpectralPlant", "StateSpace", "StateSpacePlant", "plants"]
