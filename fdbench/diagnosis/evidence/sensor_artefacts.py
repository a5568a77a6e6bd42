"""Sensor artefacts, which readings show by themselves: repeated (stale) samples, and positions on a grid."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.diagnosis.model.known_effects import is_grid
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.diagnosis.records.runs import DEFLECTION, FORCE, RecordedRun
from fdbench.diagnosis.settings import EVIDENCE, MODEL
from fdbench.effects import Effect, Port, effects
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True)
class Artefact:
    """An effect that is seen in the readings; what it does to them cannot be simulated sample by sample.

    Attributes
    ----------
    kind : Effect class
    probability : float
    value, low, high : float
        Its amplitude, with 95 % bounds.
    energy : mapping of str to float
        Mean square that it brings into each channel, in the channel's unit squared.
    interpolated : bool
        Whether the readings that are compared are without it.
    further : mapping of str to float
        Other parameters that the readings tell.
    """

    kind: type[Effect]
    probability: float
    value: float
    low: float
    high: float
    energy: Mapping[str, float]
    interpolated: bool = False
    further: Mapping[str, float] = field(default_factory=dict)

    def tells_of(self, effect: Effect) -> bool:
        """Whether an effect is what is left of it: of its class, and nearly of its period or frequency."""
        return (
            type(effect) is self.kind
            and bool(self.further)
            and all(
                abs(getattr(effect, name) / value - 1.0) <= MODEL.another_period for name, value in self.further.items()
            )
        )


# ---- repeated samples ----


def interpolated(run: RecordedRun, simulated: Mapping[str, FloatArray]) -> tuple[RecordedRun, int]:
    """Return the run with repeated samples replaced, and how many there were.

    A sample counts as repeated where the model moves by far more than the noise while every channel is as before, and
    where each channel of which it does then catches up with it: what stands still repeats itself, too, and nothing
    counts where no motion is commanded. The gap to the model is interpolated over it.
    """
    if run.held is None or not run.held.any():
        return run, 0
    least = {name: _least_move(run, name) for name in run.channels}
    moving = np.zeros(run.n_samples, dtype=np.bool_)
    for name, values in simulated.items():
        moving[1:] |= np.abs(np.diff(values)) > least[name]
    if run.moves.any():
        moving &= run.moves
    held = run.held & moving & _caught_up(run, simulated, least)
    if not held.any():
        return run, 0
    time, fresh = np.arange(run.n_samples), ~held
    channels = {
        name: simulated[name] + np.interp(time, time[fresh], (values - simulated[name])[fresh])
        for name, values in run.channels.items()
    }
    return dataclasses.replace(run, channels=channels, held=held), int(held.sum())


def _least_move(run: RecordedRun, name: str) -> float:
    """Return by how much a channel has to move for a repeated reading of it to be no coincidence.

    A force that is commanded, as without a loop, is no reading; no reading moves by less than a step of its grid.
    """
    if name == FORCE and run.given_force is not None:
        return math.inf
    moves = np.diff(run.channels[name])
    noise, steps = float(np.median(np.abs(np.diff(moves)))) / 1.65, np.abs(moves)
    return max(EVIDENCE.held_moves * noise, float(np.min(steps[steps > 0.0], initial=math.inf)))


def _caught_up(run: RecordedRun, simulated: Mapping[str, FloatArray], least: Mapping[str, float]) -> NDArray[np.bool_]:
    """Return where repeated samples end in a jump, in each channel, of half of what the model moved by, or more.

    A channel does not count in which the model moved by less than the least that tells.
    """
    found, held = np.zeros(run.n_samples, dtype=np.bool_), np.asarray(run.held)
    edges = np.flatnonzero(np.diff(held.astype(np.int8), prepend=0))
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=False):
        ends = [max(first - 1, 0), after]
        moves = [
            (*np.diff(simulated[name][ends]), *np.diff(own[ends]), least[name]) for name, own in run.channels.items()
        ]
        found[first:after] = all(own / model > 0.5 for model, own, enough in moves if abs(model) > enough)
    return found


def held_artefact(raw: Sequence[RecordedRun], mended: Sequence[RecordedRun], counts: Sequence[int]) -> Artefact | None:
    """Return the effect of the logger, by how many samples it repeated; None without any, or without such an effect."""
    kinds = [kind for kind in map(effects.get, effects.names()) if kind.port is Port.LOGGING]
    n_held, n_samples = sum(counts), sum(run.n_samples for run in raw)
    if not kinds or n_held == 0:
        return None
    rate, half = n_held / n_samples, 1.96 * math.sqrt(n_held) / n_samples
    energy = {
        name: sum(float(np.sum((a.channels[name] - b.channels[name]) ** 2)) for a, b in zip(raw, mended, strict=True))
        / n_samples
        for name in raw[0].channels
    }
    return Artefact(
        kind=kinds[0],
        probability=1.0 - math.exp(-float(n_held)),
        value=rate,
        low=max(rate - half, 0.0),
        high=rate + half,
        energy=energy,
        interpolated=True,
    )


# ---- readings on a grid ----


def grid_artefacts(runs: Sequence[RecordedRun], replay: Replay, length: float) -> list[Artefact]:
    """Return the effects of encoders that leave the differences between readings as they are, at most one of each.

    Such an effect moves every reading to a grid: applied once more, it changes nothing. The grid that the differences
    of neighbouring samples lie nearest to is taken, at the coarsest step.
    """
    best: dict[Port, tuple[float, Effect]] = {}
    for kind in replay.library:
        if is_grid(kind.typical()):
            readings = list(readings_of(runs, replay.drive, kind.port))
            if not readings:
                continue
            differences = np.concatenate([np.abs(np.diff(values)) for values in readings])
            found = _coarsest_grid(kind, np.sort(differences[differences > 0.0]), length * EVIDENCE.grid_coarsest_m)
            if found is not None and (kind.port not in best or found[0] < best[kind.port][0]):
                best[kind.port] = found
    return [_grid(runs, replay, *found) for found in best.values()]


def _grid(runs: Sequence[RecordedRun], replay: Replay, distance: float, effect: Effect) -> Artefact:
    value = float(getattr(effect, effect.amplitude))
    return Artefact(
        kind=type(effect),
        probability=1.0 / (1.0 + math.exp(EVIDENCE.grid_slope * (distance - EVIDENCE.on_grid))),
        value=value,
        low=value / EVIDENCE.grid_ratio,
        high=value * EVIDENCE.grid_ratio,
        energy=_energy(runs, replay, effect),
    )


def beyond(artefact: Artefact, known: Sequence[float]) -> Artefact:
    """Return what readings show, improbable as a cause where such an amplitude is known and it is not surely larger."""
    is_known = artefact.low <= max(known, default=0.0)
    return dataclasses.replace(artefact, probability=0.0) if is_known else artefact


def beside_known(artefact: Artefact, drive: FeedDrive) -> Artefact:
    """Return what readings show, as a cause `beyond` what the model knows of it."""
    alike = [item for item in drive.effects if item.declared is artefact.kind.declared]
    return beyond(artefact, [abs(float(getattr(item, item.amplitude))) for item in alike])


def of_the_log(grid: Artefact, noise_models: Mapping[str, NoiseModel]) -> Artefact:
    """Return a grid without a force where that is far quieter than steps in the loop would make it.

    Then it is that of the log, which has fewer digits than the controller.
    """
    floor, force = noise_models[FORCE], grid.energy[FORCE]
    if not floor.measured or force <= EVIDENCE.coarse_log * floor.total**2:
        return grid
    return dataclasses.replace(grid, energy={**grid.energy, FORCE: 0.0})


def readings_of(runs: Sequence[RecordedRun], drive: FeedDrive, port: Port) -> Iterator[FloatArray]:
    """Yield what an encoder read in each run, (n_samples,), where it was recorded."""
    own = drive.controller.uses_table == (port is Port.TABLE_SCALE)
    for run in runs:
        if own:
            yield run.channels["position_m"]
        elif DEFLECTION in run.channels:
            sign = 1.0 if port is Port.MOTOR_ENCODER else -1.0
            yield run.channels["position_m"] + sign * run.channels[DEFLECTION]


def _coarsest_grid(kind: type[Effect], differences: FloatArray, coarsest_m: float) -> tuple[float, Effect] | None:
    """Return the distance from the coarsest grid that the differences lie on, and the effect; None without one."""
    bounds = next(item for item in kind.parameters() if item.name == kind.amplitude)
    steps = min(coarsest_m, bounds.high) * EVIDENCE.grid_ratio ** -np.arange(EVIDENCE.grid_steps)
    nearest, furthest, n_cells = EVIDENCE.grid_nearest, EVIDENCE.grid_furthest, EVIDENCE.grid_cells
    anything = np.linspace(nearest, furthest, int((furthest - nearest) * n_cells))
    found: tuple[float, Effect] | None = None
    for step in steps[steps > differences[0] / EVIDENCE.grid_ratio].tolist() if len(differences) else []:
        first, last = np.searchsorted(differences, (nearest * step, furthest * step))
        if last - first < EVIDENCE.grid_fewest:
            continue
        effect = kind.typical(**{kind.amplitude: step})
        moved = _after(effect, anything * step)
        edges = (np.arange(round(nearest * n_cells), round(furthest * n_cells) + 2) - 0.5) * (step / n_cells)
        starts = np.searchsorted(differences, edges)
        of_each_cell = differences[starts[:-1][np.diff(starts) > 0]]
        distance = _mean(_after(effect, of_each_cell) - of_each_cell) / _mean(moved - anything * step)
        if distance < (EVIDENCE.on_grid if found is None else found[0]):
            found = distance, effect
        elif found is not None:
            return found
    return found


def _after(effect: Effect, readings: FloatArray) -> FloatArray:
    """Return readings as they leave an encoder with an effect."""
    found: FloatArray = _each_reading(type(effect).kernel)(readings, effect.values())
    return found


@functools.cache
def _each_reading(kernel: Callable[..., tuple[float, ...]]) -> Callable[[FloatArray, tuple[float, ...]], FloatArray]:
    """Return the compiled kernel of an effect over an array of readings."""

    @kept
    @njit(error_model="numpy")
    def each(readings: FloatArray, values: tuple[float, ...]) -> FloatArray:
        moved = np.empty_like(readings)
        for i in range(len(readings)):
            moved[i] = kernel(0.0, 1e-3, 0.0, 0.0, readings[i], *values)[0]
        return moved

    return each  # type: ignore[no-any-return]


def _mean(values: FloatArray) -> float:
    return float(np.mean(np.abs(values)))


def changed_by(effect: Effect, run: RecordedRun, replay: Replay) -> dict[str, FloatArray]:
    """Return by how much an effect changes each channel of a run, (n_samples,)."""
    pair = [Variant(plant=replay.drive), Variant(plant=replay.drive, extra=(effect,))]
    return {name: values[1] - values[0] for name, values in replay.simulate(run, pair).items()}


def _energy(runs: Sequence[RecordedRun], replay: Replay, effect: Effect) -> dict[str, float]:
    """Return the mean square that an effect brings into each channel of runs, in the channel's unit squared."""
    sums = dict.fromkeys(runs[0].channels, 0.0)
    for run in runs:
        for name, change in changed_by(effect, run, replay).items():
            sums[name] += float(np.sum(change**2))
    return {name: total / sum(run.n_samples for run in runs) for name, total in sums.items()}


def energies(artefact: Artefact, noise_models: Mapping[str, NoiseModel]) -> FloatArray:
    """Return the mean square that an effect brings into each channel, in units of the floor."""
    return np.array([artefact.energy[name] / floor.rms**2 for name, floor in noise_models.items()])


def mean_energy(artefact: Artefact, noise_models: Mapping[str, NoiseModel]) -> float:
    """Return the mean square that an effect brings into the channels, in units of the floor."""
    return float(np.mean(energies(artefact, noise_models)))


def told_of(grid: Artefact, noise_models: Mapping[str, NoiseModel]) -> Artefact:
    """Return a grid, improbable as a cause where it makes little of the noise of any channel, as every encoder does."""
    is_fine = energies(grid, noise_models).max() <= EVIDENCE.telling_grid
    return dataclasses.replace(grid, probability=0.0) if is_fine else grid
