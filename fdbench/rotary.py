"""Rotary axes: all is computed on the arc at a radius of 1 m, where rad are m, N m are N and kg m^2 are kg.

Names and units are those of a rotary axis in model files, records and whatever is said; in between, those of a linear
one.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from fdbench.errors import RecordError
from fdbench.units import UNITS, split_unit

LINEAR, ROTARY = "linear", "rotary"
# Suffixes of names, of a rotary axis and on its arc.
_ON_THE_ARC = {
    "rad": "m",
    "rad_per_s": "m_per_s",
    "rad_per_s2": "m_per_s2",
    "rad_per_s3": "m_per_s3",
    "Nm": "N",
    "Nm_per_rad": "N_per_m",
    "Nm_per_rad2": "N_per_m2",
    "Nm_per_A": "N_per_A",
    "Nm_s_per_rad": "N_s_per_m",
    "Nm_s2_per_rad2": "N_s2_per_m2",
    "kg_m2": "kg",
    "per_Nm": "per_N",
}
_OF_ROTARY = {linear: rotary for rotary, linear in _ON_THE_ARC.items()}
_UNIT_OF_ROTARY = {UNITS[linear]: UNITS[rotary] for linear, rotary in _OF_ROTARY.items()}
# What parts of a plant are called on a rotary axis.
PARTS = {"load": "table", "shaft": "screw"}
_NAMES = {"inertia_kg_m2": "mass_kg", "torque_constant_Nm_per_A": "force_constant_N_per_A"}
COLUMN_OF_FORCE = {"motor_torque_Nm": "motor_force_N"}
_NAMES_OF_ROTARY = {linear: rotary for rotary, linear in (COLUMN_OF_FORCE | _NAMES).items()}

_speaks_of_rotary: ContextVar[bool] = ContextVar("speaks_of_rotary", default=False)


@contextmanager
def spoken_of(axis: str) -> Iterator[None]:
    """Let names, units and errors be those of a rotary axis for a while, where ``axis`` is one."""
    token = _speaks_of_rotary.set(axis == ROTARY)
    try:
        yield
    except RecordError as error:
        if axis != ROTARY:
            raise
        raise RecordError(words_of_rotary(str(error))) from error
    finally:
        _speaks_of_rotary.reset(token)


def spoken_unit(unit: str) -> str:
    """Return the unit of a linear axis as it is said of the axis that is spoken of.

    >>> with spoken_of("rotary"):
    ...     spoken_unit("N"), spoken_unit("m/s"), spoken_unit("Hz")
    ('N m', 'rad/s', 'Hz')
    """
    return _UNIT_OF_ROTARY.get(unit, unit) if _speaks_of_rotary.get() else unit


def spoken_name(name: str) -> str:
    """Return the name of a column or parameter as it is said of the axis that is spoken of."""
    return rotary_name(name) if _speaks_of_rotary.get() else name


def spoken_words(text: str) -> str:
    """Return a sentence as it is said of the axis that is spoken of."""
    return words_of_rotary(text) if _speaks_of_rotary.get() else text


def rotary_name(name: str) -> str:
    """Return the name that a quantity of the arc has on a rotary axis.

    >>> rotary_name("motor_force_N"), rotary_name("pitch_m"), rotary_name("mass_kg"), rotary_name("phase_rad")
    ('motor_torque_Nm', 'pitch_rad', 'inertia_kg_m2', 'phase_rad')
    """
    stem, suffix = split_unit(name)
    return _NAMES_OF_ROTARY.get(name) or (f"{stem}_{_OF_ROTARY[suffix]}" if suffix in _OF_ROTARY else name)


def name_on_the_arc(name: str) -> str:
    """Return the name that a quantity of a rotary axis has on its arc.

    >>> name_on_the_arc("reference_velocity_rad_per_s"), name_on_the_arc("coulomb_force_Nm")
    ('reference_velocity_m_per_s', 'coulomb_force_N')
    """
    stem, suffix = split_unit(name)
    return _NAMES.get(name) or (f"{stem}_{_ON_THE_ARC[suffix]}" if suffix in _ON_THE_ARC else name)


def words_of_rotary(text: str) -> str:
    """Return a message about keys, columns and values of the arc with those of the rotary axis.

    >>> words_of_rotary("position_m jumps by 0.3 m; plant.table.mass_kg: missing")
    'position_rad jumps by 0.3 rad; plant.load.inertia_kg_m2: missing'
    >>> words_of_rotary("Did you mean coulomb_force_N [N]?")
    'Did you mean coulomb_force_Nm [N m]?'
    """
    for rotary, linear in PARTS.items():
        text = text.replace(f".{linear}", f".{rotary}")
    text = re.sub(r"(?<=\d) (m/s\^2|m/s|m|N(?! m)|kg(?! m))\b", lambda found: f" {_UNIT_OF_ROTARY[found[1]]}", text)
    text = re.sub(r"(?<=\[)[^\[\]]+(?=\])", lambda found: _UNIT_OF_ROTARY.get(found[0], found[0]), text)
    return re.sub(r"\b[a-z][a-z0-9_]*_[A-Za-z0-9_]+\b", lambda found: rotary_name(found[0]), text)
