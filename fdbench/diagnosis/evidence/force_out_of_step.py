"""A periodic force out of step with the command: seen between repeats, told from pick-up, and taken out of each.

A fan, a spindle or a pump turns at its own phase whenever a record begins. No hypothesis that all repeats share can
have such a force, and their mean has less of it the more there are.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evidence.sensor_artefacts import Artefact
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.damage import stretches
from fdbench.diagnosis.records.runs import FORCE, POSITION, RecordedRun, differences, repeated
from fdbench.diagnosis.records.spectral_lines import Stretches, fitted, lines_in_time
from fdbench.diagnosis.settings import EVIDENCE, JUDGE, RECORDS
from fdbench.effects import Effect, Port
from fdbench.plants.feed_drive import Following
from fdbench.record import FloatArray

ASIDE = (-6, -5, -4, -3, 3, 4, 5, 6)  # resolved frequencies beside a line, that are its surroundings
USUAL, TURNS = 0.2, 3.0  # relative change of speed, and turns of a line there, that tell whether it is over time


@dataclass(frozen=True, kw_only=True, eq=False)
class OutOfStep:
    """Runs without their forces out of step, what is to be named of these, and what is to be said."""

    runs: list[RecordedRun]
    artefact: Artefact | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Line:
    """A line of the force: its frequency (Hz), amplitude in each run (N), and whether the position answers to it.

    None where nobody can tell.
    """

    frequency_Hz: float
    amplitudes_N: FloatArray
    is_answered: bool | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Looked:
    """A run, and where in it a line is looked for."""

    run: RecordedRun
    where: Stretches

    @classmethod
    def everywhere(cls, run: RecordedRun) -> "Looked":
        """Look at all of a run."""
        return cls(run=run, where=Stretches.whole(run.n_samples))

    @classmethod
    def while_moving(cls, run: RecordedRun) -> "Looked":
        """Look where a run moves for long enough to tell a line; everywhere, if it does so nowhere."""
        slices = tuple(
            slice(first, last) for first, last in stretches(run.moves) if last - first >= RECORDS.piece_samples
        )
        where = Stretches(n_samples=run.n_samples, slices=slices)
        return cls(run=run, where=where) if slices else cls.everywhere(run)

    @property
    def has_rests(self) -> bool:
        """Whether the run is looked at in several stretches."""
        return len(self.where.slices) > 1

    def gap(self, name: str) -> FloatArray:
        """Return what the nominal model leaves of a channel."""
        return self.run.channels[name] if self.run.left is None else self.run.left[name]

    def component(self, name: str, frequency: float) -> complex:
        """Return what the gap of a channel has of a frequency (cycles per sample), as a complex amplitude."""
        return self.where.component(self.gap(name), frequency)

    def sharpened(self, line: float, within: float | None = None) -> float:
        """Return the frequency (cycles per sample) about a line (Hz) that the gap of the force has most of."""
        return self.where.sharpened(self.gap(FORCE), line * self.run.period_s, within)

    def is_at_any_speed(self, line: float) -> bool:
        """Return whether the force has a line (Hz) also where the run is not at its usual speed."""
        gap, speed, where = self.gap(FORCE), np.abs(self.run.reference[:, 1]), self.where
        moving = speed[self.run.moves]
        usual = float(np.median(moving)) if len(moving) else 0.0
        other = (np.abs(speed - usual) > USUAL * usual) & where.inside
        tone = self._tone(line)
        turns = other.sum() * line * self.run.period_s
        return bool(turns > TURNS and gap[other] @ tone[other] > 0.5 * (tone[other] @ tone[other]))

    def steadiness(self, line: float) -> float:
        """Return how much of a line (Hz) is in the quarter of the run that has least of it; 1 of a steady force."""
        gap, tone = self.gap(FORCE), self._tone(line)
        quarters = np.array_split(np.flatnonzero(self.where.inside), 4)
        return min(float(gap[own] @ tone[own]) / max(float(tone[own] @ tone[own]), 1e-300) for own in quarters)

    def _tone(self, line: float) -> FloatArray:
        """Return what the gap of the force has of a line (Hz), (n_samples,)."""
        inside = (self.gap(FORCE) * self.where.inside)[None]
        return np.asarray(fitted(inside, self.where.tones([self.sharpened(line)]))[0])


def without_forces_out_of_step(runs: Sequence[RecordedRun], nominal: Nominal, replay: Replay) -> OutOfStep:
    """Return runs of one condition without the lines that repeats differ by.

    What is fitted is the gap to the nominal model, whole, so that nothing of the line is left in the mean of repeats.
    A fan need not turn equally fast in each run: the frequency is that run's own.

    Parameters
    ----------
    runs : sequence of RecordedRun
        With what the nominal model leaves of them.
    nominal : Nominal
    replay : Replay
        Tells what the position would do if the line were a force.
    """
    looked = [Looked.everywhere(run) for run in runs]
    lines = _lines(looked)
    if not lines:
        # Friction at rest may hold what acts, so that nothing of it is read there.
        looked = [Looked.while_moving(run) for run in runs]
        lines = _lines(looked) if any(item.has_rests for item in looked) else []
    if not lines:
        return OutOfStep(runs=list(runs))
    each = [_in_each(looked, line) for line in lines]
    kind = next((item for item in nominal.library if item.port is Port.TABLE_FORCE and _shape(item)), None)
    found = [_line(looked, own, kind, nominal, replay) for own in each]
    cleaned, removed = [], []
    for item, *frequencies in zip(looked, *each, strict=True):
        run, where = item.run, item.where
        names = list(run.channels)
        gaps = np.stack([item.gap(name) for name in names])
        waves = dict(zip(names, fitted(gaps * where.inside, where.tones(frequencies)), strict=True))
        removed.append({name: float(np.mean(wave**2)) for name, wave in waves.items()})
        channels = {name: values - waves[name] for name, values in run.channels.items()}
        left = None if run.left is None else {name: values - waves[name] for name, values in run.left.items()}
        cleaned.append(dataclasses.replace(run, channels=channels, left=left))
    forces = [line for line in found if line.is_answered is not False]
    artefact = None
    if kind is not None and forces:
        strongest = max(forces, key=lambda line: float(line.amplitudes_N.mean()))
        amplitude = float(strongest.amplitudes_N.mean())
        half = 1.96 * float(strongest.amplitudes_N.std()) / np.sqrt(len(runs))
        artefact = Artefact(
            kind=kind,
            probability=EVIDENCE.answered if strongest.is_answered else EVIDENCE.unanswered,
            value=amplitude,
            low=max(amplitude - half, 0.0),
            high=amplitude + half,
            energy={name: float(np.mean([own[name] for own in removed])) for name in runs[0].channels},
            interpolated=True,
            further={_shape(kind): strongest.frequency_Hz},
        )
    return OutOfStep(runs=cleaned, artefact=artefact, warnings=tuple(map(_words, found)))


def _lines(looked: Sequence[Looked]) -> list[float]:
    """Return the lines (Hz) that repeats differ by; where nothing was repeated, that all motions have."""
    runs = [item.run for item in looked]
    between = differences(runs, FORCE)
    if not between:
        return lines_of_all(looked)
    pairs = repeated(runs)
    repeats = [item.where for item in looked if any(item.run is own for own, _ in pairs)]
    of_laps = [Stretches.whole(len(own)) for own in between]
    return lines_between_repeats(between, repeats or of_laps, runs[0].period_s)


def lines_between_repeats(
    between: Sequence[FloatArray], everywhere: Sequence[Stretches], period_s: float
) -> list[float]:
    """Return the lines (Hz) that make a good part of what the force of repeats differs by.

    A force that is periodic, but not in step with the command, comes at another phase each time: most differences have
    a good part of it, too. What a few repeats differ by at some low frequency is friction.

    Parameters
    ----------
    between : sequence of (n_samples,) array
        What the force of each repeat differs by from the one before, at least once.
    everywhere : sequence of Stretches
        Where in each a line is looked for.
    period_s : float
        Sampling time.
    """
    pairs = list(zip(between, everywhere, strict=True))
    found = []
    for line in lines_in_time([one for own, where in pairs for one in where.of(own)], period_s):
        taken, every = np.zeros(len(pairs)), np.zeros(len(pairs))
        for place, (own, where) in enumerate(pairs):
            inside = (own * where.inside)[None]
            wave = fitted(inside, where.tones([where.sharpened(own, line * period_s)]))
            taken[place], every[place] = np.sum(wave**2), np.sum(inside**2)
        in_most = float(np.median(taken / np.maximum(every, 1e-300))) > 0.5 * JUDGE.force_line
        if in_most and taken.sum() > JUDGE.force_line * every.sum():
            found.append(line)
    return found


def lines_of_all(looked: Sequence[Looked]) -> list[float]:
    """Return the lines (Hz) that all of several motions have, at another phase each, and at any speed.

    One that has the same phase in all is in step with them, and an effect may say so. What repeats with the way is a
    line at a steady speed, and none at another; what rings has one for a while.
    """
    if len(looked) < 2:
        return []
    own = [lines_in_time(item.where.of(item.gap(FORCE)), item.run.period_s) for item in looked]
    found = []
    for line in own[0]:
        nearest = [min(others, key=lambda other: abs(other - line), default=math.inf) for others in own]
        widths = [item.where.resolved / item.run.period_s for item in looked]
        if all(abs(other - line) < width + widths[0] for other, width in zip(nearest, widths, strict=True)):
            phasors = [item.component(FORCE, line * item.run.period_s) for item in looked]
            in_step = abs(np.mean(phasors)) > EVIDENCE.same_phase * np.mean(np.abs(phasors))
            # A mode or a loop that rings has a line, too, that comes and goes with what the motion excites.
            is_steady = float(np.median([item.steadiness(line) for item in looked])) > EVIDENCE.steady_line
            if not in_step and is_steady and all(item.is_at_any_speed(line) for item in looked):
                found.append(line)
    return found


def _in_each(looked: Sequence[Looked], line: float) -> list[float]:
    """Return the frequency of a line (Hz) in each run, in cycles per sample.

    Stretches with rests between them are in phase at several frequencies; there the run that resolves most decides.
    """
    finest = min(looked, key=lambda item: item.where.resolved / item.run.period_s)
    line = finest.sharpened(line) / finest.run.period_s
    return [item.sharpened(line, 1.0 / item.run.n_samples if item.has_rests else None) for item in looked]


def _line(
    looked: Sequence[Looked],
    frequencies: Sequence[float],
    kind: type[Effect] | None,
    nominal: Nominal,
    replay: Replay,
) -> _Line:
    """Return a line that each run has at its own frequency (cycles per sample)."""
    every = list(zip(looked, frequencies, strict=True))
    force = np.array([abs(item.component(FORCE, own)) for item, own in every])
    answers, beside = 0.0, 0.0
    for item, own in every:
        answers += abs(item.component(POSITION, own)) ** 2
        aside = [own + number * item.where.resolved for number in ASIDE]
        beside += float(np.mean([abs(item.component(POSITION, other)) ** 2 for other in aside]))
    frequency_Hz = float(np.mean(frequencies)) / looked[0].run.period_s
    is_answered: bool | None = answers > EVIDENCE.answer * beside
    if kind is None or isinstance(nominal.drive.controller, Following):
        # What a controller that nobody knows makes of a force is not known either.
        return _Line(frequency_Hz=frequency_Hz, amplitudes_N=force, is_answered=is_answered or None)
    per_N, moved_per_N = _response(looked[0], kind, frequency_Hz, float(force.mean()), nominal, replay)
    expected = float(np.sum((force * moved_per_N / per_N) ** 2))
    if not is_answered and expected < EVIDENCE.answer * beside:
        is_answered = None
    return _Line(frequency_Hz=frequency_Hz, amplitudes_N=force / per_N, is_answered=is_answered)


def _response(
    looked: Looked,
    kind: type[Effect],
    frequency_Hz: float,
    amplitude_N: float,
    nominal: Nominal,
    replay: Replay,
) -> tuple[float, float]:
    """Return the amplitudes of the force's and of the position's reading for a periodic force on the table of 1 N."""
    force = kind.typical(**{kind.amplitude: amplitude_N, _shape(kind): frequency_Hz})
    without = start(nominal).variant
    run = looked.run
    own = replay.simulate(run, [without, Variant(plant=without.plant, extra=(force,))])
    change = {name: own[name][1] - own[name][0] for name in (FORCE, POSITION)}
    frequency = frequency_Hz * run.period_s
    found = [abs(looked.where.component(values, frequency)) / amplitude_N for values in change.values()]
    return max(found[0], 1e-12), found[1]


def _shape(kind: type[Effect]) -> str:
    """Return the parameter of an effect that is a line over time, empty without one and for a form of another."""
    lines = [item.name for item in kind.parameters() if item.locate == "line"]
    return lines[0] if lines and not kind.same_signal_as else ""


def _words(line: _Line) -> str:
    size = f"{line.frequency_Hz:.4g} Hz and {float(line.amplitudes_N.mean()):.3g} N"
    if line.is_answered is False:
        return (
            f"Records differ by a line of {size} in the force, to which the position does not answer as it would to a "
            "force: pick-up of the measurement, which is taken out of each record and is no cause."
        )
    doubt = "" if line.is_answered else " It may be pick-up of the measurement: the position would not show more of it."
    return (
        f"Records differ by a force of {size}, which is not in step with their command, such as that of a spindle or "
        f"a fan. It is taken out of each record before the rest is judged.{doubt}"
    )
