"""Runs: records prepared for comparison with a simulation of the same command."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.records.stale_commands import going_on, stale_commands
from fdbench.diagnosis.settings import RECORDS
from fdbench.errors import RecordError
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray, Record, held_samples

COMMAND = "reference_position_m"
SIDES = ("motor_position_m", "table_position_m")
FORCE, POSITION, DEFLECTION = "motor_force_N", "position_m", "motor_minus_table_position_m"


@dataclass(frozen=True, kw_only=True, eq=False)
class LeadIn:
    """What comes before the samples that are compared: see `RecordedRun.lead_in_samples`.

    Attributes
    ----------
    reference : (n_samples, 3) array
        Commanded position, velocity, acceleration.
    whole : RecordedRun
        The run with these samples, as it was read.
    """

    reference: FloatArray
    whole: "RecordedRun"


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedRun:
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
    motion : pair of (n_samples,) array and float, or None
        Where the reference is made from the measured motion (`fdbench.diagnosis.model.virtual_controller`): the
        position by which repeats are recognised, and how far it may differ between them, relative to its range.
    given_force : (n_samples,) array or None
        Where no motion is commanded: the force as it was logged, by which repeats are recognised, too. An axis in open
        loop moves a little differently under the same force.
    left : mapping of str to (n_samples,) array or None
        What the nominal model leaves of the channels, once it has been simulated.
    condition : str or None
        Under which it was recorded, where the record says so.
    readings : mapping of str to (n_samples,) array or None
        The channels as they were read, where they are compared smoothed.
    lead_in : LeadIn or None
        What is simulated before the first of these samples.
    """

    name: str
    period_s: float
    reference: FloatArray
    channels: dict[str, FloatArray]
    lap: int | None
    held: NDArray[np.bool_] | None = None
    repeats: int = 1
    motion: tuple[FloatArray, float] | None = None
    given_force: FloatArray | None = None
    left: Mapping[str, FloatArray] | None = None
    condition: str | None = None
    readings: Mapping[str, FloatArray] | None = None
    lead_in: LeadIn | None = None

    @property
    def n_samples(self) -> int:
        """Number of samples that are compared."""
        return len(self.reference)

    @property
    def n_before(self) -> int:
        """Number of samples before them."""
        return 0 if self.lead_in is None else len(self.lead_in.reference)

    @property
    def whole(self) -> "RecordedRun":
        """The run with its lead-in."""
        return self if self.lead_in is None else self.lead_in.whole

    @property
    def time_s(self) -> FloatArray:
        """Time of each sample since the record began, (n_samples,)."""
        return np.asarray((self.n_before + np.arange(self.n_samples)) * self.period_s)

    @functools.cached_property
    def command(self) -> FloatArray:
        """The reference from where the record begins, (n_before + n_samples, 3)."""
        return self.reference if self.lead_in is None else np.concatenate((self.lead_in.reference, self.reference))

    def _line_at_start(self, values: FloatArray) -> tuple[float, float]:
        """Return where a line through the first few samples of a channel begins, and its slope per second."""
        first = values[: RECORDS.start_samples]
        slope, offset = np.polyfit(np.arange(len(first)) * self.period_s, first, 1)
        return float(offset), float(slope)

    @functools.cached_property
    def start(self) -> tuple[float, float]:
        """Position (m) and velocity (m/s) where the record begins, by a line through the first few samples."""
        if self.lead_in is not None:
            return self.whole.start
        return self._line_at_start(self.channels[POSITION])

    @property
    def moves(self) -> NDArray[np.bool_]:
        """Which samples are commanded to move, (n_samples,)."""
        speed = np.abs(self.reference[:, 1])
        return np.asarray(speed > RECORDS.resting * speed.max())

    @functools.cached_property
    def held_force_N(self) -> float:
        """Force with which the axis stands before it moves, such as a weight; 0 where it moves or that builds up.

        A controller that was switched on before the record has it in its integral. It is seen in the force as read:
        less what is left of a baseline, a force that builds up may seem to stand.
        """
        if self.lead_in is not None:
            return self.whole.held_force_N
        force, moves = (self.readings or self.channels)[FORCE], np.flatnonzero(self.moves)
        standing = force[: moves[0] if len(moves) else self.n_samples]
        if len(standing) < 4 * RECORDS.start_samples:
            return 0.0
        noise = float(np.std(np.diff(standing))) / math.sqrt(2.0)
        is_there = abs(float(standing.mean())) > RECORDS.held * noise / math.sqrt(len(standing))
        about_level = float(np.sum((standing - standing.mean()) ** 2))
        if not is_there or about_level - _squares_about_rise(standing) > (RECORDS.held * noise) ** 2:
            return 0.0
        return float(np.polyfit(np.arange(len(standing)), standing, 1)[1])

    @functools.cached_property
    def carried_force_N(self) -> float:
        """Force with which a run in motion begins, by a line through its first few samples; 0 where it stands."""
        if self.lead_in is not None:
            return self.whole.carried_force_N
        return self._line_at_start((self.readings or self.channels)[FORCE])[0] if self.moves[0] else 0.0

    def lead_in_samples(self, settling_s: float) -> int:
        """Return the samples until what is followed has left where it began, and the loop has settled after that.

        How bristles are bent at rest, on which side a play is, and what a controller has in its integral is in no
        record: before the axis has slid, they are the gap. A record of which much would be left out stays whole.
        """
        followed = self.reference[:, 0] if self.motion is None else self.motion[0]
        most = round(RECORDS.longest_lead_in * self.n_samples)
        left = np.flatnonzero(np.abs(followed - followed[0]) > RECORDS.left_start * np.ptp(followed))
        if not len(left) or left[0] > most:
            return 0
        return min(int(left[0]) + round(settling_s / self.period_s), most)

    def after(self, n_before: int) -> "RecordedRun":
        """Return the run without its first samples, which are simulated, but not compared."""
        if n_before == 0:
            return self
        return self._part(slice(n_before, None), LeadIn(reference=self.reference[:n_before], whole=self))

    def as_read(self) -> "RecordedRun":
        """Return the run with its channels as they were read."""
        return self if self.readings is None else dataclasses.replace(self, channels=dict(self.readings))

    def up_to(self, n_samples: int) -> "RecordedRun":
        """Return the beginning of the run."""
        return self._part(slice(n_samples), self.lead_in)

    def _part(self, samples: slice, lead_in: LeadIn | None) -> "RecordedRun":
        def part(signals: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
            return {name: values[samples] for name, values in signals.items()}

        return dataclasses.replace(
            self,
            reference=self.reference[samples],
            channels=part(self.channels),
            held=None if self.held is None else self.held[samples],
            motion=None if self.motion is None else (self.motion[0][samples], self.motion[1]),
            given_force=None if self.given_force is None else self.given_force[samples],
            left=None if self.left is None else part(self.left),
            readings=None if self.readings is None else part(self.readings),
            lead_in=lead_in,
        )

    def beside(self, nominal: Mapping[str, FloatArray]) -> "RecordedRun":
        """Return the run with what the nominal model leaves of it."""
        left = {name: values - nominal[name] for name, values in self.channels.items()}
        return dataclasses.replace(self, left=left)


def _squares_about_rise(force: FloatArray) -> float:
    r"""Return the squares that the best of rises :math:`a (1 - e^{-t / \tau})` from nothing leaves of a force."""
    n = len(force)
    rise = 1.0 - np.exp(-np.arange(n)[:, None] / (n * 0.5 ** np.arange(math.log2(n))))
    return float(force @ force - np.max((force @ rise) ** 2 / np.sum(rise**2, axis=0)))


def prepare(record: Record, drive: FeedDrive, rates: str = "central", cycles: int = 1) -> RecordedRun:
    """Return the run of a record with its command, to be simulated with the nominal controller.

    Parameters
    ----------
    record : Record
    drive : FeedDrive
    rates : str
        Of ``COMMAND_RATES``: how those are taken that the record lacks.
    cycles : int
        Of the controller between two samples.

    Raises
    ------
    RecordError
        If the record lacks the command, the motor's force or the position that closes the loop.
    """
    if COMMAND not in record:
        raise RecordError(
            f"{record.source}: no column {COMMAND}; the command is needed to simulate the same motion. "
            "Log the controller's position reference, or map it from the column that holds it."
        )
    period, held = record.sampling_time_s, held_samples(record)
    stale = stale_commands(record[COMMAND], held)
    position = going_on(record[COMMAND], stale)
    velocity = record.get("reference_velocity_m_per_s")
    rate_of = COMMAND_RATES[rates]
    velocity = rate_of(position, period, cycles) if velocity is None else going_on(velocity, stale)
    acceleration = record.get("reference_acceleration_m_per_s2")
    acceleration = rate_of(velocity, period, cycles) if acceleration is None else going_on(acceleration, stale)
    return RecordedRun(
        name=record.source,
        period_s=period,
        reference=np.column_stack((position, velocity, acceleration)),
        channels=channels_of(record, drive, position_column(record, drive)),
        lap=lap_length(position, period, RECORDS.same_command),
        held=held,
        condition=record.provenance.get("condition"),
    )


def rate(values: FloatArray, period_s: float, cycles: int = 1) -> FloatArray:
    """Return the rate of change of a command, to second order and sharp where it changes suddenly.

    Central differences, but where the command bends at a sample it is the rate from that sample on; at any number of
    cycles of the controller between two samples.

    >>> rate(np.array([0.0, 0.0, 0.0, 1.0, 2.0, 3.0]), 1.0).tolist()
    [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    """
    found = np.gradient(values, period_s)
    bend = np.abs(np.diff(values, 2))
    # Sample k + 1 is in the middle of bend k, and at the start of bend k + 1.
    sudden = 1 + np.flatnonzero(bend[:-1] > RECORDS.sudden_bend * bend[1:])
    found[sudden] = (4.0 * values[sudden + 1] - 3.0 * values[sudden] - values[sudden + 2]) / (2.0 * period_s)
    return found


def backward_rate(values: FloatArray, period_s: float, cycles: int = 1) -> FloatArray:
    """Return the change of a command since the controller's cycle before, as controllers take it.

    It is late by half a cycle, of which there are several between two samples of a log that is slower.

    >>> backward_rate(np.array([0.0, 0.0, 1.0, 2.0]), 0.5).tolist()
    [0.0, 0.0, 2.0, 2.0]
    >>> backward_rate(np.array([0.0, 1.0, 4.0, 9.0]), 1.0, cycles=4).tolist()
    [0.75, 1.75, 3.75, 5.0]
    """
    found = np.diff(values, prepend=values[:1]) / period_s
    return found if cycles == 1 else (found + (cycles - 1) * rate(values, period_s)) / cycles


COMMAND_RATES: Mapping[str, Callable[[FloatArray, float, int], FloatArray]] = {
    "central": rate,
    "backward": backward_rate,
}


def settling_time_s(drive: FeedDrive) -> float:
    """Return how long a loop knows what was before, by the slowest of its time constants."""
    gains = drive.controller.rows()
    position, velocity, integral = (gains.get(f"{name}_GAIN", 0.0) for name in ("POSITION", "VELOCITY", "INTEGRAL"))
    slowest = max(1.0 / position if position > 0.0 else 0.0, velocity / integral if integral > 0.0 else 0.0)
    return RECORDS.settled * slowest


def after_lead_ins(
    runs: Sequence[RecordedRun], settling_s: float, before: Sequence[RecordedRun] = ()
) -> list[RecordedRun]:
    """Return runs `after` their lead-ins; repeats, those of runs ``before`` too, lose as much as the first of them."""
    found: list[RecordedRun] = []
    for run in runs:
        alike = (other.n_before for other in (*before, *found) if same_command(other, run.after(other.n_before)))
        found.append(run.after(next(alike, run.lead_in_samples(settling_s))))
    return found


def channels_of(record: Record, drive: FeedDrive, position: str) -> dict[str, FloatArray]:
    """Return what is compared: force, position of the loop, and the stretch where both positions were measured."""
    channels = {FORCE: drive.motor_force(record), POSITION: record[position]}
    if set(SIDES) <= set(record):
        channels[DEFLECTION] = record[SIDES[0]] - record[SIDES[1]]
    return {name: np.asarray(values, dtype=np.float64) for name, values in channels.items()}


def position_column(record: Record, drive: FeedDrive) -> str:
    """Return the column of the position that closes the loop: position_m, or that of the controller's side."""
    other, own = SIDES if drive.controller.uses_table else SIDES[::-1]
    # On a rigid axis both sides move alike.
    allowed = ["position_m", own, *([other] if drive.screw is None else [])]
    for name in allowed:
        if name in record:
            return name
    others = f" It has {other}, but the controller's feedback is the other side." if other in record else ""
    raise RecordError(
        f"{record.source}: no column position_m or {own}.{others} Map the position that closes the loop to position_m."
    )


def left_between_encoders(
    runs: Sequence[RecordedRun], simulated: Sequence[Mapping[str, FloatArray]]
) -> FloatArray | None:
    """Return what a model leaves of the distance of motor and table, over all runs; None where not both are read."""
    if any(DEFLECTION not in run.channels for run in runs):
        return None
    return np.concatenate(
        [run.channels[DEFLECTION] - own[DEFLECTION] for run, own in zip(runs, simulated, strict=True)]
    )


def lap_length(position: FloatArray, period_s: float, same: float) -> int | None:
    """Return after how many samples a position repeats itself, or None if it does not within the record."""
    from scipy.signal import correlate

    n = len(position)
    span = float(np.ptp(position))
    if span == 0.0:
        return None
    centred = position - position.mean()
    correlation = correlate(centred, centred, method="fft")[n - 1 :]
    energy = np.concatenate(([0.0], np.cumsum(centred**2)))
    lags = np.arange(n)
    distance = (energy[n - lags] + energy[n] - energy[lags] - 2.0 * correlation) / (n - lags)
    first, last = max(2, round(RECORDS.shortest_lap_s / period_s)), int(RECORDS.longest_lap * n)
    inside = distance[first:last]
    valleys = first + 1 + np.flatnonzero((inside[1:-1] <= inside[:-2]) & (inside[1:-1] < inside[2:]))
    for lap in valleys[distance[valleys] <= (same * span) ** 2].tolist():
        if np.max(np.abs(position[lap:] - position[:-lap])) <= same * span:
            return int(lap)
    return None


def same_command(a: RecordedRun, b: RecordedRun) -> bool:
    """Return whether two runs are repeats of one command, be it of a motion or of a force."""
    return same_motion(a, b) or same_force(a, b)


def same_motion(a: RecordedRun, b: RecordedRun) -> bool:
    """Return whether two runs are of one motion, so that they may be averaged sample by sample."""
    if not _as_long(a, b):
        return False
    (own, share), (other, _) = (run.motion or (run.reference[:, 0], RECORDS.same_command) for run in (a, b))
    return _differ_by_at_most(share, own, other)


def same_force(a: RecordedRun, b: RecordedRun) -> bool:
    """Return whether the same force was given in two runs without a commanded motion.

    No loop asks for the same force twice, as it reacts to noise. A force that never changes tells nothing.
    """
    own, other = a.given_force, b.given_force
    if own is None or other is None or not _as_long(a, b) or np.ptp(own) == 0.0:
        return False
    return _differ_by_at_most(RECORDS.same_command, own, other)


def _as_long(a: RecordedRun, b: RecordedRun) -> bool:
    return a.n_samples == b.n_samples and a.period_s == b.period_s


def _differ_by_at_most(share: float, own: FloatArray, other: FloatArray) -> bool:
    """Return whether two signals are the same up to a share of the range."""
    return bool(np.max(np.abs(own - other)) <= share * max(float(np.ptp(own)), 1e-12))


def repeated(runs: Sequence[RecordedRun]) -> list[tuple[RecordedRun, RecordedRun]]:
    """Return each run that is repeated, and the next run of its command."""
    found = []
    for index, run in enumerate(runs):
        later = next((other for other in runs[index + 1 :] if same_command(run, other)), None)
        if later is not None:
            found.append((run, later))
    return found


def differences(runs: Sequence[RecordedRun], channel: str) -> list[FloatArray]:
    """Return what is left of a channel between repeats: records of one command, or else laps within a record.

    Each difference has twice the variance of the noise. Where motions are followed, it is that of what the nominal
    model leaves: the force that a motion needs differs as the motion does.
    """
    pairs = repeated(runs)
    if pairs:
        return [deviations(later, channel) - deviations(run, channel) for run, later in pairs]
    return [between_laps(deviations(run, channel), run.lap) for run in runs if run.lap is not None]


def between_laps(values: FloatArray, lap: int) -> FloatArray:
    """Return by how much values differ from those a lap before."""
    return values[lap:] - values[:-lap]


def deviations(run: RecordedRun, channel: str) -> FloatArray:
    """Return a channel as repeats are compared in it: where motions are followed, what the model leaves of it."""
    return run.channels[channel] if run.left is None or run.motion is None else run.left[channel]


def by_command(
    runs: Sequence[RecordedRun], alike: Callable[[RecordedRun, RecordedRun], bool] = same_command
) -> list[list[RecordedRun]]:
    """Return the repeats of each command, in the order in which the commands come first."""
    groups: list[list[RecordedRun]] = []
    for run in runs:
        group = next((group for group in groups if alike(group[0], run)), None)
        if group is None:
            groups.append([run])
        else:
            group.append(run)
    return groups


def merged(runs: Sequence[RecordedRun]) -> list[RecordedRun]:
    """Return one run for each motion, the mean of its repeats; their noise is lower by the root of their number."""
    return [_mean(group) for group in by_command(runs, same_motion)]


def _mean(group: Sequence[RecordedRun]) -> RecordedRun:
    first = group[0]
    channels = {name: np.asarray(np.mean([run.channels[name] for run in group], axis=0)) for name in first.channels}
    reference = first.reference if first.motion is None else np.mean([run.reference for run in group], axis=0)
    return dataclasses.replace(first, reference=reference, channels=channels, repeats=len(group))
