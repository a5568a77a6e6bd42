"""The next experiment: the motion of a menu that tells the serious candidates of a diagnosis apart soonest.

Every candidate is simulated on every motion; what one does that neither another candidate nor re-calibration can
imitate is what the motion would show.
"""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fdbench.gap.evidence import MODEL_ERROR, Split
from fdbench.gap.hypothesis import Hypothesis
from fdbench.gap.nominal import Nominal
from fdbench.gap.replay import Replay
from fdbench.gap.runs import Run
from fdbench.gap.search import EFFECTIVE_SAMPLES, Stage
from fdbench.motions import motions
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray, Record

MOST_CANDIDATES = 5
SMALLEST_PROBABILITY = 0.02
DECIDED = 0.99
SMALLEST_LOG_ODDS = 0.5
USED_TRAVEL = 0.5  # share of the travel that a stroke may take where the records do not show more
FADE_S = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A command that a drive can follow.

    Attributes
    ----------
    words : str
        What it is, with sizes.
    period_s : float
    reference : (n_samples, 3) array
        Commanded position (m), velocity (m/s) and acceleration (m/s^2).
    """

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

    def write(self, path: str | Path) -> None:
        """Write the command as CSV or Parquet."""
        self.record().save(path)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What the motions of a menu keep to.

    Attributes
    ----------
    start_m, stroke_m : float
        Where motions begin and end, and how far the longest ones go from there; negative towards smaller positions.
    velocity_m_per_s, acceleration_m_per_s2 : float
    """

    start_m: float
    stroke_m: float
    velocity_m_per_s: float
    acceleration_m_per_s2: float

    @classmethod
    def of(cls, drive: FeedDrive, visited: FloatArray) -> "Limits":
        """Return the limits of a drive about the positions that its records visited.

        Half of the greatest force accelerates; the rest is left to friction and control.
        """
        low, high = float(visited.min()), float(visited.max())
        stroke = max(high - low, USED_TRAVEL * drive.travel_m - max(abs(low), abs(high)))
        return cls(
            start_m=low,
            stroke_m=min(stroke, drive.travel_m - low),
            velocity_m_per_s=0.8 * drive.velocity_limit_m_per_s,
            acceleration_m_per_s2=0.5 * drive.controller.force_limit_N / drive.mass_kg,
        )


# ---- the menu ----


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
    fade = np.clip(np.minimum(time, time[-1] - time) / FADE_S, 0.0, 1.0)
    position = centre_m + wave * (rms_m / wave.std()) * fade**3 * (10.0 - 15.0 * fade + 6.0 * fade**2)
    return from_position(position, period_s)


def from_position(position_m: FloatArray, period_s: float) -> FloatArray:
    """Return the (n_samples, 3) reference of positions, with central differences."""
    velocity = np.gradient(position_m, period_s)
    return np.column_stack((position_m, velocity, np.gradient(velocity, period_s)))


def menu(limits: Limits, period_s: float) -> list[Trajectory]:
    """Return the motions that may be proposed: constant speeds, reversals, multisines, strokes and small sines."""
    x, length, fastest, hardest = (
        limits.start_m,
        limits.stroke_m,
        limits.velocity_m_per_s,
        limits.acceleration_m_per_s2,
    )
    gentle = 0.2 * hardest
    middle = x + 0.5 * length
    found: list[tuple[str, FloatArray]] = []
    for share in (0.02, 0.1, 0.4):
        speed = share * fastest
        stroke = math.copysign(min(abs(length), 2.0 * speed), length)
        reference = moves((x, x + stroke, x, x + stroke, x), (speed,), gentle, period_s)
        found.append((f"constant speed {_mm(speed)}/s both ways over {_mm(stroke)}, twice", reference))
    for size in (1e-4, 1e-3, 1e-2):
        stroke = math.copysign(min(size, 0.5 * abs(length)), length)
        stops = [middle, *(middle + stroke * part for part in (1.0, 0.2, 0.8, 0.0, 0.5, 0.0))]
        speed = min(max(0.5 * abs(stroke), 1e-4), 0.2 * fastest)
        found.append(
            (f"slow nested reversals within {_mm(stroke)} at {_mm(speed)}/s", moves(stops, (speed,), gentle, period_s))
        )
    for low, high, part in ((0.5, 10.0, 0.3), (1.0, 60.0, 0.1), (1.0, 60.0, 0.3), (10.0, 150.0, 0.1)):
        speed_rms, acceleration_rms = part * fastest, part * hardest
        shape = multisine(0.0, 1.0, (low, high), 5.0, period_s)
        scales = (speed_rms / shape[:, 1].std(), acceleration_rms / shape[:, 2].std(), 0.2 * abs(length))
        rms = min(scales)
        words = f"multisine of {low:g} to {high:g} Hz, {_mm(rms)} rms"
        found.append((words, multisine(middle, rms, (low, high), 5.0, period_s)))
    for part in (0.3, 0.8):
        stops = [x, *(x + length * share for share in (0.6, 0.1, 0.4, 0.0))]
        reference = moves(stops, (fastest,), part * hardest, period_s)
        found.append((f"fast strokes of up to {_mm(0.6 * length)} at {part * hardest:.3g} m/s^2", reference))
    speed = 0.25 * fastest
    stops = [x, *([x + length, x] * 4)]
    found.append((f"stroke of {_mm(length)} at {_mm(speed)}/s, four times", moves(stops, (speed,), gentle, period_s)))
    for size, frequency in ((2e-5, 2.0), (2e-4, 2.0), (2e-4, 10.0)):
        time = np.arange(round(5.0 / period_s)) * period_s
        fade = np.clip(np.minimum(time, time[-1] - time) / FADE_S, 0.0, 1.0)
        wave = size * np.sin(2.0 * math.pi * frequency * time) * fade**2 * (3.0 - 2.0 * fade)
        found.append(
            (f"sine of {_mm(size)} at {frequency:g} Hz about one place", from_position(middle + wave, period_s))
        )
    return [
        Trajectory(words=words, period_s=period_s, reference=reference)
        for words, reference in found
        if _within(limits, reference)
    ]


def _within(limits: Limits, reference: FloatArray) -> bool:
    fastest, hardest = np.abs(reference[:, 1]).max(), np.abs(reference[:, 2]).max()
    return bool(fastest <= 1.25 * limits.velocity_m_per_s and hardest <= 2.0 * limits.acceleration_m_per_s2)


def _mm(length_m: float) -> str:
    return f"{1e3 * abs(length_m):.3g} mm"


# ---- the choice ----


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """What may be the cause, and how probable it is.

    Attributes
    ----------
    name : str
    probability : float
    hypothesis : Hypothesis
        The base with the effect at its fitted size.
    """

    name: str
    probability: float
    hypothesis: Hypothesis


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """A motion, and which two candidates it separates best.

    Attributes
    ----------
    to_separate : pair of str
    trajectory : Trajectory
    expected_log_odds : float
        By which the true one of the two is expected to gain on the other, in nats, tempered as the diagnosis is.
    utility_per_s : float
        Sum over pairs of candidates of p_a p_b log(1 + separable energy), for each second.
    """

    to_separate: tuple[str, str]
    trajectory: Trajectory
    expected_log_odds: float
    utility_per_s: float

    def answer(self) -> dict[str, Any]:
        """Return what the diagnosis says of it."""
        return {
            "to_separate": list(self.to_separate),
            "trajectory": f"{self.trajectory.words}; {self.trajectory.duration_s:.3g} s",
            "expected_log_odds": self.expected_log_odds,
        }


def candidates_of(stage: Stage) -> list[Candidate]:
    """Return the serious rivals of a stage, most probable first; what is missing to 1 is that it is none of them."""
    every = [
        Candidate(name=rival.kind.name, probability=chance, hypothesis=rival.hypothesis)
        for rival, chance in zip(stage.rivals, stage.probabilities(), strict=True)
    ]
    every.sort(key=lambda item: -item.probability)
    return [item for item in every[:MOST_CANDIDATES] if item.probability >= SMALLEST_PROBABILITY]


def most_ambiguous(stages: Sequence[Stage]) -> tuple[Hypothesis, list[Candidate]] | None:
    """Return the base and candidates of the stage whose rivals compete most, or None where nothing competes."""
    found = [(stage.base, candidates_of(stage)) for stage in stages]
    open_ = [(base, every) for base, every in found if len(every) > 1 and every[0].probability < DECIDED]
    return max(open_, key=lambda item: _doubt(item[1]), default=None)


def _doubt(every: Sequence[Candidate]) -> float:
    return sum(a.probability * b.probability for a, b in itertools.combinations(every, 2))


class Separation:
    """Separable energy of candidates on one motion.

    Parameters
    ----------
    replay : Replay
    split : Split
        Its floors are the unit of energy.
    base : Hypothesis
    every : sequence of Candidate
    trajectory : Trajectory
    """

    def __init__(
        self, replay: Replay, split: Split, base: Hypothesis, every: Sequence[Candidate], trajectory: Trajectory
    ) -> None:
        self.every = every
        self.trajectory = trajectory
        names = split.runs[0].channels
        start = np.full(len(trajectory.reference), trajectory.reference[0, 0])
        run = Run(
            name=trajectory.words,
            period_s=trajectory.period_s,
            reference=np.ascontiguousarray(trajectory.reference),
            channels=dict.fromkeys(names, start),
            lap=None,
        )
        shifted = [
            dataclasses.replace(base, shifts=tuple(np.add(base.shifts, row).tolist()))
            for row in np.eye(len(base.shifts))
        ]
        lanes = [base, *shifted, *(item.hypothesis for item in every)]
        simulated = replay.simulate(run, [item.variant() for item in lanes])
        scaled = [(simulated[name] - simulated[name][0]) / split.floors[name].rms for name in names]
        signals = np.concatenate(scaled, axis=1)[1:]
        self.count = signals.shape[1]
        self.n_nuisances = len(shifted)
        self.is_finite = bool(np.isfinite(signals).all())
        self.gram = signals @ signals.T if self.is_finite else np.zeros((len(signals), len(signals)))

    def unique(self, one: int, other: int) -> float:
        """Return the energy of one candidate that neither the other at any size nor re-calibration can imitate."""
        place, rival = self.n_nuisances + one, self.n_nuisances + other
        columns = [*range(self.n_nuisances), rival]
        normal = self.gram[np.ix_(columns, columns)].copy()
        normal[np.arange(self.n_nuisances), np.arange(self.n_nuisances)] += 1.0
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
        right = self.gram[columns, place] / scale
        solution = np.linalg.solve(normal / np.outer(scale, scale) + 1e-9 * np.eye(len(columns)), right)
        return max(float(self.gram[place, place] - right @ solution), 0.0)

    @cached_property
    def pairs(self) -> Mapping[tuple[int, int], float]:
        """Smaller of the two unique energies of each pair."""
        every = itertools.combinations(range(len(self.every)), 2)
        return {(a, b): min(self.unique(a, b), self.unique(b, a)) for a, b in every}

    def weighted(self, pair: tuple[int, int]) -> float:
        """Return p_a p_b log(1 + energy) of a pair; an error of the model in proportion to the size is no evidence."""
        a, b = pair
        mean = self.pairs[pair] / self.count
        trusted = self.pairs[pair] / (1.0 + MODEL_ERROR * mean)
        return self.every[a].probability * self.every[b].probability * math.log1p(trusted)

    def utility_per_s(self) -> float:
        """Return the sum over pairs for each second of the motion."""
        return sum(self.weighted(pair) for pair in self.pairs) / self.trajectory.duration_s

    def proposal(self) -> Proposal:
        """Return the motion as a proposal for the pair that counts most."""
        best = max(self.pairs, key=self.weighted)
        odds = 0.5 * EFFECTIVE_SAMPLES * math.log1p(self.pairs[best] / self.count)
        return Proposal(
            to_separate=(self.every[best[0]].name, self.every[best[1]].name),
            trajectory=self.trajectory,
            expected_log_odds=odds,
            utility_per_s=self.utility_per_s(),
        )


def design(
    replay: Replay,
    split: Split,
    stages: Sequence[Stage],
    nominal: Nominal,
    trajectories: Sequence[Trajectory] | None = None,
) -> Proposal | None:
    """Return the motion that separates the candidates of the most ambiguous stage soonest, or None.

    Parameters
    ----------
    replay : Replay
    split : Split
        Runs, for the clock and the positions visited, and floors.
    stages : sequence of Stage
        Of the search.
    nominal : Nominal
    trajectories : sequence of Trajectory, optional
        In place of the menu for the drive's limits.

    Returns
    -------
    Proposal or None
        None where no two candidates compete, or no motion would tell them apart.
    """
    competing = most_ambiguous(stages)
    if competing is None:
        return None
    base, every = competing
    if trajectories is None:
        visited = np.concatenate([run.reference[:, 0] for run in split.runs])
        trajectories = menu(Limits.of(nominal.drive, visited), split.runs[0].period_s)
    found = [Separation(replay, split, base, every, trajectory) for trajectory in trajectories]
    useful = [item for item in found if item.is_finite]
    if not useful:
        return None
    proposal = max(useful, key=Separation.utility_per_s).proposal()
    return proposal if proposal.expected_log_odds >= SMALLEST_LOG_ODDS else None


def propose(replay: Replay, split: Split, stages: Sequence[Stage], nominal: Nominal) -> dict[str, Any] | None:
    """Return the ``next_experiment`` of a diagnosis as JSON, or None; see `design`."""
    proposal = design(replay, split, stages, nominal)
    return None if proposal is None else proposal.answer()
