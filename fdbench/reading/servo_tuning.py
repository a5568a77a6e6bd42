"""Results of SINUMERIK's Automatic Servo Tuning: inertia, constants, controllers and the measured mechanics, as XML."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.reading.formats._cells import number_in
from fdbench.reading.formats._text import in_utf_8
from fdbench.reading.formats._xml import parse_xml, xml_parser
from fdbench.record import FloatArray

LARGEST_BYTES = 2**26
DEEPEST = 64  # elements within one another
MOST_VALUES = 2**20  # of an array
LARGEST = 1e12  # number
ROOT = b"<DynamicModelAxisController"
_DIGITS = {
    digit: value
    for value, digit in enumerate(
        "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"
    )
}
_IN_OPERATION = 2  # number of the controller that is in operation; 1 is the one before, 7 the one that was computed
KV_PER_S = 1000.0 / 60.0  # gain of the position controller, which SINUMERIK counts in 1000/min


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoTuning:
    r"""What the file says, on the side of the motor: rad, N m and kg m^2, or m, N and kg of a linear motor.

    Parameters
    ----------
    axis, machine : str
    motor_is_rotary, axis_is_rotary : bool
    way_per_motor_way : float
        Way of the axis, m or rad, for 1 rad or m of the motor.
    motor_inertia, total_inertia, viscous_damping : float
        kg m^2 and N m s/rad, or kg and N s/m.
    force_per_A : float or None
        N m/A or N/A.
    position_gain_per_s, velocity_gain, integral_time_s : float or None
        Of the controllers in operation: 1/s, N m s/rad or N s/m, s.
    filters : tuple of str
        Filters of the current set-point that are switched on.
    zero_Hz, pole_Hz : float or None
        First antiresonance and resonance of the mechanics.
    usable_from_Hz : float
        From here on the measurement counts.
    frequency_Hz, response, coherence : (n,) array
        Speed over torque of the motor, (rad/s)/(N m) or (m/s)/N.
    """

    axis: str
    machine: str
    motor_is_rotary: bool
    axis_is_rotary: bool
    way_per_motor_way: float
    motor_inertia: float
    total_inertia: float
    viscous_damping: float
    force_per_A: float | None
    position_gain_per_s: float | None
    velocity_gain: float | None
    integral_time_s: float | None
    filters: tuple[str, ...]
    zero_Hz: float | None
    pole_Hz: float | None
    usable_from_Hz: float
    frequency_Hz: FloatArray
    response: NDArray[np.complex128]
    coherence: FloatArray | None


def is_servo_tuning(head: bytes) -> bool:
    """Return whether a file that begins so is a result of Automatic Servo Tuning."""
    return ROOT in in_utf_8(head)


def read_servo_tuning(file: Path) -> ServoTuning:
    """Read what Automatic Servo Tuning saves (Setup, Optimization, Save result).

    Siemens does not publish the layout. It is taken from one such file (a spindle; SAT version 4.96.0.0.1,
    eliasrhoden/Sinumerik-Ctrl) and from the reader of the same author (eliasrhoden/Trace-Tools). Units are those in
    which the file agrees with itself: below its first antiresonance the response is 1 over inertia times circular
    frequency, and the first resonance follows from the antiresonance and both inertias. The samples in the tests are
    written after that file, not by a SINUMERIK.

    Raises
    ------
    RecordError
        If the file is damaged, holds several axes, or lacks a value that a model needs.
    """
    if file.stat().st_size > LARGEST_BYTES:
        raise RecordError(f"{file}: larger than {LARGEST_BYTES} bytes; a result of Automatic Servo Tuning is smaller.")
    root = _tree(file)
    try:
        return _tuning(root)
    except (ValueError, OverflowError) as error:
        raise RecordError(f"{file}: a result of Automatic Servo Tuning, or a damaged one: {error}.") from error


@dataclass
class _Node:
    """An element: its tag, its attributes ``name`` and ``format``, its text and what is in it."""

    tag: str
    name: str = ""
    format: str = ""
    text: list[str] = field(default_factory=list)
    inner: list["_Node"] = field(default_factory=list)

    def all(self) -> Iterator["_Node"]:
        """Yield this element and those in it, in their order."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting += reversed(node.inner)

    def first(self, *names: str) -> "_Node | None":
        """Return the first element of such a tag or name."""
        return next((node for node in self.all() if node.tag in names or node.name in names), None)

    def value(self, name: str) -> str:
        """Return the text of an element directly in this one."""
        for node in self.inner:
            if node.name == name:
                return "".join(node.text).strip()
        raise ValueError(f"<{self.tag}> has no {name}")

    def number(self, name: str, low: float = -LARGEST, high: float = LARGEST) -> float:
        """Return a number directly in this element."""
        number = number_in(self.value(name))
        if not low <= number <= high:
            raise ValueError(f"{name} is {number:g}; {low:g} to {high:g} is read")
        return number

    def truth(self, name: str) -> bool:
        """Return a truth value directly in this element."""
        word = self.value(name)
        if word not in ("true", "false"):
            raise ValueError(f"{name} is '{word}', not true or false")
        return word == "true"


def _tree(file: Path) -> _Node:
    parser = xml_parser(file)
    parser.buffer_text = True
    stack = [_Node("")]

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) > DEEPEST:
            raise RecordError(f"{file}: elements nested more than {DEEPEST} deep.")
        node = _Node(tag, attributes.get("name", ""), attributes.get("format", ""))
        stack[-1].inner.append(node)
        stack.append(node)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.CharacterDataHandler = lambda text: stack[-1].text.append(text)
    parse_xml(parser, file)
    return stack[0].inner[0]


def _tuning(root: _Node) -> ServoTuning:
    drives = [node for node in root.all() if node.tag.startswith("DynamicModelSpeedController")]
    if len(drives) != 1:
        raise ValueError(f"{len(drives)} speed controllers; one is read")
    (drive,) = drives
    axis = next((node for node in root.all() if node.tag.startswith("DynamicModelPositionController840")), None)
    if axis is None:
        raise ValueError("no position controller")
    is_rotary = drive.truth("m_bMotorIsRotary")
    total = drive.number("m_dTotalInertia", 1e-12, 1e9)
    plant, usable_from_Hz = _response(drive, "m_pPlant"), drive.number("m_dMinUsableMechPlantFrequency", 0.0, 1e6)
    if plant is None:
        raise ValueError("no measured response of the mechanics")
    frequency_Hz, response = plant
    coherence = _response(drive, "m_pMeasCoherence")
    source = root.first("ExcitationSource")
    constant = source.number("m_dMotorForceConstant", 0.0) if source is not None else 0.0
    speed = _in_operation(drive.first("m_listpSpeedLoopRegulators"))
    place = _in_operation(axis.first("m_listpPositionLoopRegulators"))
    zeros, poles = (_array(drive.first(name)) for name in ("m_estimatedMechZeros", "m_estimatedMechPoles"))
    integral_s = speed.number("m_dIntegralTime", 0.0, 1e6) if speed else 0.0
    return ServoTuning(
        axis=axis.value("m_szAxisName"),
        machine=root.value("m_szPlatformName"),
        motor_is_rotary=is_rotary,
        axis_is_rotary=axis.truth("m_bAxisIsRotary"),
        way_per_motor_way=axis.number("m_dAxisDistPerMotorDistUnitsMetersAndRadians", 1e-9, 1e6),
        motor_inertia=drive.number("m_dMotorInertia", 0.0, total),
        total_inertia=total,
        viscous_damping=drive.number("m_dViscousCoeff", 0.0),
        force_per_A=constant or None,
        position_gain_per_s=KV_PER_S * place.number("m_Kv", 0.0, 1e6) if place else None,
        velocity_gain=speed.number("m_dKpGain", 0.0) if speed else None,
        integral_time_s=integral_s or None,
        filters=tuple(_filters(speed.first("m_CurrentFilters") if speed else None)),
        zero_Hz=float(zeros[0]) if len(zeros) else None,
        pole_Hz=float(poles[0]) if len(poles) else None,
        usable_from_Hz=usable_from_Hz,
        frequency_Hz=frequency_Hz,
        response=response,
        coherence=np.abs(coherence[1]) if coherence is not None and len(coherence[1]) == len(response) else None,
    )


def _in_operation(regulators: _Node | None) -> _Node | None:
    """Return the controller that is in operation, or else the last one."""
    found = [node for node in regulators.all() if node.tag.endswith("LoopRegulator")] if regulators else []
    return next(
        (node for node in found if node.number("m_uRegulatorID") == _IN_OPERATION), found[-1] if found else None
    )


def _filters(filters: _Node | None) -> Iterator[str]:
    for node in filters.all() if filters else ():
        if not node.tag.endswith("Filter") or not node.truth("m_bFilterIsEnabled"):
            continue
        values = [
            f"{item.name.removeprefix('m_')} {number_in(''.join(item.text).strip()):.6g}"
            for item in node.inner
            if item.tag == "float" and item.name.startswith(("m_Num", "m_Den", "m_Freq", "m_Damp", "m_dTimeConst"))
        ]
        yield f"{node.tag}: {', '.join(values)}"


def _response(drive: _Node, name: str) -> tuple[FloatArray, NDArray[np.complex128]] | None:
    """Return frequencies, Hz, and values of a response, or None."""
    node = next((item for item in drive.all() if item.tag == "FrequencyResponseFunction" and item.name == name), None)
    if node is None:
        return None
    parts, at_Hz = _array(node.first("m_ValueVector")), _array(node.first("m_FrequencyVector"))
    if len(parts) != 2 * len(at_Hz) or len(at_Hz) < 2:
        raise ValueError(f"{name} has {len(parts)} parts of complex values at {len(at_Hz)} frequencies")
    if not np.isfinite(parts).all() or not (np.diff(at_Hz) > 0.0).all() or not 0.0 < at_Hz[0] <= at_Hz[-1] <= LARGEST:
        raise ValueError(f"{name} has values that are no numbers, or frequencies that do not increase from above 0")
    return at_Hz, parts[0::2] + 1j * parts[1::2]


def _array(node: _Node | None) -> FloatArray:
    """Return the numbers of a ``NumericArray``; those in base 85 are doubles of two words, the most significant first.

    A word has five digits, or is a point where it is 0.
    """
    raw = node.first("raw") if node else None
    if node is None or raw is None:
        return np.zeros(0)
    text = "".join("".join(raw.text).split())
    if len(text) > 10 * MOST_VALUES:
        raise ValueError(f"{node.name} is longer than {MOST_VALUES} values")
    if node.format == "CSV":
        return np.array([number_in(cell) for cell in text.split(",") if cell])
    words, place = [], 0
    while place < len(text):
        word, size = 0, 1 if text[place] == "." else 5
        for digit in text[place : place + size] if size == 5 else "":
            if digit not in _DIGITS:
                raise ValueError(f"{node.name} holds {digit!r}, no digit of base 85")
            word = 85 * word + _DIGITS[digit]
        if word >= 2**32 or place + size > len(text):
            raise ValueError(f"{node.name} holds what is no word of base 85")
        words.append(word)
        place += size
    if len(words) % 2:
        raise ValueError(f"{node.name} ends within a number")
    return np.array(struct.unpack(f">{len(words) // 2}d", struct.pack(f">{len(words)}I", *words)))
