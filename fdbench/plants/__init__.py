"""Nominal systems on which the effects act: one plant, one file."""

from fdbench.plants._plant import Plant, plants

__all__ = ["Plant", "plants"]
