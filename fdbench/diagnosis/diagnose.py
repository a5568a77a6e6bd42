"""Diagnose: align, measure the floor, re-calibrate, localise, search, and say what was found."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fdbench.diagnosis.evidence.evidence import Split, gather
from fdbench.diagnosis.evidence.prepare import SMALLEST_ARTEFACT, aligned, steadied
from fdbench.diagnosis.evidence.sensor_artefacts import Mark, mean_energy
from fdbench.diagnosis.experiment.expected_information import Reader
from fdbench.diagnosis.experiment.proposal import propose
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.localise import Gaps, bands_up_to, where
from fdbench.diagnosis.judge.probability_models import Heads, Signs
from fdbench.diagnosis.judge.reduction import Closure, channel_gaps, closure
from fdbench.diagnosis.judge.residual_dependence import types
from fdbench.diagnosis.judge.verdict import Findings, verdict
from fdbench.diagnosis.model.hypothesis import Hypothesis, calibrations, start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import Floor
from fdbench.diagnosis.search.search import Search, Stage
from fdbench.record import FloatArray, Record
from fdbench.units import unit_of


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
        What the probabilities were drawn from; see `fdbench.diagnosis.judge.verdict.Verdict`.
    """

    answer: dict[str, Any]
    calibrated: Hypothesis
    final: Hypothesis
    stages: list[Stage]
    split: Split
    simulated: list[dict[str, FloatArray]]
    signs: Mapping[str, Mapping[str, Signs]]


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
    seen = [mark for mark in ready.marks if mean_energy(mark, split.plain.floors) > SMALLEST_ARTEFACT]
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
