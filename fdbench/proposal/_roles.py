"""Which column of a log is the position, the command and the controller's output: by names, else by the data."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fdbench.proposal._data import TOLD, balance, derivative, is_signal, leads, levels, slope
from fdbench.proposal._names import LogColumn
from fdbench.record import FloatArray

# From here on the data say that a column is the derivative of another, or the same quantity.
IS_DERIVATIVE, IS_SAME, IS_ERROR, IS_COMMAND = 0.9, 0.999, 0.99, 0.99
SAME_SIZE, SIZE_OF_COMMAND = 0.05, 0.1  # by which the slope of one over the other may differ from 1


class Role(NamedTuple):
    """A column of the log for a column of the record, without its unit, and why."""

    column: LogColumn
    why: str


def roles(columns: Sequence[LogColumn], step_s: float) -> dict[str, Role]:
    """Return the columns for ``position``, ``reference_position``, ``motor_position``, ``table_position``, ``output``.

    Also ``velocity`` and ``reference_velocity``. What cannot be told is left out.
    """
    signals = [item for item in columns if is_signal(item.values) or _is_staircase(item)]
    if any(item.quantity == "position" for item in signals):
        return _by_names(signals, step_s, "its name says position")
    return _by_data(signals, step_s)


def _by_names(signals: Sequence[LogColumn], step_s: float, is_place: str) -> dict[str, Role]:
    """Return roles by names; ``is_place`` says by what a column is a position."""
    places = [item for item in signals if item.quantity == "position"]
    measured = [item for item in places if not item.is_reference] or places
    found: dict[str, Role] = {}
    for side in ("motor", "table"):
        candidates = [item for item in measured if item.side == side]
        if candidates:
            found[f"{side}_position"] = Role(_farthest(candidates), f"{is_place}, by its name the {side}'s")
    plain = [item for item in measured if not item.side]
    others = f", and it moves farthest of {len(plain)}" if len(plain) > 1 else ""
    if plain:
        found["position"] = Role(_farthest(plain), f"{is_place}{others}")
    else:
        side = "table" if "table_position" in found else "motor"
        found["position"] = Role(found[f"{side}_position"].column, f"the only position is the {side}'s")
        if len(found) > 2:
            found["position"] = Role(found["table_position"].column, "GUESS: the scale of the table closes the loop")
    position = found["position"].column
    commands = [item for item in places if item.is_reference and item is not position]
    if commands:
        near = min(commands, key=lambda item: float(np.std(item.values - position.values)))
        found["reference_position"] = Role(near, f"{is_place}, by its name the commanded one")
    else:
        found |= _command_by_data(signals, position, step_s)
        position = found["position"].column
    speeds = [item for item in signals if item.quantity == "velocity" and not item.side]
    for key, is_reference in (("velocity", False), ("reference_velocity", True)):
        place = found["reference_position"].column if is_reference and "reference_position" in found else position
        moving = derivative(place.values, step_s)
        fits = [(slope(item.values, moving)[1], item) for item in speeds if item.is_reference == is_reference]
        best = max(fits, key=lambda pair: pair[0], default=None)
        if best is not None and best[0] > IS_DERIVATIVE:
            found[key] = Role(
                best[1], f"its name says velocity, and it is the derivative of '{place.name}' ({best[0]:.0%})"
            )
    outputs = _outputs([item for item in signals if item.quantity == "output"], position, step_s)
    commanded = [item for item in outputs if item.is_reference] or outputs
    if commanded:
        return {**found, **_output(commanded, position, step_s, "its name or unit says so")}
    unnamed = [item for item in _left(signals, found, step_s) if not item.quantity]
    unnamed = [item for item in unnamed if _explained(item, position, step_s) > TOLD]
    return {**found, **_output(unnamed, position, step_s, "GUESS: the one that fits a force best")}


def _command_by_data(signals: Sequence[LogColumn], position: LogColumn, step_s: float) -> dict[str, Role]:
    """Return the command where no name says position: a column nearly equal to it, which may turn out to be that.

    Behind a column whose name says that it is commanded, the position may lag.
    """
    commanded = [
        item
        for item in signals
        if item.is_reference
        and not item.quantity
        and _is_same(item.values, position.values, IS_COMMAND, SIZE_OF_COMMAND)
    ]
    if commanded:
        near = min(commanded, key=lambda item: float(np.std(item.values - position.values)))
        return {"reference_position": Role(near, f"its name says commanded, and '{position.name}' follows it")}
    equal = [
        item
        for item in signals
        if item.quantity in ("position", "")
        and not (item.side or position.side or item is position)
        and _is_same(item.values, position.values)
    ]
    if not equal:
        return {}
    near = min(equal, key=lambda item: float(np.std(item.values - position.values)))
    if not near.quantity:
        return {"reference_position": Role(near, f"GUESS: the column nearly equal to '{position.name}'")}
    is_ahead, words = leads(near.values, position.values, step_s)
    command, actual = (near, position) if is_ahead else (position, near)
    return {
        "position": Role(actual, "GUESS: of two nearly equal positions the one that follows"),
        "reference_position": Role(command, f"GUESS: of two nearly equal positions the one that leads ({words})"),
    }


def _by_data(signals: Sequence[LogColumn], step_s: float) -> dict[str, Role]:
    """Return roles where no name says position: positions are nearly equal, speeds are their derivatives.

    Which of them is the command and which side's the others are, names may say.
    """
    moving = [derivative(item.values, step_s) for item in signals]
    parents = [
        {a for a in range(len(signals)) if a != b and slope(item.values, moving[a])[1] > IS_DERIVATIVE}
        for b, item in enumerate(signals)
    ]
    equal = [
        (float(np.ptp(one.values)), a, b)
        for a, one in enumerate(signals)
        for b, other in enumerate(signals[:a])
        if _is_same(one.values, other.values)
        and not (parents[a] or parents[b])
        and "output" not in (one.quantity, other.quantity)
    ]
    if equal:
        _, a, b = max(equal)
        places = [signals[c] for c in sorted({d for _, *pair in equal if {*pair} & {a, b} for d in pair})]
        if any(item.side or item.is_reference for item in places):
            names = {item.name for item in places}
            named = [replace(item, quantity="position") if item.name in names else item for item in signals]
            return _by_names(named, step_s, "by the data a position")
        command, actual, words = _command(places, step_s)
        found = {
            "position": Role(actual, f"by the data: nearly equal to '{command.name}', and follows it"),
            "reference_position": Role(command, f"by the data: nearly equal to '{actual.name}', and {words}"),
        }
    else:
        origins = [a for a in range(len(signals)) if any(a in others for others in parents) and not parents[a]]
        if not origins:
            return {}
        actual = max((signals[a] for a in origins), key=lambda item: float(np.ptp(item.values)))
        found = {"position": Role(actual, "by the data: another column is its derivative")}
    left = _outputs(_left(signals, found, step_s), actual, step_s)
    return {**found, **_output(left, actual, step_s, "by the data")}


def _command(places: Sequence[LogColumn], step_s: float) -> tuple[LogColumn, LogColumn, str]:
    """Return of nearly equal columns the one that leads most others, the one nearest to it, and how it leads."""
    ahead = [sum(leads(one.values, other.values, step_s)[0] for other in places if other is not one) for one in places]
    command = places[int(np.argmax(ahead))]
    followers = [item for item in places if item is not command]
    actual = min(followers, key=lambda item: float(np.std(item.values - command.values)))
    return command, actual, leads(command.values, actual.values, step_s)[1]


def _left(signals: Sequence[LogColumn], found: dict[str, Role], step_s: float) -> list[LogColumn]:
    """Return the columns without a role that are neither a derivative of those with one nor the following error."""
    used = {role.column.name: role.column for role in found.values()}
    actual = found["position"].column.values
    error = found["reference_position"].column.values - actual if "reference_position" in found else 0.0 * actual
    moving = [derivative(item.values, step_s) for item in used.values()]
    return [
        item
        for item in signals
        if item.name not in used
        and all(slope(item.values, speed)[1] <= IS_DERIVATIVE for speed in moving)
        and slope(item.values, error)[1] < IS_ERROR
    ]


def _is_staircase(item: LogColumn) -> bool:
    """Return whether a column may be an output in few steps: by its levels alone it could be a switch or a mode."""
    return item.quantity == "output" and levels(item.values) > 1


def _outputs(candidates: Sequence[LogColumn], position: LogColumn, step_s: float) -> list[LogColumn]:
    """Return the columns that may be the output: of those in few steps the ones that mass and friction explain."""
    return [item for item in candidates if is_signal(item.values) or _explained(item, position, step_s) > TOLD]


def _output(candidates: Sequence[LogColumn], position: LogColumn, step_s: float, why: str) -> dict[str, Role]:
    if not candidates:
        return {}
    share, best = max(((_explained(item, position, step_s), item) for item in candidates), key=lambda pair: pair[0])
    return {"output": Role(best, f"{why}; mass and friction along the motion explain {max(share, 0.0):.0%} of it")}


def _explained(force: LogColumn, position: LogColumn, step_s: float) -> float:
    """Return how much of a force, or of its opposite, mass and friction along the motion explain."""
    return max(balance(sign * force.values, position.values, step_s).explained for sign in (1.0, -1.0))


def _farthest(candidates: Sequence[LogColumn]) -> LogColumn:
    return max(candidates, key=lambda item: float(np.ptp(item.values)))


def _is_same(one: FloatArray, other: FloatArray, alike: float = IS_SAME, size: float = SAME_SIZE) -> bool:
    factor, share = slope(one, other)
    return share > alike and abs(factor - 1.0) < size
