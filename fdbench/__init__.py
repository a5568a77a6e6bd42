"""fdbench: a simulation benchmark of machine-tool feed drives.

``import fdbench`` registers the environments with Gymnasium; everything else is imported where it is used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from fdbench.envs import register_all
from fdbench.version import __version__

if TYPE_CHECKING:
    from fdbench.api import compare, diagnose, run
    from fdbench.reading import read_record
    from fdbench.record import Record
    from fdbench.scenario import load_scenario

__all__ = ["Record", "__version__", "compare", "diagnose", "load_scenario", "read_record", "run"]

_HOMES = {
    **dict.fromkeys(("compare", "diagnose", "run"), "fdbench.api"),
    "load_scenario": "fdbench.scenario",
    "Record": "fdbench.record",
    "read_record": "fdbench.reading",
}

register_all()


def __getattr__(name: str) -> object:
    """Import what is asked for when it is asked for (PEP 562), so that ``import fdbench`` stays quick."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
