"""Commanded motions: one kind of trajectory, one file."""

from fdbench.motions._motion import Motion, Reference, motions

__all__ = ["Motion", "Reference", "motions"]
