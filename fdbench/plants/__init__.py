"""Nominal systems on which the effects act: one plant, one file."""

from fdbench.plants._plant import Plant, RespondingPlant, StateSpace, StateSpacePlant, plants

__all__ = ["Plant", "RespondingPlant", "StateSpace", "StateSpacePlant", "plants"]
