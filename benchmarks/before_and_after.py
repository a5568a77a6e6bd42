"""What has changed since: axes of foreign kinds, recorded before one effect was there and after, diagnosed with both.

Kinds, data sheets, motions, traces of other effects and the sizes of what is planted are those of tier F. Each axis is
recorded as it was, and again with one effect of the library or, in a third of the axes, with nothing: fresh noise, and
friction that differs from run to run. The records after are diagnosed beside those before, and alone.

Every axis is a line of a file, so that a run that was stopped goes on where it ended.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _axes import answered, finished, kept, named, number_of, ranked, words

from fdbench.effects import effects
from fdbench.errors import SimulationDiverged, UnstableLoop
from fdbench.nonce import check_nonce, new_nonce
from fdbench.record import FloatArray
from fdbench.trials import seal
from fdbench.trials.answer import FAILED, read_case
from fdbench.trials.make import MOST_ATTEMPTS, check_usable, listed_effects, write_case
from fdbench.trials.score import per_effect, per_kind, sheet, table_of, text
from fdbench.virtual_axes.cases import Case, Tier, described, inject
from fdbench.virtual_axes.foreign import loops
from fdbench.virtual_axes.foreign.bench import HELD_OUT, ForeignAxis, ForeignBench, record_of
from fdbench.virtual_axes.foreign.kinds import FORMS, kinds, model_of, space_of
from fdbench.virtual_axes.foreign.motions import RECIPES

NAMES = sorted({*listed_effects(), *(name for name in effects.names() if effects.get(name).scales_every_value)})
ONE_IN = 3  # axes on which nothing is planted
BESIDE, ALONE = "beside the records before", "alone"


class BeforeAndAfter(NamedTuple):
    """An axis before and after; what is held out of the records after is so of those before."""

    before: Case
    after: Case


# ---- one axis ----


def draw(number: int, rng: np.random.Generator) -> BeforeAndAfter:
    """Draw an axis as tier F does, and record it with and without what is planted; the kinds take turns."""
    kind = kinds()[number % len(kinds())]
    is_planted = (number + number // len(kinds())) % ONE_IN > 0
    bench = ForeignBench(kind, Tier.F, rng)
    space = space_of(kind, bench.value)

    def command(name: str) -> FloatArray:
        return loops.as_used(FORMS[kind.form], RECIPES[name](space, rng), kind.period_s)

    commands = {name: command(name) for name in kind.motions}
    other = {"other": command("other")} if rng.random() < HELD_OUT else {}
    sides = ("motor_position_m", "table_position_m")
    seen = sides if kind.columns == "both_positions" else sides[-1:] if kind.feedback == "table" else sides[:1]
    planted, sizes = inject(bench, (int(is_planted), 0), NAMES, list(commands.values()), seen, rng)
    repeats = int(rng.integers(1, 4))
    truth = {"kind": kind.name, "repeats": repeats, **described(planted, sizes, bench.names(listed=True))}

    def recorded(axis: ForeignAxis) -> Case:
        return Case(
            model=model_of(kind, bench.value),
            records={
                f"{name}_{repeat + 1}": record_of(axis, name, reference, seen, rng)
                for name, reference in commands.items()
                for repeat in range(repeats)
            },
            holdouts={name: record_of(axis, name, reference, seen, rng) for name, reference in other.items()},
            truth=truth,
            file_format=kind.file_format,
        )

    return BeforeAndAfter(recorded(bench.axis({})), recorded(bench.axis(planted)))


def usable(nonce: str, number: int) -> BeforeAndAfter:
    """Return an axis that its owner would run, before and after; another is drawn anew, as for a trial."""
    for attempt in range(MOST_ATTEMPTS):
        try:
            drawn = draw(number, seal.generator(nonce, f"axis {number} before and after, attempt {attempt}"))
            for case in drawn:
                check_usable(case)
        except (SimulationDiverged, UnstableLoop) as error:
            message = str(error)
        else:
            return drawn
    raise SimulationDiverged(f"axis {number}: {MOST_ATTEMPTS} draws, none of them usable; the last: {message}")


def run(nonce: str, number: int) -> dict[str, Any]:
    """Return the line of an axis: what is planted, and what is said with and without the records before."""
    drawn = usable(nonce, number)
    with tempfile.TemporaryDirectory() as folder:
        places = Path(folder) / "before", Path(folder) / "after"
        (_, *before), (nominal, records, holdouts) = (
            read_case(place, write_case(place, case)) for place, case in zip(places, drawn, strict=True)
        )
    healthy = [record for part in before for record in part]
    said = {BESIDE: answered(nominal, records, holdouts, healthy), ALONE: answered(nominal, records, holdouts)}
    return {"key": f"{nonce}:{number}", "truth": drawn.after.truth, "said": said}


# ---- what is printed ----


def print_scores(lines: Sequence[Mapping[str, Any]], way: str) -> None:
    """Print the score sheet of one way to ask, and the axes on which the planted effect is not the most probable."""
    names = [number_of(line) for line in lines]
    said = [line["said"][way] for line in lines]
    cases = [{**item, "effects": {name: item["effects"].get(name, 0.0) for name in NAMES}} for item in said]
    manifest = {"effects": NAMES, "cases": dict.fromkeys(names)}
    opened = {"cases": {name: {"truth": line["truth"]} for name, line in zip(names, lines, strict=True)}}
    table = table_of(manifest, opened, {"cases": dict(zip(names, cases, strict=True))}, Path(way))
    scores = {
        "diagnoser": way,
        "constant_reference": False,
        "tier": Tier.F.value,
        "cases": len(lines),
        "failed": sum(item["status"] == FAILED for item in said),
        "seconds_per_case": float(np.median([item["seconds"] for item in said])),
        "quantities": sheet(table),
        "effects": per_effect(table),
        "unlisted": [],
        "kinds": per_kind(table, manifest, opened),
    }
    print(f"\n{text(scores)}\n")
    for line in lines:
        print_miss(line, way)


def print_miss(line: Mapping[str, Any], way: str) -> None:
    """Print an axis on which what is planted is not the most probable, or something is named where nothing is."""
    truth, said = line["truth"], line["said"][way]
    planted = {item["name"]: item["mean_square"] for item in truth["listed"]}
    first = next(iter(ranked(said) if planted else named(said)), "")
    if first in planted or not (first or planted):
        return
    there = ", ".join(f"{name} (visible {size:.3g})" for name, size in planted.items()) or "nothing"
    print(f"- axis {number_of(line)}, {truth['kind']}, {truth['repeats']} repeats: {there}; {words(said)}")


def lacks_motion_before(said: Mapping[str, Any]) -> bool:
    """Return whether a record has none of its motion before, so that nothing cancels there."""
    return any("no baseline record" in warning for warning in said["warnings"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--axes", type=int, default=108, help="12 kinds take turns")
    parser.add_argument("--nonce", help="hexadecimal digits from which all is drawn; without, a new secret")
    parser.add_argument("--out", type=Path, default=Path("before_and_after.jsonl"), help="file of the lines")
    given = parser.parse_args()
    nonce = new_nonce() if given.nonce is None else check_nonce(given.nonce)
    print(f"nonce {nonce}, SHA-256 of the code {seal.code_digest()[:12]}", flush=True)
    done = finished(given.out)
    left = [number for number in range(given.axes) if f"{nonce}:{number}" not in done]
    done |= {line["key"]: line for line in kept(given.out, (run(nonce, number) for number in left))}
    lines = [done[f"{nonce}:{number}"] for number in range(given.axes)]
    for way in (BESIDE, ALONE):
        print_scores(lines, way)
    apart = Counter(line["truth"]["kind"] for line in lines if lacks_motion_before(line["said"][BESIDE]))
    kinds_apart = ", ".join(f"{kind} ({count})" for kind, count in apart.items()) or "none"
    print(f"\naxes with records whose motion before was another, so that nothing cancels: {kinds_apart}")


if __name__ == "__main__":
    main()
