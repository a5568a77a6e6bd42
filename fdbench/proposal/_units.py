"""Units of positions, speeds and outputs: by the file, by one another, or by their size."""

from typing import NamedTuple

import numpy as np

from fdbench.proposal._data import derivative, slope
from fdbench.proposal._names import LogColumn, turns
from fdbench.proposal._roles import SIZE_OF_COMMAND, Role
from fdbench.units import si_unit

POSITIONS = ("mm", "m", "um", "in", "deg", "rad", "rev")
SPEEDS = ("mm/s", "m/s", "mm/min", "m/min", "in/min", "deg/s", "rad/s", "rev/s", "rpm")
FITS = 0.03  # by which a speed may differ from the derivative of the position
LARGEST = {"m": 2.0, "mm": 2e4, "um": 2e7}  # a position that moves farther is not in this unit
LARGEST_RAD = 20.0  # an angle that moves farther is in degrees


class Unit(NamedTuple):
    """A unit and why; ``is_guess`` where only the size or the usual speaks for it."""

    name: str
    why: str
    is_guess: bool = False


def position_unit(column: LogColumn, speeds: list[tuple[LogColumn, LogColumn]], step_s: float, usual: str) -> Unit:
    """Return the unit of the position.

    Parameters
    ----------
    column : LogColumn
        The position.
    speeds : list of pairs of LogColumn
        Derivatives in the log, and of what: itself, or its command, which counts where it is as large.
    step_s : float
        Sampling time.
    usual : str
        Unit of positions in logs of this format, or an empty text.
    """
    if column.unit:
        return Unit(column.unit, column.why)
    for speed, place in speeds:
        if speed.unit and abs(slope(column.values, place.values)[0] - 1.0) < SIZE_OF_COMMAND:
            factor = slope(speed.values, derivative(place.values, step_s))[0] * si_factor(speed.unit)
            near = [u for u in POSITIONS if turns(u) == turns(speed.unit) and abs(factor / si_factor(u) - 1.0) < FITS]
            if near:
                return Unit(near[0], f"the derivative of '{place.name}' is '{speed.name}' in {speed.unit}")
    size = float(np.ptp(column.values))
    unknown = f"; '{column.foreign_unit}' is not known here" if column.foreign_unit else ""
    if column.spoken_unit == "rad":
        name = "rad" if size <= LARGEST_RAD else "deg"
        return Unit(name, f"GUESS: by its name an angle, of a range of {size:.4g}{unknown}", True)
    if usual:
        return Unit(usual, f"GUESS: usual in such logs; its range is {size:.4g}", True)
    name = next((name for name, largest in LARGEST.items() if size <= largest), "nm")
    return Unit(name, f"GUESS: by its range of {size:.4g}{unknown}", True)


def speed_unit(column: LogColumn, place: LogColumn, unit: str, step_s: float) -> Unit | None:
    """Return the unit of a speed by that of the position that it is of, or None where they contradict or none fits."""
    factor = slope(column.values, derivative(place.values, step_s))[0]
    if factor <= 0.0:
        return None
    fitting = [
        u for u in SPEEDS if turns(u) == turns(unit) and abs(si_factor(unit) / (factor * si_factor(u)) - 1.0) < FITS
    ]
    if column.unit:
        return Unit(column.unit, column.why) if column.unit in fitting else None
    return Unit(fitting[0], f"it is {factor:.4g} times the derivative of '{place.name}'") if fitting else None


def time_unit(step: float) -> Unit:
    """Return the unit of times by their step: a controller takes 20 us to 50 ms.

    >>> time_unit(0.001).name, time_unit(1.0).name, time_unit(250.0).name
    ('s', 'ms', 'us')
    """
    name = next((u for u in ("s", "ms", "us", "ns") if 2e-5 <= step * si_factor(u) <= 0.05), "s")
    return Unit(name, f"by its step of {step:.4g}", True)


def output(role: Role, is_rotary: bool) -> tuple[str, str, str]:
    """Return the column of the record for the controller's output, its keys in the mapping, and what to check."""
    name = "motor_torque_Nm" if is_rotary else "motor_force_N"
    unit = role.column.unit
    si = si_unit(unit, role.column.name)[0] if unit else ""
    if si == ("N m" if is_rotary else "N"):
        return name, f'unit = "{unit}"', ""
    target = "N m" if is_rotary else "N"
    keys = f'unit = "{unit}", gain = 1.0' if unit else "gain = 1.0"
    unknown = role.column.foreign_unit
    said = f"its unit '{unknown}' is not known here" if unknown else "it has no unit"
    counted = f"1 {si} counts" if unit else f"{said}, and 1 in the file counts"
    geared = "behind a gear times its ratio" if is_rotary else "of a screw N m/A times 2 pi / lead in m"
    gain = {
        "N m": "2 pi / lead in m for the motor of a screw (N/(N m))",
        "A": f"the motor's constant in {target}/A ({geared})",
        "V": f"the drive's constant in {target}/V",
    }.get(si or role.column.spoken_unit, f"what 1 is in {target}")
    check = (
        f"{name}: {counted} as 1 {target} until you give {gain} as gain. Causes and shares do not depend on it, "
        "sizes of masses and forces do. Import the corrected mapping for its model."
    )
    return name, keys, check


def si_factor(unit: str) -> float:
    """Return the factor from a unit to SI."""
    return si_unit(unit, unit)[1]
