"""Diagnose the sim-to-real gap of an axis: where it lies, which unmodelled effect causes it, how far it shrinks."""
