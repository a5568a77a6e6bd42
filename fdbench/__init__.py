"""fdbench: a simulation benchmark of machine-tool feed drives."""

__version__ = "0.1.0"
