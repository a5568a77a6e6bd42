"""A model of an axis from the result of SINUMERIK's Automatic Servo Tuning, and the response that was measured."""

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fdbench.errors import RecordError, printable
from fdbench.reading.servo_tuning import ServoTuning, read_servo_tuning
from fdbench.rotary import rotary_name

ELASTIC_WITHIN = 0.1  # of the resonance that antiresonance and inertias give, by which the measured one may differ
DAMPING_RATIO = 0.02  # of the elastic part, where nothing says more
COHERENT = 0.9
FILL_IN = "travel_m", "velocity_limit_m_per_s"


@dataclass
class TunedModel:
    """The model file, the response as CSV, and what is said about them."""

    model: str
    response: str
    axis: str
    found: list[str] = field(default_factory=list)
    to_do: list[str] = field(default_factory=list)


def of_tuning(file: Path) -> TunedModel:
    r"""Return a model of the axis whose tuning was saved.

    With g, turns of the motor for one unit of the way of the axis, m = J g^2 and F = T g. Two masses where the
    measurement shows them: of inertias J_m and J - J_m with an antiresonance at f_0, k = (J - J_m) (2 pi f_0)^2 and a
    resonance at f_0 sqrt(J / J_m); see Groß, Hamann, Wiegärtner (2006), Technik elektrischer Vorschubantriebe.

    Raises
    ------
    RecordError
        If the file is damaged, or no model of a feed drive fits it.
    """
    tuning = read_servo_tuning(file)
    if tuning.axis_is_rotary and not tuning.motor_is_rotary:
        raise RecordError(f"{file}: a linear motor that turns an axis; no model of that is known.")
    return _Writer(tuning, file.name).written()


class _Writer:
    """Writes the tables of the model; quantities of a rotary axis are those of its arc, renamed at the end."""

    def __init__(self, tuning: ServoTuning, name: str) -> None:
        self._own, self._name = tuning, name
        self._gear = 1.0 / tuning.way_per_motor_way if tuning.motor_is_rotary else 1.0
        self._is_rotary = tuning.axis_is_rotary
        self._found: list[str] = []
        self._to_do: list[str] = []

    def written(self) -> TunedModel:
        tables = [*self._head(), *self._mechanics(), *self._controller(), *self._tail()]
        self._to_do.insert(0, f"FILL IN {' and '.join(map(self._called, FILL_IN))}: they are not in the file.")
        said = [f"# {' '.join(printable(line).split())}" for line in (*self._found, *self._to_do)]
        model = "\n".join([*said, "", *tables]) + "\n"
        axis = "rotary" if self._is_rotary else "linear"
        return TunedModel(model, self._response(), axis, self._found, self._to_do)

    def _called(self, name: str) -> str:
        return rotary_name(name) if self._is_rotary else name

    def _entry(self, name: str, value: float, note: str = "") -> str:
        return f"{self._called(name)} = {float(value):.6g}" + (f"  # {note}" if note else "")

    def _head(self) -> list[str]:
        own = self._own
        self._found.append(
            f"from the Automatic Servo Tuning of axis {own.axis} of {own.machine}: inertias, friction, constant, gains"
        )
        lines = ['axis = "rotary"', ""] if self._is_rotary else []
        unit = "1 rad" if self._is_rotary else "1 m"
        return [
            *lines,
            "[plant]",
            'kind = "feed_drive"',
            self._entry("travel_m", 1.0, f"FILL IN; {unit} stands for it"),
            self._entry("velocity_limit_m_per_s", 1.0, "FILL IN"),
            "",
        ]

    def _mechanics(self) -> list[str]:
        own, gear = self._own, self._gear
        load = own.total_inertia - own.motor_inertia
        stiffness = self._stiffness(load)
        inertia = own.motor_inertia if stiffness is not None else own.total_inertia
        viscous = self._entry("viscous_friction_N_s_per_m", own.viscous_damping * gear**2, "all of it")
        lines = ["[plant.motor]"]
        if own.motor_is_rotary:
            kind = "geared_motor" if self._is_rotary else "rotary_motor"
            lead = f"gear_ratio = {gear:.9g}" if self._is_rotary else f"lead_m = {2.0 * math.pi / gear:.9g}"
            lines += [f'kind = "{kind}"', f"inertia_kg_m2 = {inertia:.6g}", lead, viscous]
            constant = "torque_constant_Nm_per_A"
        else:
            lines += ['kind = "linear_motor"', f"mass_kg = {inertia:.6g}", viscous]
            constant = "force_constant_N_per_A"
        if own.force_per_A is not None:
            lines.append(f"# {constant} = {own.force_per_A:.6g}  # for records of motor_current_A")
            self._found.append(f"{constant} = {own.force_per_A:.6g}, as a comment: a model with it logs currents")
        lines.append("")
        if stiffness is not None:
            damping = 2.0 * DAMPING_RATIO * math.sqrt(stiffness * own.motor_inertia * load / own.total_inertia)
            table, screw = ("load", "shaft") if self._is_rotary else ("table", "screw")
            lines += [f"[plant.{table}]", self._entry("mass_kg", load * gear**2)]
            lines += [self._entry("viscous_friction_N_s_per_m", 0.0), "", f"[plant.{screw}]"]
            lines += [self._entry("stiffness_N_per_m", stiffness * gear**2)]
            lines += [self._entry("damping_N_s_per_m", damping * gear**2, f"GUESS: a ratio of {DAMPING_RATIO}"), ""]
        return lines

    def _stiffness(self, load: float) -> float | None:
        """Return the stiffness between motor and load, on the motor's side; None where two masses do not fit."""
        own = self._own
        if own.zero_Hz is None or own.pole_Hz is None or not 0.0 < own.motor_inertia < own.total_inertia:
            self._found.append("rigid: the file has no resonance, or no inertia of the motor alone")
            return None
        expected_Hz = own.zero_Hz * math.sqrt(own.total_inertia / own.motor_inertia)
        words = f"antiresonance {own.zero_Hz:.4g} Hz, resonance {own.pole_Hz:.4g} Hz"
        if not abs(own.pole_Hz / expected_Hz - 1.0) < ELASTIC_WITHIN:
            self._to_do.append(f"CHECK the model is rigid: {words}, but two masses would have {expected_Hz:.4g} Hz.")
            return None
        self._found.append(f"two masses: {words}, of which the inertias give {expected_Hz:.4g} Hz")
        self._to_do.append(f"CHECK the damping between them: a ratio of {DAMPING_RATIO} is a guess.")
        return float(load * (2.0 * math.pi * own.zero_Hz) ** 2)

    def _controller(self) -> list[str]:
        own, gear = self._own, self._gear
        if own.velocity_gain is None or own.position_gain_per_s is None:
            self._to_do.append("FILL IN the controller, which the file does not have, or leave it out.")
            return []
        integral = own.velocity_gain / own.integral_time_s if own.integral_time_s else 0.0
        self._to_do.append(
            "FILL IN the table [plant.controller], and take its # away, where records are of its cycle: its force "
            "limit and the kind of feed-forward are not in the file."
        )
        for words in own.filters:
            self._to_do.append(f"CHECK the filter of the current set-point, which no model here has: {words}.")
        entries = [
            "[plant.controller]",
            'kind = "cascade"',
            self._entry("position_gain_per_s", own.position_gain_per_s, "Kv, which is taken to be in 1000/min"),
            self._entry("velocity_gain_N_s_per_m", own.velocity_gain * gear**2),
            self._entry("integral_gain_N_per_m", integral * gear**2),
            "velocity_feedforward = 1.0",
            self._entry("acceleration_feedforward_kg", 0.0),
            f"{self._called('force_limit_N')} =",
            'feedback = "motor"',
            "difference_span = 1",
        ]
        return [*(f"# {line}" for line in entries), ""]

    def _tail(self) -> list[str]:
        return ["[simulation]", "substeps = 10", "", "[uncertainty]", "mass = 0.1", "viscous = 0.5"]

    def _response(self) -> str:
        """Return position over force of the axis, at the motor: the measured speed over torque, integrated."""
        own = self._own
        kept = own.frequency_Hz >= own.usable_from_Hz
        if own.coherence is not None:
            kept &= own.coherence >= COHERENT
        if kept.sum() < 2:
            self._found.append("no measured response: it is coherent at fewer than 2 frequencies")
            return ""
        at_Hz = own.frequency_Hz[kept]
        place = own.response[kept] / (2j * np.pi * at_Hz) / self._gear**2
        rows = zip(at_Hz, np.abs(place), np.degrees(np.unwrap(np.angle(place))), strict=True)
        lines = [f"frequency_Hz,{'magnitude_rad_per_Nm' if self._is_rotary else 'magnitude_m_per_N'},phase_deg"]
        lines += [f"{frequency:.9g},{magnitude:.9g},{phase:.6f}" for frequency, magnitude, phase in rows]
        self._found.append(f"the measured response of the mechanics at {len(at_Hz)} frequencies")
        return "\n".join(lines) + "\n"
