"""Simulated axes with known causes, by the library's own forms and by a second implementation."""
