"""Axes of a bench, each a line of a file: what is said of one, what of that comes first, and its words."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from time import process_time
from typing import Any

from threadpoolctl import threadpool_limits

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.errors import FdbenchError
from fdbench.record import Record
from fdbench.trials.answer import FAILED, OK
from fdbench.trials.score import NAMED

SHOWN = 3  # effects in the words of an axis


def finished(file: Path) -> dict[str, dict[str, Any]]:
    """Return the lines of a file by their keys; a last line that was cut off does not count."""
    found = {}
    for text in file.read_text("utf-8").splitlines() if file.exists() else []:
        try:
            line = json.loads(text)
        except json.JSONDecodeError:
            continue
        found[line["key"]] = line
    return found


def kept(file: Path, lines: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield lines as they come, each appended to a file first; what was cut off there stays a line of its own."""
    with file.open("a", encoding="utf-8") as opened:
        if opened.tell() and not file.read_bytes().endswith(b"\n"):
            opened.write("\n")
        for line in lines:
            opened.write(json.dumps(line) + "\n")
            opened.flush()
            yield line


def answered(
    nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record] = (), baseline: Sequence[Record] = ()
) -> dict[str, Any]:
    """Return an answer in the form of a trial's, with its warnings and CPU seconds; a failure names nothing."""
    start = process_time()
    said: dict[str, Any] = {"effects": {}, "unknown": 0.0, "none": 0.0, "closure": None, "warnings": []}
    try:
        with threadpool_limits(1):
            answer = diagnose(nominal, records, holdouts, baseline=baseline).answer
    except FdbenchError as error:
        return {"status": FAILED, **said, "message": str(error), "seconds": process_time() - start}
    return {
        "status": OK,
        "effects": answer.chances(),
        "unknown": answer.unknown_probability,
        "none": answer.no_gap_probability,
        "closure": answer.shrinkage.explained_fraction,
        "warnings": list(answer.warnings),
        "seconds": process_time() - start,
    }


def ranked(said: Mapping[str, Any]) -> list[str]:
    """Return the effects that have a probability, the most probable first."""
    chance = said["effects"]
    return sorted((name for name in chance if chance[name] > 0.0), key=lambda name: -chance[name])


def named(said: Mapping[str, Any]) -> list[str]:
    """Return the effects that are named, the most probable first."""
    return [name for name in ranked(said) if said["effects"][name] > NAMED]


def number_of(line: Mapping[str, Any]) -> str:
    """Return the number of an axis, which stands in its key after the nonce."""
    return str(line["key"]).split(":")[1]


def words(said: Mapping[str, Any]) -> str:
    """Return what is said of an axis: its most probable effects, else the error."""
    given = ", ".join(f"{name} {said['effects'][name]:.2f}" for name in ranked(said)[:SHOWN])
    rest = f"unknown {said['unknown']:.2f}, none {said['none']:.2f}; {said['seconds']:.0f} s"
    return f"said: {given or said.get('message') or '-'}; {rest}"
