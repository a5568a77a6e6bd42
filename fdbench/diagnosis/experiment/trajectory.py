"""Trajectories: commands that a drive can follow, jerk-limited moves and multisines among them."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fdbench.diagnosis.answer.experiment import Experiment
from fdbench.diagnosis.settings import EXPERIMENT
from fdbench.motions import motions
from fdbench.record import FloatArray, Record
from fdbench.units import time_text


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A command that a drive can follow.

    Attributes
    ----------
    kind, words : str
        What it is, without and with sizes.
    period_s : float
    reference : (n_samples, 3) array
        Commanded position (m), velocity (m/s) and acceleration (m/s^2).
    """

    kind: str
    words: str
    period_s: float
    reference: FloatArray

    @property
    def duration_s(self) -> float:
        """Length of the command."""
        return len(self.reference) * self.period_s

    def record(self) -> Record:
        """Return the command as a record."""
        names = ("reference_position_m", "reference_velocity_m_per_s", "reference_acceleration_m_per_s2")
        time = np.arange(len(self.reference), dtype=np.float64) * self.period_s
        return Record({"time_s": time, **dict(zip(names, self.reference.T, strict=True))}, source=self.words)

    def experiment(self, **expected: Any) -> Experiment:
        """Return the motion as an experiment: where, how far, how fast, how long, beside what is expected of it."""
        position, velocity, acceleration = self.reference.T
        low, high = float(position.min()), float(position.max())
        return Experiment(
            trajectory=f"{self.words}; {time_text(self.duration_s)}",
            kind=self.kind,
            motion=self.words,
            position_m=(low, high),
            amplitude_m=0.5 * (high - low),
            velocity_m_per_s=float(np.abs(velocity).max()),
            acceleration_m_per_s2=float(np.abs(acceleration).max()),
            duration_s=self.duration_s,
            **expected,
        )


def moves(
    stops_m: Sequence[float],
    speeds_m_per_s: Sequence[float],
    acceleration_m_per_s2: float,
    period_s: float,
    dwell_s: float = 0.1,
) -> FloatArray:
    """Return the (n_samples, 3) reference of jerk-limited moves from stop to stop, each at its own speed."""
    kind: Any = motions.get("jerk_limited_moves")
    parts = [np.tile((stops_m[0], 0.0, 0.0), (max(1, round(dwell_s / period_s)), 1))]
    for (here, there), speed in zip(itertools.pairwise(stops_m), itertools.cycle(speeds_m_per_s), strict=False):
        motion = kind(
            stops_m=(here, there),
            velocity_m_per_s=speed,
            acceleration_m_per_s2=acceleration_m_per_s2,
            jerk_m_per_s3=20.0 * acceleration_m_per_s2,
            dwell_s=1e3,
        )
        longest = abs(there - here) / speed + 4.0 * math.sqrt(abs(there - here) / acceleration_m_per_s2) + 0.5
        reference = motion.reference(period_s, round((longest + dwell_s) / period_s))
        arrived = int(np.flatnonzero(np.abs(reference[:, 1]) > 0.0)[-1]) + 1 if there != here else 0
        parts.append(reference[: arrived + max(1, round(dwell_s / period_s))])
    return np.concatenate(parts)


def multisine(
    centre_m: float, rms_m: float, band_Hz: tuple[float, float], duration_s: float, period_s: float
) -> FloatArray:
    """Return the (n_samples, 3) reference of a Schroeder-phased multisine of equal accelerations, faded in and out."""
    time = np.arange(round(duration_s / period_s)) * period_s
    order = np.arange(math.ceil(band_Hz[0] * duration_s), math.floor(band_Hz[1] * duration_s) + 1)
    order = np.unique(np.round(np.geomspace(order[0], order[-1], min(len(order), 40))).astype(int))
    k = np.arange(len(order))
    phase = -math.pi * (k * (k + 1) % (2 * len(order))) / len(order)
    angle = 2.0 * math.pi / duration_s * np.outer(time, order) + phase
    wave = (np.cos(angle) / order).sum(axis=1)
    fade = np.clip(np.minimum(time, time[-1] - time) / EXPERIMENT.fade_s, 0.0, 1.0)
    position = centre_m + wave * (rms_m / wave.std()) * fade**3 * (10.0 - 15.0 * fade + 6.0 * fade**2)
    return from_position(position, period_s)


def from_position(position_m: FloatArray, period_s: float) -> FloatArray:
    """Return the (n_samples, 3) reference of positions, with central differences."""
    velocity = np.gradient(position_m, period_s)
    return np.column_stack((position_m, velocity, np.gradient(velocity, period_s)))
