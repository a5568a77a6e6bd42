"""Positions of motor and table: a column that is the position again, and its scale."""

from collections.abc import Sequence

from fdbench.proposal._data import is_copy, is_signal, leads, slope
from fdbench.proposal._names import LogColumn, turns
from fdbench.proposal._roles import IS_SAME, SAME_SIZE, Role
from fdbench.proposal._units import Unit, si_factor

OTHER_SIDE = {"motor": "table", "table": "motor"}
MOTORS_ANGLE = (
    "the motor's angle counts as the axis's. Behind a gear give each position 1 / its ratio as gain, and the torque "
    "its ratio, too, or the model a geared_motor; of a screw name it position_m, with lead in m / (2 pi) as gain."
)


def second_position(columns: Sequence[LogColumn], found: dict[str, Role], step_s: float) -> dict[str, Role]:
    """Return what lacks of ``motor_position`` and ``table_position``, where a second column is the position again.

    They are guesses: the two columns differ by gain, offset and little else. Of several commands the second column may
    be another axis, and nothing is returned.
    """
    sides = [role.column for key, role in found.items() if key in ("motor_position", "table_position")]
    several = sum(item.is_reference and item.quantity == "position" for item in columns) > 1
    if "position" not in found or len(sides) == 2 or several:
        return {}
    position, used = found["position"].column, {role.column.name for role in found.values()}
    unused = [item for item in columns if item.name not in used and is_signal(item.values)]
    again = [item for item in (*sides, *unused) if item is not position and _is_again(item, position)]
    if not again:
        return {}
    second = max(again, key=lambda item: slope(item.values, position.values)[1])
    side, why = _side(second, position, step_s)
    guesses = {
        f"{side}_position": Role(second, f"GUESS: '{position.name}' but for a little, the {side}'s {why}"),
        f"{OTHER_SIDE[side]}_position": Role(position, f"GUESS: beside '{second.name}' the {OTHER_SIDE[side]}'s"),
    }
    return {key: role for key, role in guesses.items() if key not in found}


def _is_again(item: LogColumn, position: LogColumn) -> bool:
    is_free = not item.side or item.side != position.side
    may_be = item.quantity in ("position", "") and not item.is_reference and is_free
    return may_be and slope(item.values, position.values)[1] > IS_SAME and not is_copy(item.values, position.values)


def _side(second: LogColumn, position: LogColumn, step_s: float) -> tuple[str, str]:
    """Return the side of the second position: by the names, else the motor's is the one that leads."""
    if second.side or position.side:
        return second.side or OTHER_SIDE[position.side], "by the names"
    scaled = position.values.mean() + slope(position.values, second.values)[0] * (second.values - second.values.mean())
    is_ahead, words = leads(scaled, position.values, step_s)
    return ("motor", f"as {words}") if is_ahead else ("table", f"as '{position.name}' is the motor's: {words}")


def position_entry(key: str, found: dict[str, Role], unit: Unit) -> tuple[str, str, str]:
    """Return the keys of a position in the mapping, what its unit is and why, and what to check of its gain.

    Parameters
    ----------
    key : str
        Of ``found``.
    found : dict of str to Role
    unit : Unit
        That of ``position``.
    """
    item, position = found[key].column, found["position"].column
    own, why = (item.unit, item.why) if item.unit else (unit.name, unit.why)
    keys, words = f'unit = "{own}"', f"in {own}: {why}"
    if item is position:
        is_motors_alone = item.side == "motor" and turns(own) and "table_position" not in found
        if not is_motors_alone:
            return keys, words, ""
        return f"{keys}, gain = 1.0", words, MOTORS_ANGLE if key == "position" else ""
    factor, share = slope(position.values, item.values)
    gain = float(f"{factor * si_factor(unit.name) / si_factor(own):.4g}")
    is_of_size = share > IS_SAME and abs(gain - 1.0) < SAME_SIZE
    if turns(own) == turns(unit.name) and (is_of_size or key == "reference_position"):
        return keys, words, ""
    of = "1 / the gear's ratio" if turns(unit.name) else "of the angle of a screw, lead in m / (2 pi)"
    if share <= IS_SAME:
        return f"{keys}, gain = 1.0", words, f"it does not follow '{position.name}', so that its gain is open: {of}"
    check = f"its gain is a guess, by which it is '{position.name}' again. Give the true one: {of}"
    return f"{keys}, gain = {gain!r}", words, check
