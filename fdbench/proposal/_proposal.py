"""The proposal: what was found in a log, why, what is left to fill in, and the files that say so."""

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fdbench.documents import toml_tables
from fdbench.errors import FdbenchError, RecordError, printable
from fdbench.json_text import toml_value
from fdbench.proposal._clock import Clock
from fdbench.proposal._data import balance, is_signal, levels
from fdbench.proposal._names import LogColumn, column, turns
from fdbench.proposal._roles import Role, roles
from fdbench.proposal._sides import position_entry, second_position
from fdbench.proposal._units import output, position_unit, speed_unit
from fdbench.reading import read_mapped, read_record
from fdbench.reading.formats import Format
from fdbench.record import Record
from fdbench.rotary import LINEAR, ROTARY, rotary_name, words_of_rotary

NEEDED = {"position": "the position", "output": "the controller's output (force, torque, current or voltage)"}
SKELETON = Path(__file__).with_name("model.toml")


@dataclass
class Proposal:
    """A mapping for a log, and what is said about it.

    Attributes
    ----------
    mapping : str
        The mapping file.
    found, left_out, to_do : list of str
        What was guessed and why; columns that are not used; what the user has to check or fill in.
    record : Record or None
        What the mapping reads; None where something needed was not found.
    axis : str
        ``linear`` or ``rotary``.
    format : str
        Format of the log; empty where a mapping was given.
    lines : list of str
        The lines of [columns] in the mapping.
    """

    mapping: str = ""
    found: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    to_do: list[str] = field(default_factory=list)
    record: Record | None = None
    axis: str = LINEAR
    format: str = ""
    lines: list[str] = field(default_factory=list)

    def model(self, files: Sequence[str]) -> str:
        """Return a first model of the axis, without its controller, by the record."""
        if self.record is None:
            raise RecordError("no record to make a model of.")
        read, is_rotary = self.record, self.axis == ROTARY
        position, force = (read[rotary_name(name) if is_rotary else name] for name in ("position_m", "motor_force_N"))
        found = balance(force, position, read.sampling_time_s)
        spread = float(np.std(force)) or 1.0
        fastest = found.fastest or 1.0
        least = 1e-3 * spread
        text = SKELETON.read_text("utf-8").format(
            files=", ".join(files),
            travel=f"{2.0 * float(np.abs(position).max()) or 1.0:.4g}",
            fastest=f"{2.0 * fastest:.4g}",
            mass=f"{max(found.mass, least / fastest):.4g}",
            viscous=f"{found.viscous:.4g}",
            coulomb=f"{max(found.coulomb, least):.4g}",
            transition=f"{min(1e-3, 0.02 * fastest):.4g}",
            offset=f"{found.offset:.4g}",
        )
        if is_rotary:
            text = words_of_rotary(text).replace("[plant]\n", 'axis = "rotary"\n\n[plant]\n', 1)
            text = text.replace('"linear_motor"', '"torque_motor"')
        return text


def of_mapping(file: Path) -> Proposal:
    """Return a proposal of a model alone, from a mapping that stands.

    Raises
    ------
    RecordError
        If the mapping or its log is at fault, or gives no force in newtons, or torque of a rotary axis.
    """
    record = read_record(file)
    axis = ROTARY if "position_rad" in record else LINEAR
    needed = [name if axis == LINEAR else rotary_name(name) for name in ("position_m", "motor_force_N")]
    missing = [name for name in needed if name not in record]
    if missing:
        raise RecordError(f"{file}: no column {missing[0]}, of which a first model is made. Map one, with its gain.")
    return Proposal(record=record, axis=axis)


def propose(file: Path, kind: type[Format], mapping: Path, sampling_time_s: float | None = None) -> Proposal:
    """Return a mapping for a log, from names, units and a look at the data, which stay as they are.

    Parameters
    ----------
    file : path
        The log.
    kind : type of Format
        Its format.
    mapping : path
        Where the mapping will lie; its folder counts.
    sampling_time_s : float or None
        Sampling time, where the log has no times.

    Raises
    ------
    RecordError
        If the file is damaged, has no columns of numbers, or no sampling time where none is given.
    """
    reader, raw = kind.survey(file)
    clock = Clock(raw, kind, sampling_time_s, file)
    whole = clock.whole
    columns = [
        column(
            name,
            values[whole.start : whole.stop],
            raw.units.get(name, ""),
            raw.labels.get(name, ""),
            raw.clocks.get(name, ""),
        )
        for name, values in clock.columns.items()
    ]
    found = roles(columns, clock.step_s)
    found |= second_position(columns, found, clock.step_s)
    proposal = Proposal(found=[*clock.found, *raw.notes], to_do=[*clock.to_do], format=kind.name)
    settings: dict[str, object] = {"file": os.path.relpath(file, mapping.parent), "format": kind.name}
    if dataclasses.is_dataclass(reader):
        keys = dataclasses.fields(reader)
        settings |= {key.name: getattr(reader, key.name) for key in keys if getattr(reader, key.name) != key.default}
    chosen = [role.column for role in found.values()]
    time_lines, time_settings = clock.mapped(chosen, proposal.found, proposal.to_do)
    proposal.lines = time_lines + _columns(found, clock.step_s, kind, proposal)
    used = {role.column.name for role in found.values()} | clock.times
    unused = [item for item in columns if item.name not in used]
    proposal.left_out += [_unused(item) for item in unused]
    proposal.left_out += [f"'{name}': no numbers, empty cells, or too slow" for name in clock.left_out]
    missing = [words for key, words in NEEDED.items() if key not in found]
    proposal.to_do += [f"NOT FOUND: {words}. Name its column in the mapping." for words in missing]
    if "reference_position" not in found and "position" in found:
        proposal.to_do.append(
            "NOT FOUND: the commanded position. A diagnosis works without, but sees less: log it where you can."
        )
    if not missing:
        said = len(clock.found)
        stretch, length = clock.samples(used, found["position"].column.name)
        proposal.found += clock.found[said:]
        if len(stretch) < length:
            time_settings["samples"] = [stretch.start, stretch.stop]
            proposal.found.append(
                f"samples: {stretch.start} to {stretch.stop - 1} of {length}, the longest part without "
                "lost samples and values that are no numbers"
            )
    proposal.mapping = _mapping_text(proposal, settings | time_settings)
    if not missing:
        try:
            proposal.record = read_mapped(toml_tables(proposal.mapping), mapping.parent, str(mapping))
        except (FdbenchError, ValueError) as error:
            proposal.to_do.append(f"The mapping does not read yet: {error}")
    return proposal


def _columns(found: dict[str, Role], step_s: float, kind: type[Format], proposal: Proposal) -> list[str]:
    """Return the lines of [columns] but the time's, and say what was found."""
    lines: list[str] = []
    if "position" not in found:
        return lines
    position = found["position"].column
    command = found.get("reference_position", found["position"]).column
    places = {"reference_velocity": command, "velocity": position}
    speeds = [(found[key].column, place) for key, place in places.items() if key in found]
    unit = position_unit(position, speeds, step_s, kind.usual_position_unit)
    proposal.axis = ROTARY if turns(unit.name) else LINEAR
    if unit.is_guess:
        proposal.to_do.append(
            f"CHECK the unit of the positions: {unit.name} is a guess. Counts of an encoder: write gain, what 1 is in "
            f"{'rad' if proposal.axis == ROTARY else 'm'}, in place of unit."
        )

    def add(target: str, role: Role, keys: str, why: str, check: str = "") -> None:
        name = rotary_name(target) if proposal.axis == ROTARY else target
        lines.append(f"{name} = {{ from = {toml_value(role.column.name)}, {keys} }}")
        proposal.found.append(f"{name} is '{role.column.name}': {role.why}; {why}")
        if role.why.startswith("GUESS"):
            reason = role.why.removeprefix("GUESS: ").split(";")[0]
            proposal.to_do.append(f"CHECK {name}: {reason} is a guess.")
        proposal.to_do += [f"CHECK {name}: {check}"] if check else []

    for key in ("reference_position", "position", "motor_position", "table_position"):
        if key in found:
            add(f"{key}_m", found[key], *position_entry(key, found, unit))
    for key, place in places.items():
        if key in found:
            speed = speed_unit(found[key].column, place, place.unit or unit.name, step_s)
            if speed is None or turns(speed.name) != turns(unit.name):
                proposal.left_out.append(
                    f"'{found[key].column.name}': no unit makes it the derivative of '{place.name}'"
                )
            else:
                add(f"{key}_m_per_s", found[key], f'unit = "{speed.name}"', f"in {speed.name}: {speed.why}")
    if "output" in found:
        role = found["output"]
        name, keys, check = output(role, proposal.axis == ROTARY)
        explained = [balance(sign * role.column.values, position.values, step_s).explained for sign in (1.0, -1.0)]
        if explained[1] > explained[0]:
            keys = keys.replace("gain = 1.0", "gain = -1.0") if "gain" in keys else f"{keys}, gain = -1.0"
            proposal.to_do.append(f"CHECK the sign of {name}: only with gain = -1.0 does mass resist acceleration.")
        add(name, role, keys, f"in {role.column.unit}: {role.column.why}" if role.column.unit else "without a unit")
        proposal.to_do += [f"CHECK {check}"] if check else []
    return lines


def _unused(item: LogColumn) -> str:
    words = {
        "error": "a following error, which position and command contain",
        "": "its name says nothing that is needed",
    }
    if item.quantity == "output" and levels(item.values) > 1 and not is_signal(item.values):
        return f"'{item.name}': a few values, as of a switch or a mode, which mass and friction do not explain"
    if item.quantity in NEEDED and not is_signal(item.values):
        return f"'{item.name}': in the part that is whole, {len(item.values)} samples, it hardly changes"
    return f"'{item.name}': {words.get(item.quantity, f'another {item.quantity}, not needed')}"


def _mapping_text(proposal: Proposal, settings: dict[str, object]) -> str:
    said = [*proposal.found, *proposal.to_do]
    head = [
        "# Proposed by `fdbench import`; correct what is wrong.",
        *(f"# {' '.join(printable(line).split())}" for line in said),
        "",
    ]
    record = [f"{key} = {toml_value(value)}" for key, value in settings.items()]
    return "\n".join([*head, "[record]", *record, "", "[columns]", *proposal.lines, ""])
