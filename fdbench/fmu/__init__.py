"""A model as a Functional Mock-up Unit (FMI 2.0, co-simulation), in C that needs nothing but a compiler."""

from fdbench.fmu._unit import write_fmu

__all__ = ["write_fmu"]
