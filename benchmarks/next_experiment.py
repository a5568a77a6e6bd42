"""Does the proposed experiment find the cause more often than another one?

Axes of the package's simulator have one effect of the library each, which shows in some motion of a trial as in tier A
but perhaps not at constant speeds, background effects that are small in every motion that may be tried, and slightly
wrong nominal parameters.
First only constant speeds are recorded. Where the verdict is ambiguous, one motion of each kind of the menu is recorded
beside them, and the one that was proposed if it is another; each pair of motions is diagnosed. "Random" is the mean of
the kinds: what drawing one of them gives. The best fixed kind is the one that turns out best on the same cases.

Cases that are done are kept in a file, so that a run can be broken off and go on.
"""

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from _measure import describe_machine
from threadpoolctl import threadpool_limits

from fdbench.diagnosis.diagnose import Diagnosis, diagnose
from fdbench.diagnosis.experiment.menu import Limits, menu, menu_of
from fdbench.diagnosis.experiment.trajectory import Trajectory
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.settings import changed
from fdbench.errors import FdbenchError
from fdbench.record import FloatArray, Record
from fdbench.specification import read
from fdbench.virtual_axes import cases as tiers
from fdbench.virtual_axes import protocol
from fdbench.virtual_axes.bench import ERRORS, Detectability
from fdbench.virtual_axes.library_axis import LibraryAxis, LibraryBench

AMBIGUOUS = 0.9  # probability of the surest claim, "no gap" among them, below which a verdict is ambiguous
REPEATS = 2
BAR, FEWEST = 0.10, 20  # of top-1 above random, and ambiguous cases below which it is not judged
RESAMPLES = 10_000
FIRST, PROPOSED, RANDOM = "no second experiment", "proposed", "random"
NO_GAP = "no gap"
Verdict = dict[str, float]


class Machine:
    """One axis with one effect, which some motion of a trial shows."""

    def __init__(self, seed: int, number: int) -> None:
        self.seed = (seed, number)
        rng = np.random.default_rng(self.seed)
        self.nominal = read(Nominal, tiers.model_tables(rng), "axis.toml")
        motions = protocol.full_protocol(rng).records
        self.speeds = motions["speeds"]
        errors = {name: size * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for name, size in ERRORS.items()}
        bench = LibraryBench(self.nominal, errors, protocol.PERIOD_S)
        sides = ("table_position_m", "motor_position_m")
        self.sides = sides if self.nominal.drive.controller.uses_table else sides[::-1]
        detectability = Detectability(bench, list(motions.values()), self.sides, rng)
        # What is small at constant speeds may be large in another motion, and would be a second effect there.
        limits = Limits.of(self.nominal.drive, self.speeds[:, 0])
        others = [item.reference for item in one_of_each_kind(menu(limits, protocol.PERIOD_S))]
        bench.add_background(Detectability(bench, [self.speeds, *others], self.sides, rng), rng)
        self.injected, self.axis = self._inject(bench, detectability, rng)

    @staticmethod
    def _inject(bench: LibraryBench, detectability: Detectability, rng: np.random.Generator) -> tuple[str, LibraryAxis]:
        names = [name for name in bench.names(listed=True) if not bench.is_nominal_parameter(name)]
        for _ in range(tiers.MOST_DRAWS):
            name = str(rng.choice(names))
            axis = bench.axis({name: bench.draw(name, rng)})
            visible = detectability.mean_square(axis, beside_nominal_errors=True) >= tiers.SMALLEST_SIGNATURE
            if visible and (detectability.noise_amplification(axis, rng) <= tiers.MOST_NOISE_AMPLIFICATION).all():
                return name, axis
        raise FdbenchError(f"{tiers.MOST_DRAWS} draws gave no effect that shows in the motions of a trial.")

    def records(self, name: str, reference: FloatArray, place: int) -> list[Record]:
        """Record a motion; ``place`` sets its noise."""
        rng = np.random.default_rng((*self.seed, 1 + place))
        return [
            tiers.record_of(f"{name}_{repeat}", reference, self.axis.readings(reference, rng), self.sides)
            for repeat in range(REPEATS)
        ]


def chances(found: Diagnosis) -> Verdict:
    """Return the probability of each effect in a verdict, and of no gap."""
    result: Verdict = {NO_GAP: float(found.answer.no_gap_probability)}
    said = [(suspect.effect, suspect.probability) for suspect in found.answer.suspects]
    said += [pair for cause in found.answer.causes for pair in cause.alternatives.items()]
    said += [(cause.effect, cause.probability) for cause in found.answer.causes]
    for name, chance in said:
        result[name] = max(result.get(name, 0.0), chance)
    return result


def one_of_each_kind(every: Sequence[Trajectory]) -> list[Trajectory]:
    """Return the motion in the middle of the list of each kind."""
    kinds = {item.kind: [other for other in every if other.kind == item.kind] for item in every}
    return [items[len(items) // 2] for items in kinds.values()]


def case(seed: int, number: int) -> dict[str, Any]:
    """Return the injected effect and what is said of it after the first motion and, if in doubt, after two."""
    machine = Machine(seed, number)
    records = machine.records("speeds", machine.speeds, 0)
    found = diagnose(machine.nominal, records)
    first = chances(found)
    row: dict[str, Any] = {"seed": seed, "case": number, "planted": machine.injected, FIRST: first}
    if max(first.values()) >= AMBIGUOUS:
        return row
    every = menu_of(found.split, found.final.nominal)
    choice = None if found.forecast is None else found.forecast.trajectory
    tried = one_of_each_kind(every)
    if choice is not None and choice.words not in [item.words for item in tried]:
        tried.append(choice)
    verdicts = {
        item.words: chances(diagnose(machine.nominal, [*records, *machine.records("second", item.reference, place)]))
        for place, item in enumerate(tried, 1)
    }
    kinds = {item.kind: verdicts[item.words] for item in one_of_each_kind(every)}
    expected = found.answer.next_experiment
    return {
        **row,
        "kinds": kinds,
        PROPOSED: first if choice is None else verdicts[choice.words],
        "motion": None if choice is None else choice.words,
        "expected": None if expected is None else dataclasses.asdict(expected)["expected_probability"],
    }


def top_1(verdict: Verdict, injected: str) -> float:
    """Return 1 if no other effect is as probable as the injected one, as on the board of the trials."""
    rest = max((p for name, p in verdict.items() if name not in (injected, NO_GAP)), default=0.0)
    return float(of_truth(verdict, injected) > rest)


def surest(verdict: Verdict, injected: str) -> float:
    """Return 1 if the injected effect is more probable than any other, and than no gap."""
    return top_1(verdict, injected) * float(of_truth(verdict, injected) > verdict[NO_GAP])


def of_truth(verdict: Verdict, injected: str) -> float:
    return verdict.get(injected, 0.0)


def table(rows: Sequence[dict[str, Any]]) -> None:
    """Print both scores of every arm with intervals, and whether the bar is met."""
    open_ = [row for row in rows if "kinds" in row]
    print(
        f"\n{len(rows)} cases, {len(open_)} ambiguous, {sum(row['motion'] is None for row in open_)} without proposal"
    )
    if not open_:
        return
    n = len(open_)
    draws = np.random.default_rng(0).integers(0, n, (RESAMPLES, n))

    def with_interval(values: FloatArray) -> str:
        low, high = np.percentile(values[draws].mean(axis=1), [2.5, 97.5])
        return f"{values.mean():6.3f} [{low:6.3f}, {high:6.3f}]"

    scores = {
        "top-1 of the effects": top_1,
        "surest claim, no gap among them": surest,
        "mean probability of the truth": of_truth,
    }
    for title, score in scores.items():
        arms = {FIRST: np.array([score(row[FIRST], row["planted"]) for row in open_])}
        arms[PROPOSED] = np.array([score(row[PROPOSED], row["planted"]) for row in open_])
        kinds = {
            kind: np.array([score(row["kinds"][kind], row["planted"]) for row in open_]) for kind in open_[0]["kinds"]
        }
        arms[RANDOM] = np.mean(list(kinds.values()), axis=0)
        print(f"\n{title}, 95 % of resampled cases")
        for name, values in {**arms, **{f"always {kind}": values for kind, values in kinds.items()}}.items():
            print(f"  {name:28} {with_interval(values)}")
        best = max(kinds, key=lambda kind: float(kinds[kind].mean()))
        gain = arms[PROPOSED] - arms[RANDOM]
        print(f"  {'proposed less random':28} {with_interval(gain)}")
        print(f"  {f'proposed less {best}':28} {with_interval(arms[PROPOSED] - kinds[best])}")
        if score is top_1:
            judged = "met" if gain.mean() >= BAR else "MISSED"
            print(f"  bar {BAR:.2f} above random: {judged if n >= FEWEST else 'too few cases'}")
    forecasts = [row["expected"]["after"] for row in open_ if row["expected"] is not None]
    if forecasts:
        print(f"\nexpected probability of the truth after the proposed experiment: {np.mean(forecasts):.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ambiguous", type=int, default=5, help="ambiguous cases; about a minute of CPU time each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--store", type=Path, default=Path("results/next_experiment.jsonl"), help="cases that are done")
    chosen = parser.parse_args()
    describe_machine()
    chosen.store.parent.mkdir(parents=True, exist_ok=True)
    lines = chosen.store.read_text("utf-8").splitlines() if chosen.store.exists() else []
    rows = [row for row in map(json.loads, lines) if row["seed"] == chosen.seed]
    start = process_time()
    # No more effects are injected; rounds that look for others would double the time.
    one = changed({"search.most_effects": 1})
    with one, threadpool_limits(1), chosen.store.open("a", encoding="utf-8") as file:
        while sum("kinds" in row for row in rows) < chosen.ambiguous:
            rows.append(case(chosen.seed, len(rows)))
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
    print(f"{process_time() - start:.0f} s of CPU time")
    table(rows)


if __name__ == "__main__":
    main()
