"""fdbench: a simulation benchmark of machine-tool feed drives.

``import fdbench`` registers the environments with Gymnasium; everything else is imported where it is used.
"""

from fdbench.envs import register_all
from fdbench.version import __version__

__all__ = ["__version__"]

register_all()
