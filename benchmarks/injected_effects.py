"""Effects injected in the record of a real axis, and whether its verdict is the same on other parts of the record.

What an effect changes in closed loop is simulated with the published model of EMPS, and added to the measured channels;
noise, and all that the model lacks, stay real. The data are the user's own copy; see ``examples/emps``.
"""

import argparse
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from diagnosis_recall import causes, probability, rate, words

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.nominal import Nominal, load_nominal
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import noise_models
from fdbench.diagnosis.records.runs import RecordedRun, prepare
from fdbench.effects import Effect, Port
from fdbench.reading import read_record
from fdbench.record import FloatArray, Record

EXAMPLE = Path(__file__).parent.parent / "examples" / "emps"
LEVEL = 25.0  # mean square of what is injected, in units of the floor; the axis's own gap is 52
LARGEST = 4.0  # times the typical size
OFF_NOMINAL = 5.0  # standard deviations of a nominal parameter, where that is what is injected
ROUNDS = 4  # of scaling, as not every effect is linear in its size
HALF = 2  # laps


@dataclass(frozen=True, kw_only=True, eq=False)
class Injected:
    """An effect, its parameters, and the mean square that it brings beside other nominal parameters."""

    effect: Effect
    visible: float
    record: Record

    @property
    def name(self) -> str:
        return type(self.effect).name


class MeasuredAxis:
    """A record of a real axis and the nominal model, which says what an effect would change in it."""

    def __init__(self, nominal: Nominal, record: Record) -> None:
        self.nominal, self.record = nominal, record
        self.run: RecordedRun = prepare(record, nominal.drive)
        self.noise_models = noise_models([self.run])
        self.replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
        self.paper = start(nominal)
        moved = [self.paper.moved(row) for row in np.eye(len(self.paper.shifts))]
        self.values, _ = np.linalg.qr(np.stack([self.joined(self.change(item)) for item in moved], axis=1))

    def change(self, hypothesis: Hypothesis) -> dict[str, FloatArray]:
        """Return what a hypothesis changes in each channel against the nominal model."""
        simulated = self.replay.simulate(self.run, [self.paper.variant, hypothesis.variant])
        return {name: both[1] - both[0] for name, both in simulated.items()}

    def joined(self, change: Mapping[str, FloatArray]) -> FloatArray:
        """Return a change in units of the floor, all channels in a row."""
        return np.concatenate([values / self.noise_models[name].rms for name, values in change.items()])

    def visible(self, effect: Effect) -> float:
        """Return the mean square of an effect in units of the floor, beside nominal parameters if it is none itself."""
        signature = self.joined(self.change(self.paper.with_effect(effect)))
        if not type(effect).calibrates:
            signature = signature - self.values @ (self.values.T @ signature)
        return float(np.mean(signature**2))

    def sized(self, kind: type[Effect]) -> Effect | None:
        """Return an effect of the size that is injected; None where it would have to be too large."""
        effect = kind.typical()
        if kind.calibrates:
            own = [item for item in nominal_parameters(self.nominal) if item.cause(self.nominal) == kind.name]
            step = math.hypot(*(item.size(self.nominal.drive) for item in own))
            return effect.changed(**{kind.amplitude: OFF_NOMINAL * step}) if own else None
        scale = 1.0
        for _ in range(ROUNDS):
            scale *= math.sqrt(LEVEL / max(self.visible(effect), 1e-12))
            if not scale <= LARGEST:
                return None
            effect = kind.typical().scaled(scale)
        return effect

    def inject(self, kind: type[Effect]) -> Injected | None:
        """Return the record with an effect injected, or None where the motion does not show it."""
        effect = self.sized(kind)
        if effect is None:
            return None
        change = self.change(self.paper.with_effect(effect))
        columns = dict(self.record.columns)
        for name in ("position_m", "motor_position_m"):
            columns[name] = columns[name] + change["position_m"]
        columns["motor_force_N"] = columns["motor_force_N"] + change["motor_force_N"]
        source = f"{self.record.source} with {kind.name}"
        return Injected(effect=effect, visible=self.visible(effect), record=Record(columns, source=source))

    def kinds(self) -> list[type[Effect]]:
        """Return what can be injected: effects of a rigid axis that are added, and smooth in their size."""
        return [
            kind
            for kind in self.nominal.library
            if not kind.needs_screw
            and kind.port is not Port.TABLE_SCALE
            and "is_resolved_around_its_typical_size" not in kind.expected_failures
            and all(kind.in_place_of(known) is None for known in self.nominal.drive.effects)
        ]


def size_of(effect: Effect) -> str:
    """Return the amplitudes and periods of an effect in words."""
    kind = type(effect)
    shown = {kind.amplitude, *kind.further_amplitudes} | {item.name for item in kind.parameters() if item.locate}
    items = [item for item in kind.parameters() if item.name in shown]
    return ", ".join(f"{getattr(effect, item.name):.3g} {item.unit}" for item in items)


def found_size(answer: Mapping[str, Any], effect: Effect) -> str:
    """Return the same of what was found."""
    cause = next((item for item in answer["causes"] if item["effect"] == type(effect).name), None)
    if cause is None:
        return "-"
    if "change" in cause["parameters"]:
        return "{value:.3g} {unit}".format(**cause["parameters"]["change"])
    kind = type(effect)
    shown = {kind.amplitude, *kind.further_amplitudes} | {item.name for item in kind.parameters() if item.locate}
    return ", ".join(
        f"{item['value']:.3g} {item['unit']}" for name, item in cause["parameters"].items() if name in shown
    )


def injected_table(axis: MeasuredAxis, native: Mapping[str, Any]) -> None:
    own = list(causes(native))
    documented = max(native["causes"], key=lambda cause: cause["share"])["effect"]
    print(f"\nWith nothing injected: {words(own)}.")
    print(f"Injected: {LEVEL:g} times the floor; nominal parameters off by {OFF_NOMINAL:g} standard deviations.\n")
    print("| injected | size | visible | p | found | named | native cause kept | other causes | unknown | CPU s |")
    print("| --- | --- | ---: | ---: | --- | --- | --- | --- | ---: | ---: |")
    hits, alike, kept = [], [], []
    for kind in axis.kinds():
        injected = None if kind.name == documented else axis.inject(kind)
        if injected is None:
            continue
        began = process_time()
        answer = diagnose(axis.nominal, [injected.record]).answer.as_json()
        seconds = process_time() - began
        named = causes(answer)
        instead = [name for name, cause in named.items() if injected.name in cause["indistinguishable_from"]]
        hits.append(injected.name in named)
        alike.append(injected.name in named or bool(instead))
        kept.append(documented in named)
        cells = [
            injected.name,
            size_of(injected.effect),
            f"{injected.visible:.0f}",
            f"{probability(answer, injected.name):.2f}",
            found_size(answer, injected.effect),
            "yes" if hits[-1] else f"as {words(instead)}" if instead else "no",
            "yes" if kept[-1] else "no",
            words([name for name in named if name not in (injected.name, documented)]),
            f"{answer['unknown_probability']:.2f}",
            f"{seconds:.1f}",
        ]
        print(f"| {' | '.join(cells)} |", flush=True)
    print(f"\n- injected effect named: {rate(hits)}")
    print(f"- named, or said to look like what is named: {rate(alike)}")
    print(f"- {documented} still named: {rate(kept)}")


# ---- the same verdict on other parts of the record ----


def part(record: Record, first: int, last: int, name: str) -> Record:
    columns = {key: values[first:last] for key, values in record.columns.items()}
    return Record({**columns, "time_s": columns["time_s"] - columns["time_s"][0]}, source=name)


def parts(axis: MeasuredAxis) -> dict[str, tuple[list[Record], list[Record]]]:
    """Return records to fit and to judge on, by what they are."""
    lap = axis.run.lap
    if lap is None:
        raise SystemExit("the record has no laps")
    n = axis.record.n_samples
    laps = [part(axis.record, first, first + n % lap, f"lap {1 + first // lap}") for first in range(0, n, lap)]
    first, second = part(axis.record, 0, HALF * lap, "first half"), part(axis.record, HALF * lap, n, "second half")
    return {
        "whole record": ([axis.record], []),
        "first half, judged on the second": ([first], [second]),
        "second half, judged on the first": ([second], [first]),
        "first half alone": ([first], []),
        "second half alone": ([second], []),
        "odd laps, judged on even": (laps[::2], laps[1::2]),
        "even laps, judged on odd": (laps[1::2], laps[::2]),
    }


def stability_table(axis: MeasuredAxis) -> dict[str, Any]:
    """Print the verdict on each part, and return that on the whole record."""
    answers = {
        name: diagnose(axis.nominal, records, holdouts).answer.as_json()
        for name, (records, holdouts) in parts(axis).items()
    }
    every: Sequence[str] = list(dict.fromkeys(name for answer in answers.values() for name in causes(answer)))
    print(f"\n| fitted on | {' | '.join(every)} | unknown | closed (95 %) |")
    print(f"| --- | {'--- | ' * len(every)}---: | --- |")
    for name, answer in answers.items():
        named = causes(answer)
        cells = [
            f"{named[item]['probability']:.2f}: {main_value(named[item])}" if item in named else "-" for item in every
        ]
        low, high = answer["shrinkage"]["ci95"]
        closed = f"{100 * answer['shrinkage']['total']:.0f} ({100 * low:.0f} to {100 * high:.0f}) %"
        print(f"| {name} | {' | '.join(cells)} | {answer['unknown_probability']:.2f} | {closed} |")
    print()
    for item in every:
        print(f"- {item}: {sum(item in causes(answer) for answer in answers.values())} of {len(answers)}")
    return answers["whole record"]


def main_value(cause: Mapping[str, Any]) -> str:
    """Return the first parameter of a cause, which is its amplitude."""
    return "{value:.3g} {unit}".format(**next(iter(cause["parameters"].values())))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    folder = os.environ.get("FDBENCH_DATA")
    default = Path(folder) / "emps" if folder else EXAMPLE
    parser.add_argument("--data", type=Path, default=default, help="folder of DATA_EMPS.mat")
    given = parser.parse_args()
    record = read_record(EXAMPLE / "emps.toml", given.data)
    axis = MeasuredAxis(load_nominal(EXAMPLE / "model.toml"), record)
    injected_table(axis, stability_table(axis))


if __name__ == "__main__":
    main()
