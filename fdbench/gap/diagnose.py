"""Diagnose: align, measure the floor, re-calibrate, localise, search, and say what was found."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fdbench.effects import Effect
from fdbench.errors import RecordError
from fdbench.gap.align import check_alignment, check_record
from fdbench.gap.evidence import Scores, Split, gather
from fdbench.gap.floor import Floor, floors, raised
from fdbench.gap.hypothesis import Hypothesis, adjustables, calibrations, start
from fdbench.gap.nominal import Nominal
from fdbench.gap.readings import Mark, bridged, grid_mark, held_mark
from fdbench.gap.replay import Replay
from fdbench.gap.runs import Run, merged, prepare, same_command
from fdbench.gap.search import NOISE_ALONE, SMALLEST_GAIN, Search, Stage, numbers_of
from fdbench.gap.shrink import Closure, closure, shapley
from fdbench.gap.where import Gaps, where
from fdbench.record import FloatArray, Record
from fdbench.units import unit_of

HELD_OUT_SHARE = 1.0 / 3.0
TOO_SMALL = 1.3  # mean squared gap in units of the floor below which nothing is named
ALIKE = 0.9  # a rival that removes this share of what the best removes cannot be told apart
LEFT_UNEXPLAINED, UNKNOWN_STEEPNESS = 0.2, 2.0  # share left at which an unknown cause is as likely as not
BEYOND_DOUBT = 2.5  # standard deviations of a value on paper beyond which it is a cause


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """What was found: the answer of the contract, and the hypotheses behind it for whoever wants to go on.

    Attributes
    ----------
    answer : dict
        JSON of the contract.
    calibrated, final : Hypothesis
        Without and with the named effects.
    stages : list of Stage
    runs : list of Run
    floors : mapping of str to Floor
    """

    answer: dict[str, Any]
    calibrated: Hypothesis
    final: Hypothesis
    stages: list[Stage]
    split: Split
    simulated: list[dict[str, FloatArray]]


def split_runs(records: Sequence[Run], holdouts: Sequence[Run]) -> tuple[Split, str]:
    """Return what is fitted and what is judged on.

    With held-out records these are judged on; else the last laps of records that repeat themselves, else the last of
    repeated records, else the last third of each record.
    """
    found = floors([*records, *holdouts])
    if holdouts:
        fitted, judged = merged(records), merged(holdouts)
        masks = [np.zeros(run.n_samples, dtype=np.bool_) for run in fitted]
        masks += [np.ones(run.n_samples, dtype=np.bool_) for run in judged]
        return Split(runs=[*fitted, *judged], held_out=masks, floors=found), "held-out"
    last = [run for index, run in enumerate(records) if _is_last_repeat(records, index)]
    if last:
        return split_runs([run for run in records if run not in last], last)[0], "held-out repeats"
    masks = []
    for run in records:
        mask = np.zeros(run.n_samples, dtype=np.bool_)
        if run.lap is not None:
            laps = max(1, round(run.n_samples / run.lap * 0.5))
            mask[laps * run.lap :] = True
        else:
            mask[round(run.n_samples * (1.0 - HELD_OUT_SHARE)) :] = True
        masks.append(mask)
    by = "held-out laps" if all(run.lap is not None for run in records) else "held-out last third of each record"
    return Split(runs=records, held_out=masks, floors=found), by


def _is_last_repeat(runs: Sequence[Run], index: int) -> bool:
    repeats_before = any(same_command(runs[index], other) for other in runs[:index])
    return repeats_before and not any(same_command(runs[index], other) for other in runs[index + 1 :])


def diagnose(
    nominal: Nominal,
    records: Sequence[Record],
    holdouts: Sequence[Record] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between a nominal model and records of the real axis.

    Parameters
    ----------
    nominal : Nominal
    records, holdouts : sequences of Record
        Fitted on, and judged on.
    progress : callable, optional

    Raises
    ------
    RecordError
        If there are no records, or one lacks what is needed; the message says what to do.
    """
    if not records:
        raise RecordError("no records: at least one is needed, better three repeats of several motions.")
    drive = nominal.drive
    raw_runs = [prepare(item, drive) for item in (*records, *holdouts)]
    check_alike(raw_runs)
    for run in raw_runs:
        check_record(run, drive)
    replay, paper = Replay(drive, nominal.library, nominal.simulation.substeps), start(nominal)
    runs, counts, warnings = [], [], list[str]()
    for run in raw_runs:
        on_paper = {name: values[0] for name, values in replay.simulate(run, [paper.variant()]).items()}
        warnings += check_alignment(run, on_paper)
        mended, n_held = bridged(run, on_paper)
        runs.append(mended)
        counts.append(n_held)
    split, judged_on = split_runs(runs[: len(records)], runs[len(records) :])
    marks = [held_mark(raw_runs, runs, counts)]
    if (grid := grid_mark(runs, replay)) is not None and mean_energy(grid, split.floors) > SMALLEST_GAIN:
        split = dataclasses.replace(split, floors=raised(split.floors, grid.energy))
        marks.append(grid)
    search = Search(replay, split, progress)
    raw = mean_gap(replay, split, paper)
    search.progress("re-calibrating the values on paper")
    calibrated = search.refine(paper)
    split = search.split = split.beside(gather(replay, split, calibrated, ()))
    final, stages = search.run(calibrated)
    final, contests = search.review(final, stages)
    shut = closure(replay, split, calibrated, final)
    simulated = [
        {name: values[0] for name, values in replay.simulate(run, [calibrated.variant()]).items()} for run in split.runs
    ]
    seen = [mark for mark in marks if mark is not None and mean_energy(mark, split.floors) > SMALLEST_GAIN]
    answer = {
        "gap": {"channels": channels_of(replay, split, paper, calibrated, final)},
        "where": where(Gaps.of(split.runs, simulated, split.floors)),
        **verdict(search, contests, calibrated, final, shut, seen, raw),
        "shrinkage": shrinkage(shut, final, seen, split, judged_on, raw),
        "next_experiment": None,
        "warnings": warnings,
        "parametric": parametric(raw, shut, calibrated),
        "noise_floor": {
            name: {"value": floor.rms, "unit": unit_of(name), "measured_from_repeats": floor.measured}
            for name, floor in split.floors.items()
        },
    }
    return Diagnosis(answer=answer, calibrated=calibrated, final=final, stages=stages, split=split, simulated=simulated)


def check_alike(runs: Sequence[Run]) -> None:
    """Raise a RecordError unless all runs have the same channels and clock."""
    first = runs[0]
    for run in runs[1:]:
        if set(run.channels) != set(first.channels):
            raise RecordError(
                f"{run.name}: channels {sorted(run.channels)} differ from those of {first.name}, "
                f"{sorted(first.channels)}; give records with the same columns."
            )
        if abs(run.period_s - first.period_s) > 1e-6 * first.period_s:
            raise RecordError(
                f"{run.name}: sampled every {run.period_s:g} s, {first.name} every {first.period_s:g} s; "
                "give records with one clock."
            )


def mean_gap(replay: Replay, split: Split, hypothesis: Hypothesis) -> float:
    """Return the mean squared held-out gap in units of the floor."""
    evidence = gather(replay, split, hypothesis, ())
    outside = evidence.held_out
    return float(evidence.gaps[outside].sum() / evidence.counts[outside].sum())


def channels_of(
    replay: Replay, split: Split, paper: Hypothesis, calibrated: Hypothesis, final: Hypothesis
) -> dict[str, Any]:
    """Return the held-out gap of each channel as root mean square: on paper, re-calibrated, repaired."""
    sums = {name: np.zeros(4) for name in split.runs[0].channels}
    for run, out in zip(split.runs, split.held_out, strict=True):
        simulated = replay.simulate(run, [item.variant() for item in (paper, calibrated, final)])
        for name, measured in run.channels.items():
            for index in range(3):
                sums[name][index] += float(np.sum((measured - simulated[name][index])[out] ** 2))
            sums[name][3] += float(out.sum())
    result = {}
    for name, total in sums.items():
        before, recalibrated, repaired = np.sqrt(total[:3] / max(total[3], 1.0)).tolist()
        spread = math.sqrt(
            sum(float(np.sum((run.channels[name] - run.channels[name].mean()) ** 2)) for run in split.runs)
            / sum(run.n_samples for run in split.runs)
        )
        result[name] = {
            "before": before,
            "recalibrated": recalibrated,
            "repaired": repaired,
            "reduction": 1.0 - (repaired / recalibrated) ** 2 if recalibrated > 0.0 else 0.0,
            "noise_floor": split.floors[name].rms,
            "unit": unit_of(name),
            "relative": before / spread if spread > 0.0 else 0.0,
        }
    return result


def mean_energy(mark: Mark, floors: Mapping[str, Floor]) -> float:
    """Return the mean square that an effect brings into the channels, in units of the floor."""
    return float(np.mean([mark.energy[name] / floor.rms**2 for name, floor in floors.items()]))


def verdict(
    search: Search,
    contests: Sequence[Stage],
    calibrated: Hypothesis,
    final: Hypothesis,
    shut: Closure,
    seen: Sequence[Mark],
    raw: float,
) -> dict[str, Any]:
    """Return causes with probabilities and shares, and the probabilities of an unknown cause and of no gap."""
    means = shut.mean()
    total = float(means[0]) + sum(mean_energy(mark, search.split.floors) for mark in seen if mark.bridged)
    n = len(final.effects)
    closed = dict(zip(shut.subsets, (means[0] - means).tolist(), strict=True))
    values = shapley(closed, n)
    everything = tuple(range(n))
    bounds = intervals(search, final)
    causes = []
    for index, (effect, contest) in enumerate(zip(final.effects, contests, strict=True)):
        alone = tuple(other for other in everything if other != index)
        causes.append(
            {
                "effect": effect.name,
                "probability": contest.probability_of(type(effect)),
                "share": max(values[index], 0.0) / total,
                "unique_share": max(closed[everything] - closed[alone], 0.0) / total,
                "parameters": parameters(effect, bounds[index]),
                "indistinguishable_from": alike(contest, type(effect)),
            }
        )
    on_paper = parametric_causes(search.replay, search.split, final, raw)
    causes += on_paper
    causes += [marked(mark, min(mean_energy(mark, search.split.floors) / total, 1.0)) for mark in seen]
    causes.sort(key=lambda cause: -float(cause["share"]))
    structural = 1.0 / (1.0 + math.exp(-20.0 * (min(float(means[0]), 4.0) - TOO_SMALL)))
    parts = [*(float(cause["probability"]) for cause in on_paper), *(mark.probability for mark in seen)]
    none = (1.0 - structural) * math.prod(1.0 - part for part in parts)
    return {
        "causes": causes,
        "unknown_probability": structural * unknown_probability(search, calibrated, final),
        "no_gap_probability": none,
        "summary": "",
    }


def marked(mark: Mark, share: float) -> dict[str, Any]:
    """Return the cause that is seen in the readings themselves."""
    amplitude = mark.kind.amplitude
    unit = next(item.unit for item in mark.kind.parameters() if item.name == amplitude)
    return {
        "effect": mark.kind.name,
        "probability": mark.probability,
        "share": share,
        "unique_share": share,
        "parameters": {amplitude: {"value": mark.value, "ci95": [mark.low, mark.high], "unit": unit}},
        "indistinguishable_from": [],
    }


def unknown_probability(search: Search, calibrated: Hypothesis, final: Hypothesis) -> float:
    """Return the probability that something is missing that none of the effects explains.

    It depends on the share of the excess misfit that is left beside all effects that were found.
    """
    before = search.compared(calibrated, [(Effect, final, True)])
    left = max(before.rivals[0].misfit - NOISE_ALONE, 0.0) / max(before.misfit - 1.0, 1e-12)
    return float(left**UNKNOWN_STEEPNESS / (left**UNKNOWN_STEEPNESS + LEFT_UNEXPLAINED**UNKNOWN_STEEPNESS))


def intervals(search: Search, final: Hypothesis) -> list[dict[str, list[float]]]:
    """Return the 95 % interval of each fitted parameter of each effect.

    From the normal matrix and the scatter of its right-hand sides from segment to segment, which counts what is
    left as it is, correlated in time or not (White 1980; segments as clusters).
    """
    numbers = numbers_of(final)
    evidence = search.probed(final)
    inside = ~evidence.held_out
    n = len(numbers)
    normal = Scores(evidence, dict(enumerate(final.shifts, start=1))).normal(range(1, 1 + n))
    groups, place = np.unique(evidence.group[inside], return_inverse=True)
    sums = np.zeros((len(groups), n))
    np.add.at(sums, place, evidence.products[inside, 0, 1:])
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-9, hermitian=True) / np.outer(scale, scale)
    spread = sums.T @ sums * len(groups) / max(len(groups) - n, 1)
    deviations = 1.96 * np.sqrt(np.diag(inverse @ (spread + np.eye(n)) @ inverse))
    found, first = [], len(final.shifts)
    for effect in final.effects:
        items = adjustables(effect)
        own: dict[str, list[float]] = {}
        for item, deviation in zip(items, deviations[first : first + len(items)].tolist(), strict=True):
            value = float(getattr(effect, item.name))
            half = deviation * item.step
            own[item.name] = [max(value - half, item.low), min(value + half, item.high)]
        found.append(own)
        first += len(items)
    return found


def parametric_causes(replay: Replay, split: Split, final: Hypothesis, raw: float) -> list[dict[str, Any]]:
    """Return the effects whose size is a value on paper that moved further than it should be wrong.

    A kind of value that is corrected on both sides of the screw counts once, with the sum of its changes. It is a
    cause only if it closes as much of the gap that is there without its correction as another effect would have to.
    """
    scale = calibrations(final.nominal)
    groups: dict[str, list[int]] = {}
    for place, calibration in enumerate(scale):
        groups.setdefault(f"{calibration.kind}_{calibration.index}", []).append(place)
    closed = mean_gap(replay, split, final)
    found = []
    for places in groups.values():
        sizes = [scale[place].size(final.nominal.drive) for place in places]
        change = sum(final.shifts[place] * size for place, size in zip(places, sizes, strict=True))
        distance = abs(change) / max(math.hypot(*sizes), 1e-30)
        name = scale[places[0]].cause(final.nominal)
        if distance <= BEYOND_DOUBT or not name or name in {item.name for item in final.effects}:
            continue
        shifts = tuple(0.0 if place in places else shift for place, shift in enumerate(final.shifts))
        without = mean_gap(replay, split, dataclasses.replace(final, shifts=shifts))
        share = max(without - closed, 0.0) / raw
        if without - closed < SMALLEST_GAIN * without:
            continue
        found.append(
            {
                "effect": name,
                "probability": 1.0 / (1.0 + math.exp(-2.0 * (distance - BEYOND_DOUBT))),
                "share": min(share, 1.0),
                "unique_share": min(share, 1.0),
                "parameters": {"change": {"value": change, "ci95": None, "unit": scale[places[0]].unit}},
                "indistinguishable_from": [],
                "parametric": True,
            }
        )
    return found


def alike(contest: Stage, kind: type[Effect]) -> list[str]:
    """Return the names of rivals that explain nearly as much as an effect."""
    gains = {rival.kind: contest.gain(rival) for rival in contest.rivals}
    return [rival.name for rival, gain in gains.items() if rival is not kind and gain >= ALIKE * gains[kind]]


def parameters(effect: Effect, bounds: Mapping[str, list[float]]) -> dict[str, Any]:
    """Return the parameters of an effect with units; those that no fit moves have no interval."""
    return {
        item.name: {"value": getattr(effect, item.name), "ci95": bounds.get(item.name), "unit": item.unit}
        for item in type(effect).parameters()
    }


def shrinkage(
    shut: Closure, final: Hypothesis, seen: Sequence[Mark], split: Split, judged_on: str, raw: float
) -> dict[str, Any]:
    """Return how the held-out mean squared gap falls as the effects are added one by one, with intervals."""
    means, draws = shut.mean(), shut.mean(shut.draws())
    place = {subset: index for index, subset in enumerate(shut.subsets)}
    by_channel = {name: shut.of_channel(index) for index, name in enumerate(split.floors)}
    steps = [held_step(mark, float(means[0]), by_channel, split.floors) for mark in seen if mark.bridged]
    for count, effect in enumerate(final.effects):
        before, after = place[tuple(range(count))], place[tuple(range(count + 1))]
        steps.append(
            {
                "added": effect.name,
                "before": float(means[before]),
                "after": float(means[after]),
                "reduction": 1.0 - float(means[after] / means[before]),
                "ci95": _interval(1.0 - draws[:, after] / draws[:, before]),
                "channels": {name: 1.0 - float(own[after] / own[before]) for name, own in by_channel.items()},
            }
        )
    total = 1.0 - draws[:, -1] / draws[:, 0]
    return {
        "judged_on": judged_on,
        "unit": "mean square in units of the noise floor",
        "on_paper": raw,
        "steps": steps,
        "total": 1.0 - float(means[-1] / means[0]),
        "ci95": _interval(total),
        "reducible_left": max(0.0, 1.0 - 1.0 / max(float(means[-1]), 1e-12)),
        "noise_floor": 1.0,
    }


def held_step(
    mark: Mark, after: float, by_channel: Mapping[str, FloatArray], floors: Mapping[str, Floor]
) -> dict[str, Any]:
    """Return the step from the samples as they were logged to those that are compared."""
    energy = mean_energy(mark, floors)
    own = {name: mark.energy[name] / floor.rms**2 for name, floor in floors.items()}
    low, high = (energy * bound / mark.value for bound in (mark.low, mark.high))
    return {
        "added": mark.kind.name,
        "before": after + energy,
        "after": after,
        "reduction": energy / (after + energy),
        "ci95": [low / (after + low), high / (after + high)],
        "channels": {name: own[name] / (own[name] + float(means[0])) for name, means in by_channel.items()},
    }


def parametric(raw: float, shut: Closure, calibrated: Hypothesis) -> dict[str, Any]:
    """Return what re-calibration alone does: the parametric gap, and how far each value on paper moved."""
    structural = float(shut.mean()[0])
    moved = zip(calibrations(calibrated.nominal), calibrated.shifts, strict=True)
    return {
        "closed_by_recalibration": max(0.0, 1.0 - structural / raw),
        "moved_in_standard_deviations": {item.name: shift for item, shift in moved},
    }


def _interval(values: FloatArray) -> list[float]:
    low, high = np.percentile(values, [2.5, 97.5])
    return [float(low), float(high)]


__all__ = ["Diagnosis", "Floor", "diagnose", "numbers_of"]
