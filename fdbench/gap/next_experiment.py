"""The next experiment: the motion of a menu after which the true cause is expected to be most probable.

Each motion is simulated with each candidate as the truth, and the others are fitted again to the old records and the
new one together; the misfits that this leaves are read as those of the records are. Candidates are the rivals of the
verdict and, with the probability that it leaves, every other effect of the library, as large as the records may have
hidden.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fdbench.gap import confidence
from fdbench.gap.candidates import candidates, middle_of_each
from fdbench.gap.evidence import MODEL_ERROR, Split, gather
from fdbench.gap.nominal import Nominal
from fdbench.gap.replay import Replay
from fdbench.gap.runs import Run
from fdbench.gap.search import EFFECTIVE_SAMPLES, NOISE_ALONE, Rival, Stage
from fdbench.gap.verdict import alike, divided
from fdbench.motions import motions
from fdbench.plants.feed_drive import FeedDrive, Following
from fdbench.record import FloatArray, Record

if TYPE_CHECKING:
    from fdbench.gap.diagnose import Diagnosis

MOST_RIVALS = 6
SMALLEST_PROBABILITY = 0.02
SURE = 0.9  # probability from which on a verdict needs no further experiment
OVERLOOKED = 0.1  # least probability that the cause is an effect that the records gave no reason to consider
SMALLEST_GAIN = 0.02  # of the probability of the truth, below which nothing is proposed
PRICE_PER_S = 1e-3  # probability that a second of machine time has to bring
SPLIT_LOG_ODDS = 3.0  # 20 to 1
CERTAIN = 1e-12  # smallest probability that log odds tell from none
NOTHING, OTHER = "no further effect", "any other effect"
USED_TRAVEL = 0.5  # share of the travel that a stroke may take where the records do not show more
FOLLOWED = 0.1  # share of the stroke by which the simulated axis may miss the command
FADE_S = 0.25


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

    def sizes(self) -> dict[str, Any]:
        """Return what a reader asks first: where, how far, how fast, how long."""
        position, velocity, acceleration = self.reference.T
        low, high = float(position.min()), float(position.max())
        return {
            "kind": self.kind,
            "motion": self.words,
            "position_m": [low, high],
            "amplitude_m": 0.5 * (high - low),
            "velocity_m_per_s": float(np.abs(velocity).max()),
            "acceleration_m_per_s2": float(np.abs(acceleration).max()),
            "duration_s": self.duration_s,
        }


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
            stroke_m=max(high - low, USED_TRAVEL * drive.travel_m - max(abs(low), abs(high))),
            velocity_m_per_s=0.8 * drive.velocity_limit_m_per_s,
            acceleration_m_per_s2=0.5 * (force_N or 0.0) / drive.mass_kg,
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
    """Return the motions that may be proposed: constant speeds, reversals, multisines, strokes and small sines.

    One has strokes and a multisine of all frequencies, for what nobody thinks of.
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
        add("constant speed", f"{_mm(speed)}/s both ways over {_mm(stroke)}, twice", reference)
    for size in (1e-4, 1e-3, 1e-2):
        stroke = min(size, 0.5 * length)
        stops = [middle, *(middle + stroke * part for part in (1.0, 0.2, 0.8, 0.0, 0.5, 0.0))]
        speed = min(max(0.5 * stroke, 1e-4), 0.2 * fastest)
        reference = moves(stops, (speed,), gentle, period_s)
        add("nested reversals", f"within {_mm(stroke)} at {_mm(speed)}/s", reference)

    def wave(band_Hz: tuple[float, float], part: float) -> tuple[str, FloatArray]:
        _, speed, acceleration = multisine(0.0, 1.0, band_Hz, 5.0, period_s).std(axis=0)
        rms = min(part * fastest / speed, part * hardest / acceleration, 0.2 * length)
        words = f"{band_Hz[0]:g} to {band_Hz[1]:g} Hz, {_mm(rms)} rms"
        return words, multisine(middle, rms, band_Hz, 5.0, period_s)

    for band_Hz, part in (((0.5, 10.0), 0.3), ((1.0, 60.0), 0.1), ((1.0, 60.0), 0.3), ((10.0, 150.0), 0.1)):
        add("multisine", *wave(band_Hz, part))
    stops = [x + length * share for share in (0.0, 0.6, 0.1, 0.4, 0.0, 0.5)]
    words, reference = wave((1.0, 150.0), 0.3)
    strokes = moves(stops, (fastest,), 0.8 * hardest, period_s)
    words = f"up to {_mm(0.6 * length)} at {0.8 * hardest:.3g} m/s^2, then {words}"
    add("strokes and multisine", words, np.concatenate((strokes, reference)))
    for part in (0.3, 0.8):
        stops = [x + length * share for share in (0.0, 0.6, 0.1, 0.4, 0.0)]
        reference = moves(stops, (fastest,), part * hardest, period_s)
        add("fast strokes", f"up to {_mm(0.6 * length)} at {part * hardest:.3g} m/s^2", reference)
    speed = 0.25 * fastest
    add(
        "long strokes",
        f"{_mm(length)} at {_mm(speed)}/s both ways, four times",
        moves([x, *([x + length, x] * 4)], (speed,), gentle, period_s),
    )
    time = np.arange(round(5.0 / period_s)) * period_s
    fade = np.clip(np.minimum(time, time[-1] - time) / FADE_S, 0.0, 1.0)
    for size, frequency in ((2e-5, 2.0), (2e-4, 2.0), (2e-4, 10.0)):
        position = middle + size * np.sin(2.0 * math.pi * frequency * time) * fade**2 * (3.0 - 2.0 * fade)
        add("sine", f"{_mm(size)} at {frequency:g} Hz about one place", from_position(position, period_s))
    return found


def menu_of(split: Split, nominal: Nominal) -> list[Trajectory]:
    """Return the menu about the positions that the records visited, with their clock; empty without room or force."""
    visited = np.concatenate([run.reference[:, 0] for run in split.runs])
    limits = Limits.of(nominal.drive, visited)
    possible = min(limits.stroke_m, limits.acceleration_m_per_s2) > 0.0
    return menu(limits, split.runs[0].period_s) if possible else []


def _mm(length_m: float) -> str:
    return f"{1e3 * length_m:.3g} mm"


# ---- the forecast ----


def serious(stage: Stage) -> Stage:
    """Return a stage with its most probable rivals alone."""
    every = sorted(zip(stage.probabilities(), stage.rivals, strict=True), key=lambda item: -item[0])
    return replace(stage, rivals=tuple(rival for p, rival in every[:MOST_RIVALS] if p >= SMALLEST_PROBABILITY))


def chances(stage: Stage) -> FloatArray:
    """Return the probability of each rival and, last, of none."""
    found = stage.probabilities()
    return np.array([*found, max(1.0 - sum(found), 0.0)])


def told(stage: Stage) -> dict[str, float]:
    """Return the probabilities that the verdict gives to rivals and to none; what lacks to 1 is what it doubts."""
    *own, none = chances(stage).tolist()
    if none >= max(own, default=0.0):
        return {**{rival.kind.name: p for rival, p in zip(stage.rivals, own, strict=True)}, NOTHING: none}
    kind = stage.rivals[int(np.argmax(own))].kind
    same = alike(stage, kind)
    found = divided(stage, kind, same, confidence.heads().effect.probability(confidence.of_effect(stage, kind, same)))
    return {**found, NOTHING: min(none, 1.0 - sum(found.values()))}


def most_open(stages: Sequence[Stage]) -> Stage | None:
    """Return the stage that is furthest from a decision; None where all are decided.

    Beside effects that were found, rivals count only if one of them is there more likely than not.
    """
    found = [stage for stage in stages if stage.rivals and (stage.present() >= 0.5 or not stage.base.effects)]
    surest = [max(told(stage).values()) for stage in found]
    open_ = [(p, stage) for p, stage in zip(surest, found, strict=True) if p < SURE]
    return min(open_, key=lambda item: item[0])[1] if open_ else None


def overlooked(stage: Stage) -> list[Rival]:
    """Return the effects of the library beside the serious rivals: of typical size, with nothing explained yet."""
    known = {rival.kind for rival in serious(stage).rivals}
    others = middle_of_each(item for item in candidates(stage.base) if item.kind not in known)
    return [
        Rival(
            kind=item.kind,
            hypothesis=item.hypotheses(stage.base)[0],
            misfit=stage.misfit,
            penalty=stage.penalty,
            refined=False,
        )
        for item in others
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecast:
    """What a motion is expected to show.

    Attributes
    ----------
    trajectory : Trajectory
    names : list of str
        Candidates: the rivals of a stage, other effects under one name and, last, none of them.
    now : (n_candidates,) array
        Probabilities before the motion.
    after : (n_candidates, n_candidates) array
        Probabilities after it, of each column if the row's candidate is the truth.
    """

    trajectory: Trajectory
    names: list[str]
    now: FloatArray
    after: FloatArray

    def gain(self) -> float:
        """Return by how much the expected probability of the truth rises."""
        return float(self.now @ np.diag(self.after) - self.now @ self.now)

    def utility(self) -> float:
        """Return the gain less the price of the machine's time."""
        return self.gain() - PRICE_PER_S * self.trajectory.duration_s

    def log_odds(self, a: int, b: int) -> float:
        """Return by which the true one of two candidates is expected to gain on the other, in nats."""
        now, after = np.log(np.maximum(self.now, CERTAIN)), np.log(np.maximum(self.after, CERTAIN))
        gains = [after[true, true] - after[true, other] - now[true] + now[other] for true, other in ((a, b), (b, a))]
        return float(np.average(gains, weights=self.now[[a, b]]))

    def answer(self) -> dict[str, Any]:
        """Return what the diagnosis says of it; see `propose`."""
        pairs: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for a, b in itertools.combinations(range(len(self.names)), 2):
            if self.names[a] != self.names[b]:
                pairs.setdefault((self.names[a], self.names[b]), []).append((a, b))
        mistaken = self.now[:, None] * (self.now - self.after)
        mistaken += mistaken.T
        first = max(pairs, key=lambda pair: sum(mistaken[own] for own in pairs[pair]))
        chance = {name: self.now[[other == name for other in self.names]].sum() for name in self.names}
        likely = [pair for pair in pairs if min(map(chance.__getitem__, pair)) >= SMALLEST_PROBABILITY]
        odds = {pair: float(np.mean([self.log_odds(*own) for own in pairs[pair]])) for pair in (first, *likely)}
        return {
            "to_separate": list(first),
            "trajectory": f"{self.trajectory.words}; {self.trajectory.duration_s:.3g} s",
            "expected_log_odds": odds[first],
            "separates": [
                {"effects": list(pair), "expected_log_odds": gain}
                for pair, gain in odds.items()
                if gain >= SPLIT_LOG_ODDS or pair == first
            ],
            "expected_probability": {"now": float(self.now @ self.now), "after": float(self.now @ np.diag(self.after))},
            "expected_gain_per_s": self.gain() / self.trajectory.duration_s,
            **self.trajectory.sizes(),
        }


class Forecaster:
    """Forecasts for the serious rivals of one stage, and for the effects that its records may have hidden.

    Parameters
    ----------
    replay : Replay
    split : Split
    stage : Stage
    """

    def __init__(self, replay: Replay, split: Split, stage: Stage) -> None:
        known, hidden = serious(stage), overlooked(stage)
        self.replay, self.split = replay, split
        self.stage = replace(known, rivals=(*known.rivals, *hidden))
        belief = told(stage)
        own, none = [belief.get(rival.kind.name, 0.0) for rival in known.rivals], belief[NOTHING]
        left = max(1.0 - sum(own) - none, OVERLOOKED)
        weights = np.array([*own, *(left / len(hidden) for _ in hidden), none])
        self.now = weights / weights.sum()
        self.names = [*(rival.kind.name for rival in known.rivals), *(OTHER for _ in hidden), NOTHING]
        shifted = [stage.base.moved(row) for row in np.eye(len(stage.base.shifts))]
        self.n_shifts = len(shifted)
        self.variants = [*shifted, *(rival.hypothesis for rival in self.stage.rivals)]
        evidence = gather(replay, split, stage.base, self.variants, fitted_only=True)
        inside = ~evidence.held_out
        self.known = evidence.products[inside].sum(axis=0)
        self.count = float(evidence.counts[inside].sum())
        self.alone = self._distances(self.known)
        # What would have shown at its typical size is smaller, if it is there.
        shown = [self._distances(self._as_gap(self.known, column))[-1] for column in self._columns[len(known.rivals) :]]
        largest = np.sqrt((NOISE_ALONE - 1.0) * self.count / np.maximum(shown, 1e-12))
        self.sizes = np.concatenate((np.ones(len(known.rivals)), np.minimum(largest, 1.0)))
        self.most_missed_m = FOLLOWED * float(np.ptp(np.concatenate([run.reference[:, 0] for run in split.runs])))

    @property
    def _columns(self) -> range:
        """Columns of the responses of the rivals."""
        return range(1 + self.n_shifts, 1 + len(self.variants))

    def forecast(self, trajectory: Trajectory) -> Forecast | None:
        """Return what a motion is expected to show, or None if the axis would not follow it."""
        run = self._recorded(trajectory)
        if run is None:
            return None
        alike = Split(runs=[run], held_out=[np.zeros(run.n_samples, dtype=np.bool_)], floors=self.split.floors)
        evidence = gather(self.replay, alike, self.stage.base, self.variants)
        count = float(evidence.counts.sum())
        after = []
        for truth, size in zip((*self._columns, 0), (*self.sizes, 0.0), strict=True):
            excess = np.maximum(size**2 * evidence.products[:, truth, truth] / evidence.counts - 1.0, 0.0)
            sums = np.einsum("s,sij->ij", 1.0 / (1.0 + MODEL_ERROR * excess), evidence.products)
            added = self._distances(self.known + self._as_gap(sums, truth, size)) - self.alone
            after.append(chances(self._judged(added, count)))
        return Forecast(trajectory=trajectory, names=self.names, now=self.now, after=np.array(after))

    def _recorded(self, trajectory: Trajectory) -> Run | None:
        """Return what the base of the stage would do."""
        reference = np.ascontiguousarray(trajectory.reference)
        names = self.split.runs[0].channels
        still = np.full(len(reference), reference[0, 0])
        run = Run(
            name=trajectory.words,
            period_s=trajectory.period_s,
            reference=reference,
            channels=dict.fromkeys(names, still),
            lap=None,
        )
        channels = {name: each[0] for name, each in self.replay.simulate(run, [self.stage.base.variant()]).items()}
        missed = np.abs(channels["position_m"] - reference[:, 0]).max()
        follows = all(np.isfinite(each).all() for each in channels.values()) and missed <= self.most_missed_m
        return replace(run, channels=channels) if follows else None

    @staticmethod
    def _as_gap(sums: FloatArray, truth: int, size: float = 1.0) -> FloatArray:
        """Return sums in which the response of column ``truth``, times ``size``, is the gap."""
        columns = [truth, *range(1, len(sums))]
        scale = np.array([size, *np.ones(len(sums) - 1)])
        return np.asarray(sums[np.ix_(columns, columns)] * np.outer(scale, scale))

    def _distances(self, sums: FloatArray) -> FloatArray:
        """Return what each rival, and last the base, leaves of the gap at its best size and re-calibration."""
        shifts = np.arange(1, 1 + self.n_shifts)
        rivals = np.array([[*shifts, column] for column in self._columns], dtype=np.intp)
        parts = [self._distance(sums, columns) for columns in (rivals, shifts[None]) if len(columns)]
        return np.concatenate(parts)

    def _distance(self, sums: FloatArray, columns: NDArray[np.intp]) -> FloatArray:
        """Return what each row of columns leaves of the gap."""
        normal, right = sums[columns[:, :, None], columns[:, None, :]], sums[columns, 0]
        priors = np.arange(self.n_shifts)
        normal[:, priors, priors] += 1.0
        right[:, priors] -= self.stage.base.shifts
        scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
        right /= scale
        normal = normal / (scale[:, :, None] * scale[:, None, :]) + 1e-9 * np.eye(columns.shape[1])
        fitted = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        return np.asarray(sums[0, 0] - np.sum(right * fitted, axis=1))

    def _judged(self, added: FloatArray, count: float) -> Stage:
        """Return the stage with the misfits that old records and new one have together."""
        whole = self.count + count

        def together(misfit: float, more: float) -> float:
            return (self.count * misfit + count + max(more, 0.0)) / whole

        rivals = [
            replace(rival, misfit=together(rival.misfit, more))
            for rival, more in zip(self.stage.rivals, added[:-1].tolist(), strict=True)
        ]
        return replace(
            self.stage,
            misfit=together(self.stage.misfit, float(added[-1])),
            rivals=tuple(rivals),
            effective=min(self.stage.effective * whole / self.count, EFFECTIVE_SAMPLES),
        )


# ---- the choice ----


def design(
    replay: Replay,
    split: Split,
    stages: Sequence[Stage],
    nominal: Nominal,
    trajectories: Sequence[Trajectory] | None = None,
) -> Forecast | None:
    """Return the motion after which the truth is expected to be most probable, its time paid for, or None.

    Parameters
    ----------
    replay : Replay
    split : Split
        Runs, for the clock and the positions visited, and floors.
    stages : sequence of Stage
        Whose rivals may compete.
    nominal : Nominal
    trajectories : sequence of Trajectory, optional
        In place of the menu for the drive's limits.

    Returns
    -------
    Forecast or None
        None where no two candidates compete, or no motion would tell them apart.
    """
    stage = most_open(stages)
    if stage is None:
        return None
    forecaster = Forecaster(replay, split, stage)
    every = menu_of(split, nominal) if trajectories is None else trajectories
    found = [item for item in map(forecaster.forecast, every) if item is not None and item.gain() >= SMALLEST_GAIN]
    return max(found, key=Forecast.utility, default=None)


def propose(replay: Replay, split: Split, stages: Sequence[Stage], nominal: Nominal) -> dict[str, Any] | None:
    """Return the ``next_experiment`` of a diagnosis as JSON, or None; see `design`.

    Returns
    -------
    dict or None
        ``to_separate``, ``trajectory`` and ``expected_log_odds`` of the contract; what else it separates; the expected
        probability of the truth now and after; its gain for each second; kind and sizes of the motion.
    """
    found = design(replay, split, stages, nominal)
    return None if found is None else found.answer()


def proposed(found: "Diagnosis") -> Trajectory | None:
    """Return the motion that a diagnosis proposes, if it does."""
    answer: Mapping[str, Any] | None = found.answer["next_experiment"]
    if answer is None:
        return None
    return next(item for item in menu_of(found.split, found.final.nominal) if item.words == answer["motion"])


def write_proposed(found: "Diagnosis", path: str | Path) -> "Diagnosis":
    """Write the motion that a diagnosis proposes, as CSV or Parquet, and return the diagnosis with the file named.

    Where nothing is proposed, nothing is written and the diagnosis is returned as it is.

    Raises
    ------
    RecordError
        If the file cannot be written.
    """
    trajectory = proposed(found)
    if trajectory is None:
        return found
    trajectory.record().save(path)
    experiment = {**found.answer["next_experiment"], "trajectory": str(path)}
    return replace(found, answer={**found.answer, "next_experiment": experiment})
