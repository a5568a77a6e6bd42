"""Runs: records prepared for comparison with a simulation of the same command."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray, Record, held_samples

SAME_COMMAND = 1e-5  # largest relative difference between the commands of repeats
SHORTEST_LAP_S = 0.5
START_SAMPLES = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One record as the diagnosis sees it.

    Attributes
    ----------
    name : str
    period_s : float
    reference : (n_samples, 3) array
        Commanded position, velocity, acceleration.
    channels : mapping of str to (n_samples,) array
        What is compared: the motor force, the position that closes the loop, and with two position sensors the
        distance between motor and table.
    lap : int or None
        Samples after which the command repeats, where it does within the record.
    held : (n_samples,) array of bool or None
        Samples that repeat the last one in every measured channel.
    repeats : int
        How many records of one command the channels are the mean of.
    """

    name: str
    period_s: float
    reference: FloatArray
    channels: dict[str, FloatArray]
    lap: int | None
    held: NDArray[np.bool_] | None = None
    repeats: int = 1

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(self.reference)

    def start(self) -> tuple[float, float]:
        """Return position (m) and velocity (m/s) at the first sample, by a line through the first few."""
        first = self.channels["position_m"][:START_SAMPLES]
        slope, offset = np.polyfit(np.arange(len(first)) * self.period_s, first, 1)
        return float(offset), float(slope)


STRETCH = "motor_minus_table_position_m"


def prepare(record: Record, drive: FeedDrive) -> Run:
    """Return the run of a record.

    Raises
    ------
    RecordError
        If the record lacks the command or the motor's force.
    """
    if "reference_position_m" not in record:
        raise RecordError(
            f"{record.source}: no column reference_position_m; the command is needed to simulate the same motion. "
            "Log the controller's position reference, or map it from the column that holds it."
        )
    if not {"motor_force_N", "motor_torque_Nm"} & set(record):
        raise RecordError(
            f"{record.source}: no column motor_force_N or motor_torque_Nm; log the controller's output and map it "
            "with its gain, such as `gain = 35.15` for N per volt."
        )
    period = record.sampling_time_s
    position = record["reference_position_m"]
    velocity = record.get("reference_velocity_m_per_s")
    velocity = np.gradient(position, period) if velocity is None else velocity
    acceleration = record.get("reference_acceleration_m_per_s2")
    acceleration = np.gradient(velocity, period) if acceleration is None else acceleration
    channels = {"motor_force_N": drive.motor_force(record), "position_m": record["position_m"]}
    if "motor_position_m" in record and "table_position_m" in record:
        channels[STRETCH] = record["motor_position_m"] - record["table_position_m"]
    return Run(
        name=record.source,
        period_s=period,
        reference=np.column_stack((position, velocity, acceleration)),
        channels={name: np.asarray(values, dtype=np.float64) for name, values in channels.items()},
        lap=lap_length(position, period),
        held=held_samples(record),
    )


def lap_length(position: FloatArray, period_s: float) -> int | None:
    """Return after how many samples a command repeats itself, or None if it does not within the record."""
    n = len(position)
    span = float(np.ptp(position))
    if span == 0.0:
        return None
    centred = position - position.mean()
    spectrum = np.fft.rfft(centred, 2 * n)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[:n]
    energy = np.concatenate(([0.0], np.cumsum(centred**2)))
    lags = np.arange(n)
    distance = (energy[n - lags] + energy[n] - energy[lags] - 2.0 * correlation) / (n - lags)
    first, last = max(2, round(SHORTEST_LAP_S / period_s)), int(0.7 * n)
    inside = distance[first:last]
    valleys = first + 1 + np.flatnonzero((inside[1:-1] <= inside[:-2]) & (inside[1:-1] < inside[2:]))
    for lap in valleys[distance[valleys] <= (SAME_COMMAND * span) ** 2].tolist():
        if np.max(np.abs(position[lap:] - position[:-lap])) <= SAME_COMMAND * span:
            return int(lap)
    return None


def same_command(a: Run, b: Run) -> bool:
    """Return whether two runs are repeats of one command."""
    if a.n_samples != b.n_samples or a.period_s != b.period_s:
        return False
    span = float(np.ptp(a.reference[:, 0]))
    return bool(np.max(np.abs(a.reference[:, 0] - b.reference[:, 0])) <= SAME_COMMAND * max(span, 1e-12))


def differences(runs: Sequence[Run], channel: str) -> list[FloatArray]:
    """Return what is left of a channel between repeats: records of one command, or else laps within a record.

    Each difference has twice the variance of the noise.
    """
    found: list[FloatArray] = []
    for index, run in enumerate(runs):
        later = next((other for other in runs[index + 1 :] if same_command(run, other)), None)
        if later is not None:
            found.append(later.channels[channel] - run.channels[channel])
    if found:
        return found
    laps = [(run.channels[channel], run.lap) for run in runs if run.lap is not None]
    return [values[lap:] - values[:-lap] for values, lap in laps]


def merged(runs: Sequence[Run]) -> list[Run]:
    """Return one run for each command, the mean of its repeats; their noise is lower by the root of their number."""
    groups: list[list[Run]] = []
    for run in runs:
        group = next((group for group in groups if same_command(group[0], run)), None)
        if group is None:
            groups.append([run])
        else:
            group.append(run)
    return [_mean(group) for group in groups]


def _mean(group: Sequence[Run]) -> Run:
    channels = {name: np.asarray(np.mean([run.channels[name] for run in group], axis=0)) for name in group[0].channels}
    return dataclasses.replace(group[0], channels=channels, repeats=len(group))
