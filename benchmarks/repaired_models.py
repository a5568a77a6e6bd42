"""Does the repaired model predict better than the re-calibrated one, where a cause is named?

The cases of a trial are diagnosed, and both models are compared on the samples that neither was fitted to: by channel,
and over all channels by the mean square in units of the noise floor. Effects are chosen by these samples, too; with
``--unseen`` the held-out records are kept from the diagnosis. The key of the trial is not needed.

Every case is a line of a file, so that a run that was stopped goes on where it ended.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _axes import finished, kept
from diagnosis_recall import causes, rate
from threadpoolctl import threadpool_limits

from fdbench.diagnosis.answer.cause import READING, VALUE
from fdbench.diagnosis.diagnose import Diagnosis, diagnose
from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.model.replay import Replay
from fdbench.record import Record
from fdbench.statistics import rms
from fdbench.trials import seal
from fdbench.trials.answer import read_case
from fdbench.trials.make import read_manifest

BAR = 0.95
Line = Mapping[str, Any]


def run(folder: Path, name: str, files: Sequence[str], unseen: bool) -> dict[str, Any]:
    """Diagnose a case, and return the line of the file."""
    nominal, records, holdouts = read_case(folder / name, sorted(files))
    with threadpool_limits(1):
        found = diagnose(nominal, records, [] if unseen else holdouts)
        answer = found.answer.as_json()
        channels = predicted(found, holdouts) if unseen else answer["gap"]["channels"]
    judged_on = "unseen motions" if unseen else answer["shrinkage"]["judged_on"]
    return {"key": name, "causes": answer["causes"], "judged_on": judged_on, "channels": channels}


def predicted(found: Diagnosis, records: Sequence[Record]) -> dict[str, dict[str, float]]:
    """Return the gap of both models on records that the diagnosis did not have, and the noise floor, by channel."""
    nominal = found.final.nominal
    simulation = nominal.simulation
    replay = Replay(nominal.drive, nominal.library, simulation.substeps, simulation.cycles)
    runs = aligned(nominal, records, ()).runs
    gaps: dict[str, dict[str, float]] = {}
    for model, hypothesis in (("recalibrated", found.calibrated), ("repaired", found.final)):
        each = list(replay.on_each(runs, hypothesis.variant))
        for name in runs[0].channels:
            left = [run.channels[name] - own[name] for run, own in zip(runs, each, strict=True)]
            gaps.setdefault(name, {})[model] = rms(np.concatenate(left))
    floors = found.answer.gap.channels
    return {name: {**own, "noise_floor": floors[name].noise_floor} for name, own in gaps.items()}


def effects_added(line: Line) -> list[str]:
    """Return the named causes with which the repaired model differs from the re-calibrated one."""
    return [name for name, cause in causes(line).items() if cause["kind"] not in (VALUE, READING)]


def squares(line: Line, model: str) -> float:
    """Return the mean over the channels of the mean square gap of a model, in units of the noise floor."""
    channels = line["channels"].values()
    return float(sum((item[model] / item["noise_floor"]) ** 2 for item in channels) / len(channels))


def is_better(line: Line) -> bool:
    return squares(line, "repaired") <= squares(line, "recalibrated")


def in_channel(name: str) -> Callable[[Line], bool]:
    return lambda line: bool(line["channels"][name]["repaired"] <= line["channels"][name]["recalibrated"])


def print_shares(lines: Sequence[Line]) -> None:
    """Print how often the repaired model is no worse, and the cases in which it is."""
    for channel in dict.fromkeys(name for line in lines for name in line["channels"]):
        own = [line for line in lines if channel in line["channels"]]
        print(f"- {channel}: {rate(list(map(in_channel(channel), own)))}")
    print(f"- every channel: {rate([all(in_channel(name)(line) for name in line['channels']) for line in lines])}")
    for by in sorted({line["judged_on"] for line in lines}):
        print(f"- all channels together, judged on {by}: {rate([is_better(x) for x in lines if x['judged_on'] == by])}")
    better = [is_better(line) for line in lines]
    met = "met" if sum(better) >= BAR * len(better) else "MISSED"
    print(f"- all channels together: {rate(better)}; bar {BAR:g}: {met}")
    for line in lines:
        worse = [name for name in line["channels"] if not in_channel(name)(line)]
        if worse:
            ratios = ", ".join(
                f"{name} {line['channels'][name]['repaired'] / line['channels'][name]['recalibrated']:.3f}"
                for name in line["channels"]
            )
            together = (squares(line, "repaired") / squares(line, "recalibrated")) ** 0.5
            print(f"    case {line['key']}, {' + '.join(causes(line))}: {ratios}; together {together:.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of a trial")
    parser.add_argument("--cases", type=int, help="the first so many; without, all. Kinds of tier F take turns")
    parser.add_argument("--unseen", action="store_true", help="only cases with held-out records, which are kept back")
    parser.add_argument("--out", type=Path, default=Path("repaired_models.jsonl"), help="file of the lines")
    given = parser.parse_args()
    cases = list(read_manifest(given.folder)["cases"].items())[: given.cases]
    if given.unseen:
        cases = [(name, case) for name, case in cases if any(file.startswith("holdouts/") for file in case["files"])]
    done = finished(given.out)
    left = [(name, case["files"]) for name, case in cases if name not in done]
    lines = (run(given.folder, name, files, given.unseen) for name, files in left)
    done |= {line["key"]: line for line in kept(given.out, lines)}
    named = [done[name] for name, _ in cases if causes(done[name])]
    added = [line for line in named if effects_added(line)]
    print(f"{len(cases)} cases, SHA-256 of the code {seal.code_digest()[:12]}")
    print(f"\nA cause is named, {len(named)} cases:")
    print_shares(named)
    print(f"\nAn effect is added to the model, so that the two differ, {len(added)} cases:")
    print_shares(added)


if __name__ == "__main__":
    main()
