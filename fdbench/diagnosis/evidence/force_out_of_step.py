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
from fdbench.diagnosis.records.runs import FORCE, POSITION, RecordedRun, differences
from fdbench.diagnosis.records.spectral_lines import component, fitted, lines_in_time, sharpened, tones
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
    between = differences(runs, FORCE)
    lines = lines_between_repeats(between, runs[0].period_s) if between else lines_of_all(runs)
    if not lines:
        return OutOfStep(runs=list(runs))
    own = [[sharpened(_gap(run, FORCE), line * run.period_s) for line in lines] for run in runs]
    kind = next((item for item in nominal.library if item.port is Port.TABLE_FORCE and _shape(item)), None)
    found = [_line(runs, [item[place] for item in own], kind, nominal, replay) for place in range(len(lines))]
    cleaned, removed = [], []
    for run, frequencies in zip(runs, own, strict=True):
        names = list(run.channels)
        gaps = np.stack([_gap(run, name) for name in names])
        waves = dict(zip(names, fitted(gaps, tones(run.n_samples, frequencies)), strict=True))
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


def lines_between_repeats(between: Sequence[FloatArray], period_s: float) -> list[float]:
    """Return the lines (Hz) that make a good part of what the force of repeats differs by.

    A force that is periodic, but not in step with the command, comes at another phase each time.

    Parameters
    ----------
    between : sequence of (n_samples,) array
        What the force of each repeat differs by from the one before, at least once.
    period_s : float
        Sampling time.
    """
    found = []
    for line in lines_in_time([own[None] for own in between], period_s):
        taken = [fitted(own[None], tones(len(own), [sharpened(own, line * period_s)])) for own in between]
        if sum(float(np.sum(own**2)) for own in taken) > JUDGE.force_line * sum(float(own @ own) for own in between):
            found.append(line)
    return found


def lines_of_all(runs: Sequence[RecordedRun]) -> list[float]:
    """Return the lines (Hz) that all of several motions have, at another phase each, and at any speed.

    One that has the same phase in all is in step with them, and an effect may say so. What repeats with the way is a
    line at a steady speed, and none at another.
    """
    if len(runs) < 2:
        return []
    own = [lines_in_time([_gap(run, FORCE)[None]], run.period_s) for run in runs]
    found = []
    for line in own[0]:
        nearest = [min(others, key=lambda other: abs(other - line), default=math.inf) for others in own]
        widths = [1.0 / (run.n_samples * run.period_s) for run in runs]
        if all(abs(other - line) < width + widths[0] for other, width in zip(nearest, widths, strict=True)):
            phasors = [component(_gap(run, FORCE), line * run.period_s) for run in runs]
            in_step = abs(np.mean(phasors)) > EVIDENCE.same_phase * np.mean(np.abs(phasors))
            if not in_step and all(_is_at_any_speed(run, line * run.period_s) for run in runs):
                found.append(line)
    return found


def _is_at_any_speed(run: RecordedRun, frequency: float) -> bool:
    """Return whether a run has a line (cycles per sample) also where it is not at its usual speed."""
    gap, speed = _gap(run, FORCE), np.abs(run.reference[:, 1])
    moving = speed[speed > RECORDS.resting * speed.max()]
    usual = float(np.median(moving)) if len(moving) else 0.0
    other = np.abs(speed - usual) > USUAL * usual
    tone = fitted(gap[None], tones(len(gap), [sharpened(gap, frequency)]))[0]
    return bool(other.sum() * frequency > TURNS and gap[other] @ tone[other] > 0.5 * (tone[other] @ tone[other]))


def _line(
    runs: Sequence[RecordedRun],
    frequencies: Sequence[float],
    kind: type[Effect] | None,
    nominal: Nominal,
    replay: Replay,
) -> _Line:
    """Return a line that each run has at its own frequency (cycles per sample)."""
    force = np.array([abs(component(_gap(run, FORCE), own)) for run, own in zip(runs, frequencies, strict=True)])
    answers, beside = 0.0, 0.0
    for run, own in zip(runs, frequencies, strict=True):
        gap = _gap(run, POSITION)
        answers += abs(component(gap, own)) ** 2
        aside = [own + number / len(gap) for number in ASIDE]
        beside += float(np.mean([abs(component(gap, other)) ** 2 for other in aside]))
    frequency_Hz = float(np.mean(frequencies)) / runs[0].period_s
    is_answered: bool | None = answers > EVIDENCE.answer * beside
    if kind is None or isinstance(nominal.drive.controller, Following):
        # What a controller that nobody knows makes of a force is not known either.
        return _Line(frequency_Hz=frequency_Hz, amplitudes_N=force, is_answered=is_answered or None)
    per_N, moved_per_N = _response(runs[0], kind, frequency_Hz, float(force.mean()), nominal, replay)
    expected = float(np.sum((force * moved_per_N / per_N) ** 2))
    if not is_answered and expected < EVIDENCE.answer * beside:
        is_answered = None
    return _Line(frequency_Hz=frequency_Hz, amplitudes_N=force / per_N, is_answered=is_answered)


def _response(
    run: RecordedRun,
    kind: type[Effect],
    frequency_Hz: float,
    amplitude_N: float,
    nominal: Nominal,
    replay: Replay,
) -> tuple[float, float]:
    """Return the amplitudes of the force's and of the position's reading for a periodic force on the table of 1 N."""
    force = kind.typical(**{kind.amplitude: amplitude_N, _shape(kind): frequency_Hz})
    without = start(nominal).variant
    own = replay.simulate(run, [without, Variant(plant=without.plant, extra=(force,))])
    change = {name: own[name][1] - own[name][0] for name in (FORCE, POSITION)}
    found = [abs(component(values, frequency_Hz * run.period_s)) / amplitude_N for values in change.values()]
    return max(found[0], 1e-12), found[1]


def _shape(kind: type[Effect]) -> str:
    """Return the parameter of an effect that is a line over time, empty without one and for a form of another."""
    lines = [item.name for item in kind.parameters() if item.locate == "line"]
    return lines[0] if lines and not kind.same_signal_as else ""


def _gap(run: RecordedRun, name: str) -> FloatArray:
    return run.channels[name] if run.left is None else run.left[name]


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
