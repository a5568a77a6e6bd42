"""Answer a trial: run a diagnoser on records and model of each case, and hand in its answers with their digest."""

import inspect
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fdbench.diagnosis.model.nominal import Nominal, load_nominal
from fdbench.errors import FdbenchError, SpecError
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.trials import seal
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser, diagnosers
from fdbench.trials.make import MANIFEST, MODEL, read_manifest

OK, FAILED = "ok", "failed"


def answer(folder: Path, diagnoser: str, output: Path, progress: Callable[[str], None] | None = None) -> dict[str, Any]:
    """Run a diagnoser on every case, write its answers and their SHA-256, and return them.

    Parameters
    ----------
    folder : Path
        Of `fdbench.trials.make.make`.
    diagnoser : str
        Registered name.
    output : Path
        JSON file; its SHA-256 is written beside it. A file that exists is not overwritten: an answer is final. Until
        all cases are answered, those that are lie in ``<output>.partial``, from which an interrupted run goes on.
    progress : callable, optional

    Raises
    ------
    SpecError
        If there is no trial in the folder, or the output exists.
    """
    if output.exists():
        raise SpecError(f"{output}: exists already; answers are handed in once. Give another file.")
    manifest = read_manifest(folder)
    kind = diagnosers.get(diagnoser)
    kept = output.with_name(f"{output.name}.partial")
    content: dict[str, Any] = {
        "diagnoser": diagnoser,
        "diagnoser_sha256": seal.file_digest(Path(inspect.getfile(kind))),
        "constant": kind.constant,
        "commit": seal.code_commit(),
        "code_sha256": seal.code_digest(),
        "manifest_sha256": seal.file_digest(folder / MANIFEST),
    }
    cases: dict[str, Any] = _kept(kept, content)
    for number, (name, case) in enumerate(manifest["cases"].items(), 1):
        if name in cases:
            continue
        if progress is not None:
            progress(f"case {number} of {len(manifest['cases'])}")
        start = time.perf_counter()
        given = _answer(kind(), folder / name, sorted(case["files"]), manifest["effects"])
        cases[name] = {**given, "seconds": time.perf_counter() - start}
        seal.write_json(kept, {**content, "cases": cases})
    content["cases"] = {name: cases[name] for name in manifest["cases"]}
    seal.write_json(output, content)
    seal.write_digest(output)
    kept.unlink(missing_ok=True)
    return content


def _kept(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the answers of an interrupted run of the same code on the same trial."""
    if not path.exists():
        return {}
    found = seal.read_json(path, "answers that were interrupted")
    same = all(found.get(name) == value for name, value in content.items())
    return dict(found["cases"]) if same else {}


def read_case(place: Path, files: Sequence[str]) -> tuple[Nominal, list[Record], list[Record]]:
    """Return the model of a case, its records and those held out."""
    records, holdouts = (
        [read_record(place / file) for file in files if file.startswith(f"{part}/")] for part in ("records", "holdouts")
    )
    return load_nominal(place / MODEL), records, holdouts


def _answer(diagnoser: Diagnoser, place: Path, files: list[str], effects: list[str]) -> dict[str, Any]:
    """Return what a diagnoser says of one case; a failure is an answer that names nothing."""
    nominal, records, holdouts = read_case(place, files)
    try:
        given, status, message = diagnoser.diagnose(nominal, records, holdouts), OK, ""
        unlisted = sorted(set(given.effects) - set(effects))
        if unlisted:
            raise SpecError(f"{unlisted[0]}: not an effect of this trial.")
    except Exception as error:  # noqa: BLE001 - a case that fails must not lose the others
        words = str(error) if isinstance(error, FdbenchError) else repr(error)
        given, status, message = CaseAnswer(), FAILED, words
    return {
        "status": status,
        "message": message,
        "effects": {name: float(given.effects.get(name, 0.0)) for name in effects},
        "unknown": float(given.unknown),
        "none": float(given.none),
        "closure": None if given.closure is None else float(given.closure),
    }
