"""What each tuned number of the diagnosis does: halved and doubled, each alone, on trials that are for learning.

Writes docs/reference/settings.md. What is done is kept, a line for each case, number and factor, so that a run that was
stopped goes on where it ended. A case is simulated once; with another number only what that has not seen yet. What no
case reads, or what leaves all that the search starts from as it was, is not diagnosed again: its answers are the same.
"""

import argparse
import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any
from unittest.mock import patch

import numpy as np
from threadpoolctl import threadpool_limits

from fdbench.diagnosis import diagnose as stages
from fdbench.diagnosis.evidence import prepare as evidence
from fdbench.diagnosis.judge import verdict as judges
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.replay import Replay, Replayed
from fdbench.diagnosis.settings import STAGES, Setting, changed, settings
from fdbench.effects import effects
from fdbench.errors import FdbenchError
from fdbench.record import FloatArray, Record
from fdbench.trials import seal
from fdbench.trials.answer import read_case
from fdbench.trials.make import make, read_manifest
from fdbench.trials.score import AnswerTable, exact_set, top
from fdbench.units import unit_of
from fdbench.virtual_axes.cases import Tier

NONCE = "5e77" * 8
TIERS = (Tier.L, Tier.G)  # the others are sealed
FACTORS = (0.5, 2.0)
SUREST = 1e-3  # nearest that a probability comes to 0 or 1 in the logarithmic score
PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "settings.md"
SCORES = {"top_1": "top-1", "exact": "exact set", "log_score": "logarithmic score"}
ORDER = ("search", "evidence", "model", "judge", "records", "plausible", "baseline", "experiment")


class Judged(Exception):
    """The verdict is there; what a diagnosis does after it changes no probability."""

    def __init__(self, found: judges.Verdict) -> None:
        super().__init__()
        self.found = found


class SameStart(Exception):
    """The search starts from what it started from before."""


# ---- one case ----


class CaseBench:
    """One case, diagnosed once with all simulations and reads of numbers kept, and again with other numbers."""

    def __init__(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> None:
        self.given = nominal, records, holdouts
        self.known: dict[tuple[Any, ...], dict[str, FloatArray]] = {}
        self.read: dict[str, set[str]] = {"before": set(), "after": set()}
        self.start = ""
        with reads(self.read["before"]) as into:
            self.base = self._verdict(into)

    def _verdict(self, into: list[set[str]] | None = None, only_start: bool = False) -> judges.Verdict:
        """Return the verdict; ``into`` takes the reads of the search, and ``only_start`` ends where it would begin."""

        def aligned(*given: Any) -> evidence.Aligned:
            found = prepare(*given)
            start = fingerprint(found)
            if into is not None:
                self.start, into[0] = start, self.read["after"]
            elif only_start and start == self.start:
                raise SameStart
            return found

        def judged(*given: Any) -> judges.Verdict:
            raise Judged(judge(*given))

        def fill(replay: Replay, replayed: Sequence[Replayed]) -> None:
            new = []
            for item in replayed:
                run, places = item.run, []
                own = (hashlib.sha256(run.reference.tobytes()).digest(), run.start, run.period_s, replay.substeps)
                for variant, place in zip(item.variants, item.places, strict=True):
                    row = self.known.get((*own, variant.plant, variant.extra))
                    if row is None:
                        places.append((variant, place))
                    else:
                        for name, values in row.items():
                            item.channels[name][place] = values
                new.append((own, replace(item, variants=[v for v, _ in places], places=[p for _, p in places])))
            filled(replay, [item for _, item in new])
            if into is not None:
                for own, item in new:
                    for variant, place in zip(item.variants, item.places, strict=True):
                        row = {name: values[place].copy() for name, values in item.channels.items()}
                        self.known[(*own, variant.plant, variant.extra)] = row

        prepare, judge, filled = evidence.aligned, judges.verdict, Replay.fill
        with (
            patch.object(stages, "aligned", aligned),
            patch.object(stages, "verdict", judged),
            patch.object(Replay, "fill", fill),
        ):
            try:
                stages.diagnose(*self.given)
            except Judged as stopped:
                return stopped.found
        raise AssertionError

    def with_other(self, name: str, value: Any) -> judges.Verdict | None:
        """Return the verdict with another number; None where it is the same for sure."""
        if not any(name in names for names in self.read.values()):
            return None
        with changed({name: value}):
            try:
                return self._verdict(only_start=name not in self.read["after"])
            except SameStart:
                return None


@contextmanager
def reads(first: set[str]) -> Iterator[list[set[str]]]:
    """Put the names of all numbers that are read into the set that the list holds."""
    into, stages = [first], {id(stage): name for name, stage in STAGES.items()}

    def recording(stage: Any, name: str) -> Any:
        into[0].add(f"{stages[id(stage)]}.{name}")
        return object.__getattribute__(stage, name)

    for stage in STAGES.values():
        type(stage).__getattribute__ = recording  # type: ignore[assignment]
    try:
        yield into
    finally:
        for stage in STAGES.values():
            del type(stage).__getattribute__


def fingerprint(ready: evidence.Aligned) -> str:
    """Return a digest of all that the search starts from."""
    found = hashlib.sha256()
    for run in (*ready.runs, *ready.split.runs):
        for values in (run.reference, *run.channels.values()):
            found.update(values.tobytes())
        found.update(repr((run.lap, run.repeats, run.start)).encode())
    for mask in ready.split.held_out:
        found.update(mask.tobytes())
    for name, floor in ready.split.noise_models.items():
        found.update(name.encode() + floor.spectrum.tobytes())
    for artefact in ready.artefacts:
        found.update(repr(artefact).encode())
    found.update(repr((ready.nominal, len(ready.others))).encode())
    return found.hexdigest()


def scored(found: judges.Verdict, case: "Sealed") -> dict[str, float]:
    """Return the scores of one case; top-1 is not a number where more or less than one listed effect is there."""
    chances: dict[str, float] = {}
    for cause in found.causes:
        for name, chance in cause.alternatives.items():
            chances[name] = max(chances.get(name, 0.0), chance)
    chances |= {suspect.effect: suspect.probability for suspect in found.suspects}
    chances |= {cause.effect: cause.probability for cause in found.causes}
    listed = {item["name"] for item in case.truth["listed"]}
    nothing = np.array([math.nan])
    table = AnswerTable(
        effects=list(case.effects),
        types=[effects.get(name).type_of() for name in case.effects],
        chances=np.array([[chances.get(name, 0.0) for name in case.effects]]),
        present=np.array([[float(name in listed) for name in case.effects]]),
        unknown=np.array([found.unknown_probability]),
        none=np.array([found.no_gap_probability]),
        has_unknown=np.array([float(bool(case.truth["unlisted"]))]),
        closure=nothing,
        oracle_closure=nothing,
    )
    own = np.where(table.present > 0.0, table.chances, 1.0 - table.chances)
    return {
        "top_1": top(table, 1),
        "exact": exact_set(table),
        "log_score": float(np.log(np.clip(own, SUREST, 1.0 - SUREST)).sum()),
    }


# ---- all cases ----


def other(setting: Setting, factor: float) -> Any:
    """Return a number, or each of several, at another distance from its zero; counts stay whole and above zero."""

    def moved(value: Any) -> Any:
        far = setting.zero + factor * (value - setting.zero)
        return max(1, round(far)) if isinstance(value, int) else far

    value = setting.value
    return tuple(map(moved, value)) if isinstance(value, tuple) else moved(value)


@dataclass(frozen=True, kw_only=True)
class Sealed:
    """A case of a trial with its opened truth."""

    name: str
    place: Path
    truth: Mapping[str, Any]
    files: Sequence[str]
    effects: Sequence[str]

    @property
    def size(self) -> int:
        """Bytes of its records, which its time goes with."""
        return sum((self.place / file).stat().st_size for file in self.files)


def trials(folder: Path, count: int) -> list[Sealed]:
    """Return the cases of the tiers in turn, shortest records first, so that most cases are done in a given time."""
    found = []
    for tier in TIERS:
        place, key = folder / tier.value, folder / f"{tier.value}.key.json"
        if not key.exists():
            make(place, key, tier, count, NONCE)
        manifest, opened = read_manifest(place), seal.read_json(key, "the key of a trial")
        cases = [
            Sealed(
                name=f"{tier.value}{name}",
                place=place / name,
                truth=opened["cases"][name]["truth"],
                files=list(case["files"]),
                effects=manifest["effects"],
            )
            for name, case in manifest["cases"].items()
        ]
        found.append(sorted(cases, key=lambda case: case.size))
    return [case for pair in zip(*found, strict=True) for case in pair]


def run(folder: Path, count: int, part: int, parts: int) -> None:
    known = settings()
    names = sorted(known, key=lambda name: ORDER.index(name.partition(".")[0]))
    done = {(line["case"], line["number"], line["factor"]) for line in lines(folder)}
    with (folder / "lines.jsonl").open("a", encoding="utf-8") as file, threadpool_limits(1):

        def keep(**line: Any) -> None:
            file.write(json.dumps({**line, "code": seal.code_digest()[:12]}) + "\n")
            file.flush()

        for sealed in trials(folder, count)[part - 1 :: parts]:
            case = sealed.name
            left = [(name, factor) for name in names for factor in FACTORS if (case, name, factor) not in done]
            if not left:
                continue
            begun = process_time()
            bench = CaseBench(*read_case(sealed.place, sealed.files))
            base = scored(bench.base, sealed)
            print(f"{case}: {process_time() - begun:.1f} s CPU, {len(bench.read['after'])} numbers read", flush=True)
            for name, factor in left:
                value = other(known[name], factor)
                try:
                    found = bench.with_other(name, value)
                    scores = base if found is None else scored(found, sealed)
                    keep(case=case, number=name, factor=factor, value=value, base=base, scores=scores)
                except (FdbenchError, ValueError, IndexError, np.linalg.LinAlgError) as error:
                    keep(case=case, number=name, factor=factor, value=value, base=base, failed=repr(error))
            print(f"{case}: {process_time() - begun:.1f} s CPU", flush=True)


def lines(folder: Path) -> list[dict[str, Any]]:
    path = folder / "lines.jsonl"
    return [json.loads(text) for text in path.read_text("utf-8").splitlines()] if path.exists() else []


# ---- the page ----


def row(name: str, setting: Setting, own: Sequence[Mapping[str, Any]]) -> str:
    cells = [f"`{name}`", value_text(setting), setting.meaning, setting.origin]
    for factor in FACTORS:
        # What was run with another number than today's is of no use.
        asked = json.loads(json.dumps(other(setting, factor)))
        chosen = [line for line in own if line["factor"] == factor and line["value"] == asked]
        cells.append(effect(chosen))
    return f"| {' | '.join(cells)} |"


def value_text(setting: Setting) -> str:
    values = setting.value if isinstance(setting.value, tuple) else (setting.value,)
    return f"{', '.join(f'{value:.6g}' for value in values)} {unit_of(setting.name)}".strip()


def effect(own: Sequence[Mapping[str, Any]]) -> str:
    """Return the mean paired differences with their standard errors, or in words that there is none."""
    if not own:
        return "not run"
    failed = [line for line in own if "failed" in line]
    run_ = [line for line in own if "failed" not in line]
    words = [f"{len(failed)} fail"] if failed else []
    for key, title in SCORES.items():
        differences = [line["scores"][key] - line["base"][key] for line in run_]
        found = np.array([value for value in differences if math.isfinite(value)])
        if found.any():
            error = f" ± {found.std(ddof=1) / math.sqrt(len(found)):.1g}" if len(found) > 1 else ""
            words.append(f"{title} {found.mean():+.2g}{error}")
    return f"{'; '.join(words) or 'same'} ({len(own)})"


def page(found: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    cases = sorted({str(line["case"]) for line in found})
    yield "# Tuned numbers of the diagnosis"
    yield ""
    yield "<!-- Written by benchmarks/settings_sensitivity.py; edit fdbench/diagnosis/settings.py, not this page. -->"
    yield ""
    yield f"Each number alone is halved and doubled (those with a zero of 1 in their distance from it) on {len(cases)}"
    yield f"simulated axes of tiers that are for learning: {', '.join(cases)}. Given is by how much the mean over these"
    yield "cases changes, with the standard error of the paired difference: share of cases with the injected effect"
    yield "first (top-1, of cases with one), share with exactly the injected effects named (exact set), and the"
    yield "logarithm of the probability given to what is there and not there, summed over effects (logarithmic score;"
    yield "higher is better). A change of less than two standard errors is noise, and so few cases show large effects"
    yield 'alone. "same": no score of any case changes, as for numbers by which records are refused, or answers are'
    yield "written, or experiments proposed. In brackets: cases; a difference of one case has no standard error."
    yield ""
    yield "Values are read as `fdbench.diagnosis.settings.SEARCH.smallest_gain`, and set for one diagnosis by"
    yield '`with fdbench.diagnosis.settings.changed({"search.smallest_gain": 0.02}):`.'
    by_number: dict[str, list[Mapping[str, Any]]] = {}
    for line in found:
        by_number.setdefault(line["number"], []).append(line)
    for title, stage in STAGES.items():
        yield ""
        yield f"## {title}"
        yield ""
        yield str(stage.__doc__)
        yield ""
        yield "| number | value | meaning | origin | halved | doubled |"
        yield "| --- | ---: | --- | --- | --- | --- |"
        for name, setting in settings().items():
            if setting.stage is stage:
                yield row(name, setting, by_number.get(name, []))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/settings"), help="folder of trials and lines")
    parser.add_argument("--count", type=int, default=12, help="cases of each tier")
    parser.add_argument("--part", default="1/1", help="I/N: every Nth case from the Ith, to share the work")
    parser.add_argument("--table", action="store_true", help="run nothing, write the page from what is there")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    if not given.table:
        run(given.out, given.count, *map(int, given.part.split("/")))
    PAGE.write_text("\n".join(page(lines(given.out))) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
