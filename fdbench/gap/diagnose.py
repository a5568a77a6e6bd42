"""Diagnose: align, measure the floor, re-calibrate, localise, search, and say what was found."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fdbench.errors import RecordError
from fdbench.gap import confidence
from fdbench.gap.align import check_alignment, check_record
from fdbench.gap.confidence import Heads, Signs
from fdbench.gap.evidence import Split, gather
from fdbench.gap.floor import Floor, floors, raised
from fdbench.gap.following import prepared
from fdbench.gap.forecast import Reader
from fdbench.gap.hypothesis import Hypothesis, calibrations, start
from fdbench.gap.next_experiment import propose
from fdbench.gap.nominal import Nominal
from fdbench.gap.readings import Mark, bridged, grid_mark, held_mark
from fdbench.gap.repeatability import Repeatability
from fdbench.gap.replay import Replay
from fdbench.gap.runs import Run, merged, same_command
from fdbench.gap.search import SMALLEST_GAIN, Search, Stage
from fdbench.gap.shrink import Closure, channel_gaps, closure
from fdbench.gap.unnamed import types
from fdbench.gap.verdict import Findings, energies, verdict
from fdbench.gap.where import Gaps, bands_up_to, where
from fdbench.record import FloatArray, Record
from fdbench.units import unit_of

HELD_OUT_SHARE = 1.0 / 3.0


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
    split : Split
    simulated : list of mappings
        Channels of each run as the re-calibrated model without effects has them.
    signs : mapping
        What the probabilities were drawn from; see `fdbench.gap.verdict.Verdict`.
    """

    answer: dict[str, Any]
    calibrated: Hypothesis
    final: Hypothesis
    stages: list[Stage]
    split: Split
    simulated: list[dict[str, FloatArray]]
    signs: Mapping[str, Mapping[str, Signs]]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Aligned:
    """Records beside their model, before anything is explained.

    Attributes
    ----------
    nominal : Nominal
        As given, or with a virtual controller.
    runs : list of Run
        Of the records and then of the held-out ones; samples that the logger held are bridged.
    replay : Replay
    split : Split
    judged_on : str
    marks : list of Mark
    warnings : list of str
    """

    nominal: Nominal
    runs: list[Run]
    replay: Replay
    split: Split
    judged_on: str
    marks: list[Mark]
    warnings: list[str]


def aligned(nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> Aligned:
    """Return records as they are compared with their model; see `diagnose` for parameters and errors."""
    if not records:
        raise RecordError("no records: at least one is needed, better three repeats of several motions.")
    records, holdouts, copies = without_copies(records, holdouts)
    nominal, raw_runs, warnings = prepared(nominal, [*records, *holdouts])
    warnings = [*copies, *warnings]
    drive = nominal.drive
    check_alike(raw_runs)
    for run in raw_runs:
        check_record(run, drive)
    replay, paper = Replay(drive, nominal.library, nominal.simulation.substeps), start(nominal)
    runs, counts = [], []
    for run in raw_runs:
        on_paper = {name: values[0] for name, values in replay.simulate(run, [paper.variant()]).items()}
        warnings += check_alignment(run, on_paper)
        mended, n_held = bridged(run, on_paper)
        runs.append(mended.beside(on_paper))
        counts.append(n_held)
    split, judged_on = split_runs(runs[: len(records)], runs[len(records) :], floors(runs))
    held = held_mark(raw_runs, runs, counts)
    marks = [] if held is None else [held]
    if (grid := grid_mark(runs, replay)) is not None and mean_energy(grid, split.floors) > SMALLEST_GAIN:
        split = dataclasses.replace(split, floors=raised(split.floors, grid.energy))
        marks.append(grid)
    return Aligned(
        nominal=nominal,
        runs=runs,
        replay=replay,
        split=split,
        judged_on=judged_on,
        marks=marks,
        warnings=warnings,
    )


def without_copies(
    records: Sequence[Record], holdouts: Sequence[Record]
) -> tuple[list[Record], list[Record], list[str]]:
    """Return records and held-out ones without those that have the samples of one before them, and what to say."""
    found: tuple[list[Record], list[Record]] = ([], [])
    warnings = []
    for given, kept in zip((records, holdouts), found, strict=True):
        for record in given:
            first = next((other for other in (*found[0], *found[1]) if other == record), None)
            if first is None:
                kept.append(record)
            else:
                warnings.append(
                    f"{record.source}: a copy of {first.source}. It tells nothing of noise and is left out."
                )
    return *found, warnings


def steadied(replay: Replay, ready: Aligned, calibrated: Hypothesis) -> Split:
    """Return the split in which what changes from run to run, about the re-calibrated model, is told from noise."""
    found = Repeatability(replay, calibrated, ready.runs)
    noise: Mapping[str, Floor] = found.floors
    for mark in ready.marks:
        if not mark.bridged:
            noise = raised(noise, mark.energy)
    changes = [found.change(run, noise) for run in ready.split.runs]
    return dataclasses.replace(ready.split, floors=noise, changes=changes)


def split_runs(records: Sequence[Run], holdouts: Sequence[Run], found: Mapping[str, Floor]) -> tuple[Split, str]:
    """Return what is fitted and what is judged on.

    With held-out records these are judged on; else the last laps of records that repeat themselves, else the last of
    repeated records, else the last third of each record.
    """
    if holdouts:
        fitted, judged = merged(records), merged(holdouts)
        masks = [np.zeros(run.n_samples, dtype=np.bool_) for run in fitted]
        masks += [np.ones(run.n_samples, dtype=np.bool_) for run in judged]
        return Split(runs=[*fitted, *judged], held_out=masks, floors=found), "held-out"
    last = [run for index, run in enumerate(records) if _is_last_repeat(records, index)]
    if last:
        return split_runs([run for run in records if run not in last], last, found)[0], "held-out repeats"
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
    heads: Heads | None = None,
) -> Diagnosis:
    """Diagnose the gap between a nominal model and records of the real axis.

    Parameters
    ----------
    nominal : Nominal
    records, holdouts : sequences of Record
        Fitted on, and judged on.
    progress : callable, optional
    heads : Heads, optional
        What probabilities are drawn from; without, those that the package was shipped with.

    Raises
    ------
    RecordError
        If there are no records, or one lacks what is needed; the message says what to do.
    """
    ready = aligned(nominal, records, holdouts)
    nominal, split, paper = ready.nominal, ready.split, start(ready.nominal)
    drive, replay = nominal.drive, ready.replay.coarsened(split.runs, split.floors)
    search = Search(replay, split, progress)
    raw = float(channel_gaps(replay, split, paper).mean())
    search.progress("re-calibrating the values on paper")
    calibrated = search.refine(paper)
    split = search.split = steadied(replay, ready, calibrated)
    replay = search.replay = ready.replay.coarsened(split.runs, split.floors)
    base = search.refine(calibrated)
    split = search.split = split.beside(gather(replay, split, base, ()))
    final, stages = search.run(base)
    final, contests = search.review(final, stages)
    shut = closure(replay, split.plain, calibrated, final)
    both = [replay.simulate(run, [calibrated.variant(), final.variant()]) for run in split.runs]
    simulated, repaired = ([{name: values[i] for name, values in own.items()} for own in both] for i in range(2))
    seen = [mark for mark in ready.marks if mean_energy(mark, split.plain.floors) > SMALLEST_GAIN]
    findings = Findings(
        search=search,
        paper=paper,
        base=base,
        final=final,
        stages=stages,
        contests=contests,
        shut=shut,
        marks=seen,
    )
    heads = heads or confidence.heads()
    judged = verdict(findings, heads)
    reader = Reader(heads=heads, unknown=judged.answer["unknown_probability"])
    answer = {
        "gap": {"channels": channels_of(replay, split, paper, calibrated, final)},
        "where": where(Gaps.of(split.plain, simulated)),
        **judged.answer,
        "rest_depends_on": types(split.plain, repaired, drive),
        "shrinkage": shrinkage(shut, final, seen, split.plain, ready.judged_on, raw),
        "next_experiment": propose(replay, split, [*contests, *stages[-1:]], nominal, reader),
        "warnings": ready.warnings,
        "parametric": parametric(raw, shut, calibrated),
        "noise_floor": {
            name: noise_floor(floor, unit_of(name), split.runs[0].period_s) for name, floor in split.floors.items()
        },
    }
    return Diagnosis(
        answer=answer,
        calibrated=calibrated,
        final=final,
        stages=stages,
        split=split,
        simulated=simulated,
        signs=judged.signs,
    )


def noise_floor(floor: Floor, unit: str, period_s: float) -> dict[str, Any]:
    """Return the floor of a channel: what repeats differ by, its parts, and that of the noise in bands of frequency."""
    edges = bands_up_to(0.5 / period_s)
    parts = floor.shares([2.0 * period_s * edge for edge in edges]).tolist()
    return {
        "value": floor.total,
        "unit": unit,
        "measured_from_repeats": floor.measured,
        "within_a_run": floor.rms,
        "from_run_to_run": math.sqrt(max(floor.total**2 - floor.rms**2, 0.0)),
        "frequency": [
            {"band_Hz": list(band), "value": floor.rms * math.sqrt(part)}
            for band, part in zip(itertools.pairwise(edges), parts, strict=True)
        ],
    }


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
            "noise_floor": split.floors[name].total,
            "unit": unit_of(name),
            "relative": before / spread if spread > 0.0 else 0.0,
        }
    return result


def mean_energy(mark: Mark, floors: Mapping[str, Floor]) -> float:
    """Return the mean square that an effect brings into the channels, in units of the floor."""
    return float(np.mean(energies(mark, floors)))


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
