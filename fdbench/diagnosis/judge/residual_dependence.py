"""Of what type the rest is: nameless functions of the motion, fitted to what no listed effect explains.

A cause that the library lacks has no name, but what it depends on narrows it down: a function of speed is friction, one
of position a property of the way, one of time a drift.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.answer.where import Dependence, Most
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.records.runs import FORCE, RecordedRun
from fdbench.diagnosis.settings import JUDGE
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray
from fdbench.rotary import spoken_unit

Cells = NDArray[np.intp]


def dependences(
    split: Split, simulated: Sequence[Mapping[str, FloatArray]], drive: FeedDrive
) -> tuple[Dependence, ...]:
    """Return what the rest depends on, the share of it that such a function removes, and where most; best first.

    The function is a mean in each of 24 cells (48 where it may differ by direction), fitted on the training samples of
    each channel and judged on the held-out ones; shares are of the squared rest beyond the noise, and do not add up.
    ``most`` is where the force differs most, as far as it is half of that or more, and by how much the motor gives more
    there than the final model, on average; of what shows in other channels alone it is not told.

    Parameters
    ----------
    split : Split
    simulated : sequence of mappings
        Channels of each run as the final model has them.
    drive : FeedDrive

    Examples
    --------
    ``(Dependence(function_of="velocity", share=0.31, most=Most(low=0.0, high=0.01, unit="m/s", force_N=-3.0)),)``
    """
    rest = [split.gap(place, own) for place, own in enumerate(simulated)]
    found: list[Dependence] = []
    for words, kind in _kinds(drive).items():
        values = [kind.places(run) for run in split.runs]
        cells = _cells(values, kind.root)
        if kind.by_direction:
            cells = [2 * own + (run.reference[:, 1] < 0.0) for own, run in zip(cells, split.runs, strict=True)]
        removed = _removed(split, rest, cells)
        share = sum(removed.values())
        if share >= JUDGE.rest_smallest:
            of_force = not kind.by_direction and removed[FORCE] >= JUDGE.rest_smallest
            most = _most(split, rest, values, cells, kind.unit) if of_force else None
            found.append(Dependence(function_of=words, share=share, most=most))
    found.sort(key=lambda item: -item.share)
    of = {item.function_of: item for item in found}
    plain, either = of.get("position"), of.get("position_by_direction")
    if plain and either and either.share > plain.share >= JUDGE.alike * either.share:
        # One of its own for each direction takes a little more of everything.
        found.remove(either)
        found.insert(found.index(plain) + 1, either)
    return tuple(found)


def _most(
    split: Split,
    rest: Sequence[Mapping[str, FloatArray]],
    values: Sequence[FloatArray],
    cells: Sequence[Cells],
    unit: str,
) -> Most:
    """Return from where to where the force differs most, and its mean there; speeds are as they are commanded."""
    value, cell = np.concatenate(values), np.concatenate(cells)
    force = np.concatenate([own[FORCE] / np.sqrt(run.repeats) for own, run in zip(rest, split.runs, strict=True)])
    n_cells = JUDGE.rest_cells
    counts = np.bincount(cell, minlength=n_cells)
    mean = np.bincount(cell, weights=force, minlength=n_cells) / np.maximum(counts, 1)
    first = last = int(np.argmax(np.abs(mean) * counts / (counts + JUDGE.rest_shrinkage)))
    enough = mean * np.sign(mean[first]) >= 0.5 * abs(mean[first])
    while first > 0 and enough[first - 1]:
        first -= 1
    while last < n_cells - 1 and enough[last + 1]:
        last += 1
    there = (cell >= first) & (cell <= last)
    mean_N = split.noise_models[FORCE].rms * float(force[there].mean())
    return Most(low=float(value[there].min()), high=float(value[there].max()), unit=spoken_unit(unit), force_N=mean_N)


@dataclass(frozen=True)
class TriedFunction:
    """A function that is tried: of what, in what unit, on roots or not, and whether both directions have their own."""

    places: Callable[[RecordedRun], FloatArray]
    unit: str
    root: bool = False
    by_direction: bool = False


def _kinds(drive: FeedDrive) -> dict[str, TriedFunction]:
    """Return the functions that are tried, by what they are functions of."""
    kinds = {
        "velocity": TriedFunction(lambda run: run.reference[:, 1], "m/s", root=True),
        "position": TriedFunction(lambda run: run.channels["position_m"], "m"),
        "position_by_direction": TriedFunction(lambda run: run.channels["position_m"], "m", by_direction=True),
        "acceleration": TriedFunction(lambda run: run.reference[:, 2], "m/s^2"),
        "motor_force": TriedFunction(lambda run: run.channels[FORCE], "N"),
        "time": TriedFunction(lambda run: run.time_s, "s"),
    }
    lead = getattr(drive.motor, "lead_m", None)
    if lead is not None:
        kinds["position_within_a_lead"] = TriedFunction(
            lambda run: np.asarray(np.mod(run.channels["position_m"], lead)), "m"
        )
    return kinds


def _cells(values: Sequence[FloatArray], root: bool) -> list[Cells]:
    """Return the cells, of equal width, or with roots of the values of equal width, which resolves slow motion."""
    scaled = [np.sign(item) * np.sqrt(np.abs(item)) if root else item for item in values]
    low, high = min(float(item.min()) for item in scaled), max(float(item.max()) for item in scaled)
    width = max(high - low, 1e-30) / JUDGE.rest_cells
    return [np.minimum(((item - low) / width).astype(np.intp), JUDGE.rest_cells - 1) for item in scaled]


def _removed(split: Split, rest: Sequence[Mapping[str, FloatArray]], cells: Sequence[Cells]) -> dict[str, float]:
    """Return which share of the squared rest beyond the noise, over all channels, a function removes in each."""
    removed: dict[str, float] = {}
    beyond, n_judged, n_cells = 0.0, 0, 2 * JUDGE.rest_cells
    for name in split.noise_models:
        sums, counts = np.zeros(n_cells), np.zeros(n_cells)
        for own, place, out in zip(rest, cells, split.held_out, strict=True):
            sums += np.bincount(place[~out], weights=own[name][~out], minlength=n_cells)
            counts += np.bincount(place[~out], minlength=n_cells)
        mean = sums / (counts + JUDGE.rest_shrinkage)
        removed[name] = 0.0
        for own, place, out in zip(rest, cells, split.held_out, strict=True):
            judged = own[name][out]
            n_judged += len(judged)
            before = float(np.sum(judged**2))
            beyond += before - len(judged)
            removed[name] += before - float(np.sum((judged - mean[place[out]]) ** 2))
    is_noise = beyond <= JUDGE.rest_noise * n_judged
    return {name: 0.0 if is_noise else value / beyond for name, value in removed.items()}
