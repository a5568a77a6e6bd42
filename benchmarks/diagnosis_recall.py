"""How often the diagnosis names what is there: each effect alone, pairs, nothing; and the time of a verdict.

Axes, errors of nominal parameters, noise and motions are drawn as for blind trials; effects have typical size.
Every case is a line of a file, so that a run that was stopped goes on where it ended.
"""

import argparse
import dataclasses
import itertools
import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import joblib
import numpy as np
from _axes import finished, kept
from threadpoolctl import threadpool_limits

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.runs import prepare
from fdbench.diagnosis.search.stage import Stage
from fdbench.effects import Port, effects
from fdbench.errors import UnstableLoop
from fdbench.record import FloatArray, Record
from fdbench.specification import read
from fdbench.trials import seal
from fdbench.trials.score import NAMED
from fdbench.virtual_axes import cases as tiers
from fdbench.virtual_axes import protocol
from fdbench.virtual_axes.bench import ERRORS, FORCE_NOISE_N, Detectability, Injected
from fdbench.virtual_axes.library_axis import LibraryBench, as_logged

KINDS = {"one": "One effect alone", "pair": "Pairs that are no look-alikes", "none": "Nothing", "time": "Time"}
LENGTHS_S = (10.0, 16.0, 22.0, 28.0, 34.0, 40.0)  # of the records of a verdict that is timed; the last two are held out
# An axis whose loop is not stable is drawn anew: healthy, by the noise of its force against the sensor's; with what is
# injected, by its noise against that of the healthy axis.
LOUD, UNSTABLE, MOST_AXES = 2.0, 30.0, 20
BAR_S = 5.0  # median CPU time of such a verdict on one core, with one effect


@dataclasses.dataclass(frozen=True, kw_only=True)
class InjectedCase:
    """What is injected in which axis; ``seed`` draws the axis, its records and its noise."""

    kind: str
    injected: tuple[str, ...]
    seed: int

    @property
    def key(self) -> str:
        return ":".join((self.kind, "+".join(self.injected), str(self.seed)))


# ---- what is run ----


def plan(rounds: int, n_pairs: int, n_empty: int) -> list[InjectedCase]:
    """Return all cases: each effect ``rounds`` times, then pairs, nothing, and what is timed."""
    bench = LibraryBench(model(np.random.default_rng(0)), ERRORS, protocol.PERIOD_S)
    logged = [name for name in effects.names() if effects.get(name).port is Port.LOGGING]
    names = [*bench.names(listed=True), *logged]
    cases = [InjectedCase(kind="one", injected=(name,), seed=seed) for seed in range(rounds) for name in names]
    pairs = [pair for pair in itertools.combinations(names, 2) if not alike(*pair) and not bench.clash(*pair)]
    order = np.random.default_rng(0).permutation(len(pairs)).tolist()
    cases += [InjectedCase(kind="pair", injected=pairs[place], seed=seed) for seed, place in enumerate(order[:n_pairs])]
    cases += [InjectedCase(kind="none", injected=(), seed=seed) for seed in range(n_empty)]
    pair = next(pairs[place] for place in reversed(order) if all(is_searched(name) for name in pairs[place]))
    timed = [(), *((name,) for name in names), pair]
    return cases + [InjectedCase(kind="time", injected=injected, seed=len(injected)) for injected in timed]


def is_searched(name: str) -> bool:
    """Return whether an effect is found by search, not by re-calibration or in the readings themselves."""
    kind = effects.get(name)
    return not kind.calibrates and (kind.port.is_force or kind.port is Port.TRANSMISSION)


def alike(one: str, other: str) -> bool:
    """Return whether an effect is declared to look like another, or both correct the same nominal parameter."""
    a, b = effects.get(one), effects.get(other)
    return (
        one in b.confusable_with or other in a.confusable_with or (bool(a.calibrates) and a.calibrates == b.calibrates)
    )


def model(rng: np.random.Generator) -> Nominal:
    return read(Nominal, tiers.model_tables(rng), "axis.toml: model")


def long_motions(rng: np.random.Generator) -> list[FloatArray]:
    """Return commands of ``LENGTHS_S`` made of motions of the protocol."""
    found = []
    for length_s in LENGTHS_S:
        parts: list[FloatArray] = []
        while sum(len(part) for part in parts) * protocol.PERIOD_S < length_s:
            drawn = protocol.full_protocol(rng)
            motions = [*drawn.records.values(), *drawn.holdouts.values()]
            parts.append(motions[int(rng.integers(len(motions)))])
        found.append(protocol.joined(*parts)[: round(length_s / protocol.PERIOD_S)])
    return found


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class RecordedCase:
    """Nominal model, records, and what is in them: parameters, and mean squares in units of the noise."""

    nominal: Nominal
    records: Sequence[Record]
    holdouts: Sequence[Record]
    injected: Injected
    visible: Mapping[str, float]


def record(case: InjectedCase, rng: np.random.Generator) -> RecordedCase | None:
    """Draw and record the axis of a case; None where its loop is not stable."""
    nominal = model(rng)
    errors = {name: size * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for name, size in ERRORS.items()}
    bench = LibraryBench(nominal, errors, protocol.PERIOD_S)
    try:
        return _recorded(case, nominal, bench, rng)
    except UnstableLoop:
        return None


def _recorded(
    case: InjectedCase, nominal: Nominal, bench: LibraryBench, rng: np.random.Generator
) -> RecordedCase | None:
    sized = {name: bench.typical(name) for name in case.injected}
    injected = {
        name: {item.name: getattr(effect, item.name) for item in effect.parameters()} for name, effect in sized.items()
    }
    loggers = [effect for effect in sized.values() if effect.port is Port.LOGGING]
    simulated = {name: injected[name] for name, effect in sized.items() if effect.port is not Port.LOGGING}
    if case.kind == "time":
        *fitted, before_last, last = long_motions(rng)
        judged, repeats = [before_last, last], 1
    else:
        drawn = protocol.full_protocol(rng)
        fitted, judged, repeats = list(drawn.records.values()), list(drawn.holdouts.values()), protocol.REPEATS
    sides = ("table_position_m", "motor_position_m")
    sides = sides if nominal.drive.controller.uses_table else sides[::-1]
    axis = bench.axis(simulated)
    detectability = Detectability(bench, fitted, sides, rng)
    if (
        detectability.noise[0, 0] > LOUD * FORCE_NOISE_N
        or not (detectability.noise_amplification(axis, rng) <= UNSTABLE).all()
    ):
        return None

    def recorded(name: str, motion: FloatArray) -> Record:
        readings = axis.readings(motion, rng)
        for logger in loggers:
            readings = as_logged(readings, logger, rng, protocol.PERIOD_S)
        return tiers.record_of(name, motion, readings, sides)

    return RecordedCase(
        nominal=nominal,
        records=[recorded(f"{index}_{turn}", part) for index, part in enumerate(fitted) for turn in range(repeats)],
        holdouts=[recorded(f"held_out_{index}", part) for index, part in enumerate(judged)],
        injected=injected,
        visible={
            name: detectability.mean_square(bench.axis({name: values}), not bench.is_nominal_parameter(name))
            for name, values in simulated.items()
        },
    )


def run(case: InjectedCase) -> dict[str, Any]:
    """Record an axis with what is injected, diagnose it, and return the line of the file."""
    rng = np.random.default_rng([list(KINDS).index(case.kind), case.seed, *"+".join(case.injected).encode()])
    drawn = (record(case, rng) for _ in range(MOST_AXES))
    made = next(item for item in drawn if item is not None)
    compiled(made.nominal, made.holdouts[0])
    with threadpool_limits(1):
        start, start_wall = process_time(), perf_counter()
        found = diagnose(made.nominal, made.records, made.holdouts)
        seconds, seconds_wall = process_time() - start, perf_counter() - start_wall
    answer = found.answer.as_json()
    return {
        "key": case.key,
        "kind": case.kind,
        "planted": made.injected,
        "visible": made.visible,
        "causes": answer["causes"],
        "suspects": answer.get("suspects", []),
        "unknown": answer["unknown_probability"],
        "no_gap": answer["no_gap_probability"],
        "stages": [described(stage) for stage in found.stages],
        "seconds": seconds,
        "seconds_wall": seconds_wall,
    }


def compiled(nominal: Nominal, record: Record) -> None:
    """Simulate a little, so that compiling is not timed."""
    replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
    replay.simulate(prepare(record, nominal.drive), [Variant(plant=nominal.drive)] * 2)


def described(stage: Stage) -> dict[str, Any]:
    """Return a stage of the search as JSON."""
    rivals = zip(stage.rivals, stage.probabilities(), strict=True)
    return {
        "beside": [effect.name for effect in stage.base.effects],
        "misfit": stage.misfit,
        "rivals": [[rival.kind.name, rival.misfit, rival.penalty, probability] for rival, probability in rivals],
    }


# ---- what is printed ----


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Return the 95 % interval of a proportion (Wilson 1927).

    >>> [round(bound, 3) for bound in wilson(9, 10)]
    [0.596, 0.982]
    """
    if n == 0:
        return 0.0, 1.0
    share, spread = hits / n, z * z / n
    centre = (share + spread / 2.0) / (1.0 + spread)
    half = z * math.sqrt(share * (1.0 - share) / n + spread / (4.0 * n)) / (1.0 + spread)
    return centre - half, centre + half


def rate(hits: Sequence[bool]) -> str:
    low, high = wilson(sum(hits), len(hits))
    return f"{sum(hits)} of {len(hits)} ({100 * low:.0f} to {100 * high:.0f} %)"


def causes(line: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the causes that are named, most probable first."""
    order = sorted(line["causes"], key=lambda cause: -cause["probability"])
    return {cause["effect"]: cause for cause in order if cause["probability"] > NAMED}


def probability(line: Mapping[str, Any], name: str) -> float:
    """Return the probability of an effect as a cause, a suspect, or what may be there in place of one."""
    own = [item["probability"] for item in line["causes"] if item["effect"] == name]
    suspects = line.get("suspects", [])
    own = own or [item["probability"] for item in suspects if item["effect"] == name]
    instead = [item.get("alternatives", {}).get(name, 0.0) for item in (*line["causes"], *suspects)]
    return float(max(own or instead, default=0.0))


def size_error(line: Mapping[str, Any], name: str) -> tuple[float, bool | None] | None:
    """Return the relative error of an effect's largest amplitude; None if it is not named.

    Beside it whether its interval has the true one; None without an interval.
    """
    cause = causes(line).get(name)
    if cause is None:
        return None
    kind, injected = effects.get(name), line["planted"][name]
    found = cause["parameters"]
    if "change" in found:  # of a nominal parameter
        true, given = injected[kind.amplitude], found["change"]
    else:
        own = [item for item in (kind.amplitude, *kind.further_amplitudes) if item in found and injected[item] != 0.0]
        typical_size = kind.typical()
        best = max(own, key=lambda item: abs(injected[item] / (getattr(typical_size, item) or 1.0)), default="")
        if not best:
            return None
        true, given = injected[best], found[best]
    bounds = given["ci95"]
    return given["value"] / true - 1.0, None if bounds is None else bounds[0] <= true <= bounds[1]


def named_or_alike(line: Mapping[str, Any], name: str) -> bool:
    """Return whether an effect is named, or said to be indistinguishable from one that is."""
    named = causes(line)
    return name in named or any(name in cause["indistinguishable_from"] for cause in named.values())


def words(names: Sequence[str]) -> str:
    return ", ".join(names) or "-"


def alone_table(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield "| effect | visible | rank | p | look-alikes | also named | unknown | size error | in interval | CPU s |"
    yield "| --- | ---: | ---: | ---: | --- | --- | ---: | ---: | --- | ---: |"
    for line in lines:
        (name,) = line["planted"]
        named = causes(line)
        order = list(named)
        error = size_error(line, name)
        alike = named[name]["indistinguishable_from"] if name in named else []
        cells = [
            name,
            f"{line['visible'][name]:.3g}" if name in line["visible"] else "-",
            str(order.index(name) + 1) if name in named else "-",
            f"{probability(line, name):.2f}",
            words(alike),
            words([other for other in order if other != name]),
            f"{line['unknown']:.2f}",
            "-" if error is None else f"{100 * error[0]:+.0f} %",
            {True: "yes", False: "no", None: "-"}[None if error is None else error[1]],
            f"{line['seconds']:.1f}",
        ]
        yield f"| {' | '.join(cells)} |"
    yield ""
    owned = [(line, next(iter(line["planted"]))) for line in lines]
    errors = [error for error in (size_error(line, name) for line, name in owned) if error is not None]
    yield f"- named: {rate([name in causes(line) for line, name in owned])}"
    yield f"- named first: {rate([next(iter(causes(line)), '') == name for line, name in owned])}"
    yield f"- named, or said to look like what is named: {rate([named_or_alike(line, name) for line, name in owned])}"
    yield f"- named and nothing else: {rate([list(causes(line)) == [name] for line, name in owned])}"
    if errors:
        yield f"- size error of what is named, median: {100 * np.median([abs(error) for error, _ in errors]):.1f} %"
        yield f"- size within its 95 % interval: {rate([inside for _, inside in errors if inside is not None])}"


def pair_table(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield "| pair | visible | p | both named | also named | unknown | CPU s |"
    yield "| --- | --- | --- | --- | --- | ---: | ---: |"
    for line in lines:
        names, named = list(line["planted"]), causes(line)
        cells = [
            " + ".join(names),
            ", ".join(f"{line['visible'][name]:.3g}" if name in line["visible"] else "-" for name in names),
            ", ".join(f"{probability(line, name):.2f}" for name in names),
            "yes" if set(names) <= set(named) else "no",
            words([other for other in named if other not in names]),
            f"{line['unknown']:.2f}",
            f"{line['seconds']:.1f}",
        ]
        yield f"| {' | '.join(cells)} |"
    yield ""
    yield f"- both named: {rate([set(line['planted']) <= set(causes(line)) for line in lines])}"
    each = [named_or_alike(line, name) for line in lines for name in line["planted"]]
    yield f"- each effect, named or said to look like what is named: {rate(each)}"
    yield f"- both named and nothing else: {rate([set(line['planted']) == set(causes(line)) for line in lines])}"


def empty_table(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield f"- no gap is what is said (p > {NAMED}): {rate([line['no_gap'] > NAMED for line in lines])}"
    yield f"- an effect is named (false alarm): {rate([bool(causes(line)) for line in lines])}"
    yield f"- an unknown cause is claimed: {rate([line['unknown'] > NAMED for line in lines])}"
    wrong = [(line["key"].rsplit(":", 1)[1], words(list(causes(line)))) for line in lines if causes(line)]
    yield from (f"- seed {seed}: {names}" for seed, names in wrong)


def time_table(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield f"{len(LENGTHS_S)} records of {min(LENGTHS_S):g} to {max(LENGTHS_S):g} s at 1 kHz, two of them held out."
    yield ""
    yield "| injected | CPU s | wall s | named |"
    yield "| --- | ---: | ---: | --- |"
    for line in lines:
        cells = words(list(line["planted"])), line["seconds"], line["seconds_wall"], words(list(causes(line)))
        yield "| {} | {:.1f} | {:.1f} | {} |".format(*cells)
    yield ""
    if with_one := [line for line in lines if len(line["planted"]) == 1]:
        median = statistics.median(line["seconds"] for line in with_one)
        longest = max(with_one, key=lambda line: line["seconds"])
        yield f"- with one of {len(with_one)} effects: median {median:.1f} s"
        yield f"- longest {longest['seconds']:.1f} s ({words(list(longest['planted']))})"
        yield f"- bar {BAR_S:g} s CPU in the median: {'met' if median <= BAR_S else 'MISSED'}"
        yield f"- it alone is named: {rate([set(causes(line)) == set(line['planted']) for line in with_one])}"


TABLES = {"one": alone_table, "pair": pair_table, "none": empty_table, "time": time_table}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("diagnosis_recall.jsonl"), help="file of the lines")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--rounds", type=int, default=1, help="axes for each effect alone")
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--none", type=int, default=20, help="axes with nothing injected")
    parser.add_argument("--only", choices=KINDS, action="append", help="parts to run; without, all")
    parser.add_argument("--table", action="store_true", help="run nothing, print what is in the file")
    given = parser.parse_args()
    cases = [case for case in plan(given.rounds, given.pairs, given.none) if case.kind in (given.only or KINDS)]
    lines = finished(given.out)
    if not given.table:
        left = [case for case in cases if case.key not in lines]
        code = seal.code_digest()[:12]
        results = joblib.Parallel(n_jobs=given.jobs, return_as="generator_unordered")(map(joblib.delayed(run), left))
        for number, line in enumerate(kept(given.out, ({**line, "code": code} for line in results)), 1):
            lines[line["key"]] = line
            print(f"{number} of {len(left)}: {line['key']}: {words(list(causes(line)))}", flush=True)
    for kind, title in KINDS.items():
        own = [lines[case.key] for case in cases if case.kind == kind and case.key in lines]
        if own:
            print(f"\n### {title}\n")
            print("\n".join(TABLES[kind](own)))
    codes = sorted({line["code"] for line in lines.values()})
    print(f"\nSHA-256 of the code: {words(codes)}")


if __name__ == "__main__":
    main()
