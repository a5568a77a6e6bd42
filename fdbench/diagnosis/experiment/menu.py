"""The menu of motions that may be proposed, within the limits of a drive."""

import math
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.trajectory import Trajectory, from_position, moves, multisine
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.records.spectral_lines import highest_Hz
from fdbench.diagnosis.settings import EXPERIMENT
from fdbench.plants.feed_drive import FeedDrive, Following
from fdbench.record import FloatArray
from fdbench.wording import si_text


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What the motions of a menu keep to.

    Attributes
    ----------
    start_m, stroke_m : float
        Where motions begin and end, and how far the longest ones go from there.
    velocity_m_per_s, acceleration_m_per_s2 : float
    """

    start_m: float
    stroke_m: float
    velocity_m_per_s: float
    acceleration_m_per_s2: float

    @classmethod
    def of(cls, drive: FeedDrive, visited: FloatArray) -> "Limits":
        """Return the limits of a drive about the positions that its records visited.

        The stroke is theirs, or longer where the travel has room wherever its zero is. Half of the greatest force
        accelerates, of that in the records if the controller is not known; the rest is left to friction and control.
        """
        low, high = float(visited.min()), float(visited.max())
        controller = drive.controller
        force_N = controller.greatest_force_N if isinstance(controller, Following) else controller.force_limit_N
        return cls(
            start_m=low,
            stroke_m=max(high - low, EXPERIMENT.used_travel * drive.travel_m - max(abs(low), abs(high))),
            velocity_m_per_s=EXPERIMENT.used_velocity * drive.velocity_limit_m_per_s,
            acceleration_m_per_s2=EXPERIMENT.used_force * (force_N or 0.0) / drive.mass_kg,
        )


def menu(limits: Limits, period_s: float, scale: float = 1.0) -> list[Trajectory]:
    """Return the motions that may be proposed: constant speeds, reversals, multisines, strokes and small sines.

    None has a frequency that the samples would not show.

    One has strokes and multisines of all frequencies, for what nobody thinks of. Ways are ``scale`` times as long as
    those of a usual axis; see `fdbench.diagnosis.model.nominal.Nominal.scale`.
    """
    x, length = limits.start_m, limits.stroke_m
    fastest, hardest = limits.velocity_m_per_s, limits.acceleration_m_per_s2
    middle, gentle = x + 0.5 * length, 0.2 * hardest
    found: list[Trajectory] = []

    def add(kind: str, words: str, reference: FloatArray) -> None:
        _, velocity, acceleration = np.abs(reference).max(axis=0)
        if velocity <= 1.25 * fastest and acceleration <= 2.0 * hardest:
            found.append(Trajectory(kind=kind, words=f"{kind}: {words}", period_s=period_s, reference=reference))

    for share in (0.02, 0.1, 0.4):
        speed = share * fastest
        stroke = min(length, 2.0 * speed)
        reference = moves((x, x + stroke, x, x + stroke, x), (speed,), gentle, period_s)
        add("constant speed", f"{si_text(speed, 'm/s')} both ways over {si_text(stroke, 'm')}, twice", reference)
    for size in (1e-4, 1e-3, 1e-2):
        stroke = min(size, 0.5 * length)
        stops = [middle, *(middle + stroke * part for part in (1.0, 0.2, 0.8, 0.0, 0.5, 0.0))]
        speed = min(max(0.5 * stroke, 1e-4), 0.2 * fastest)
        reference = moves(stops, (speed,), gentle, period_s)
        add("nested reversals", f"within {si_text(stroke, 'm')} at {si_text(speed, 'm/s')}", reference)

    shown_Hz = highest_Hz(period_s)

    def wave(low_Hz: float, high_Hz: float, part: float) -> tuple[str, FloatArray]:
        seen_Hz = min(high_Hz, shown_Hz)
        band_Hz = min(low_Hz, 0.5 * seen_Hz), seen_Hz
        _, speed, acceleration = multisine(0.0, 1.0, band_Hz, 5.0, period_s).std(axis=0)
        rms = min(part * fastest / speed, part * hardest / acceleration, 0.2 * length)
        words = f"{band_Hz[0]:g} to {band_Hz[1]:g} Hz, {si_text(rms, 'm')} rms"
        return words, multisine(middle, rms, band_Hz, 5.0, period_s)

    for low_Hz, high_Hz, part in ((0.5, 10.0, 0.3), (1.0, 60.0, 0.1), (1.0, 60.0, 0.3), (10.0, 150.0, 0.1)):
        if low_Hz < 0.5 * shown_Hz:
            add("multisine", *wave(low_Hz, high_Hz, part))
    stops = [x + length * share for share in (0.0, 0.6, 0.1, 0.4, 0.0, 0.5)]
    strokes = moves(stops, (fastest,), 0.8 * hardest, period_s)
    (slow, slowly), (quick, quickly) = wave(0.5, 10.0, 0.3), wave(1.0, 150.0, 0.3)
    words = f"up to {si_text(0.6 * length, 'm')} at {si_text(0.8 * hardest, 'm/s^2')}, then {slow}, then {quick}"
    add("strokes and multisine", words, np.concatenate((strokes, slowly, quickly)))
    for part in (0.3, 0.8):
        stops = [x + length * share for share in (0.0, 0.6, 0.1, 0.4, 0.0)]
        reference = moves(stops, (fastest,), part * hardest, period_s)
        add("fast strokes", f"up to {si_text(0.6 * length, 'm')} at {si_text(part * hardest, 'm/s^2')}", reference)
    speed = 0.25 * fastest
    add(
        "long strokes",
        f"{si_text(length, 'm')} at {si_text(speed, 'm/s')} both ways, four times",
        moves([x, *([x + length, x] * 4)], (speed,), gentle, period_s),
    )
    time = np.arange(round(5.0 / period_s)) * period_s
    fade = np.clip(np.minimum(time, time[-1] - time) / EXPERIMENT.fade_s, 0.0, 1.0)
    for size, frequency in ((2e-5 * scale, 2.0), (2e-4 * scale, 2.0), (2e-4 * scale, 10.0)):
        position = middle + size * np.sin(2.0 * math.pi * frequency * time) * fade**2 * (3.0 - 2.0 * fade)
        add("sine", f"{si_text(size, 'm')} at {frequency:g} Hz about one place", from_position(position, period_s))
    return found


def menu_of(split: Split, nominal: Nominal) -> list[Trajectory]:
    """Return the menu about the positions that the records visited, with their clock; empty without room or force."""
    visited = np.concatenate([run.reference[:, 0] for run in split.runs])
    limits = Limits.of(nominal.drive, visited)
    possible = min(limits.stroke_m, limits.acceleration_m_per_s2) > 0.0
    return menu(limits, split.runs[0].period_s, nominal.scale.length) if possible else []
