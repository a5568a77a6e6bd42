"""Answer a trial: run a diagnoser on records and model of each case, and hand in its answers with their digest."""

import inspect
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from socket import gethostname
from typing import Any

from fdbench.cluster import Files, alone, in_processes, packed, results, unpack, unpacked
from fdbench.diagnosis.model.nominal import Nominal, load_nominal
from fdbench.effects import effects as library
from fdbench.errors import FdbenchError, SpecError, did_you_mean
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.trials import seal
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser, diagnosers
from fdbench.trials.forms import check_answers
from fdbench.trials.make import MANIFEST, MODEL, read_manifest

OK, FAILED = "ok", "failed"


def answer(
    folder: Path,
    diagnoser: str,
    output: Path,
    progress: Callable[[str], None] | None = None,
    scheduler: str = "",
    jobs: int = 1,
) -> dict[str, Any]:
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
    scheduler : str
        Address of a Dask scheduler, whose workers answer in place of processes here; see `fdbench.cluster`.
    jobs : int
        Processes.

    Raises
    ------
    SpecError
        If there is no trial in the folder, or the output exists.
    FdbenchError
        If the workers cannot answer.
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
    waiting = [
        _Asked(name, diagnoser, content["code_sha256"], tuple(sorted(case["files"])), tuple(manifest["effects"]))
        for name, case in manifest["cases"].items()
        if name not in cases
    ]
    answered = _elsewhere(waiting, folder, scheduler) if scheduler else _here(waiting, folder, jobs)
    total = len(manifest["cases"])
    if progress is not None:
        progress(f"{len(cases)} of {total} cases answered")
    for name, given in answered:
        cases[name] = given
        seal.write_json(kept, {**content, "cases": cases})
        if progress is not None:
            progress(f"{len(cases)} of {total} cases answered")
    content["cases"] = {name: cases[name] for name in manifest["cases"]}
    seal.write_json(output, content)
    seal.write_digest(output)
    kept.unlink(missing_ok=True)
    return content


@dataclass(frozen=True)
class _Asked:
    """What is to be answered, by which diagnoser, and what of the case is there to read.

    ``sent`` has the case's files and, where it is no installed one, the diagnoser's, if they are not at hand.
    """

    name: str
    diagnoser: str
    code_sha256: str
    files: tuple[str, ...]
    effects: tuple[str, ...]
    sent: Files = ()
    diagnoser_file: Files = ()


def _here(waiting: Sequence[_Asked], folder: Path, jobs: int) -> Iterator[tuple[str, dict[str, Any]]]:
    if min(jobs, len(waiting)) < 2:
        yield from ((case.name, _timed(case, folder)) for case in waiting)
    else:
        by_path = diagnosers.files()
        yield from in_processes(_answer_beside, [(case, folder, by_path.get(case.diagnoser)) for case in waiting], jobs)


def _answer_beside(task: tuple[_Asked, Path, Path | None]) -> tuple[str, dict[str, Any]]:
    """Answer a case in a process of its own, which has to register a diagnoser that is a file."""
    case, folder, file = task
    if file is not None and case.diagnoser not in diagnosers.names():
        diagnosers.add_file(file)
    return case.name, _timed(case, folder)


def _elsewhere(waiting: Sequence[_Asked], folder: Path, scheduler: str) -> Iterator[tuple[str, dict[str, Any]]]:
    tasks = []
    for case in waiting:
        paths = [folder / case.name / file for file in (*case.files, MODEL)]
        by_path = diagnosers.files().get(case.diagnoser)
        own = () if by_path is None else packed([by_path], by_path.parent)
        tasks.append(replace(case, sent=packed(paths, folder), diagnoser_file=own))
    yield from ((case.name, given) for case, given in results(_answer_sent, tasks, scheduler, lambda case: case.name))


def _answer_sent(case: _Asked) -> dict[str, Any]:
    """Answer a case on a worker, in a folder that goes with it."""
    if seal.code_digest() != case.code_sha256:
        raise FdbenchError(
            f"code: the worker on {gethostname()} has another version of fdbench than this machine. Install the same "
            "everywhere; what was answered is kept."
        )
    with alone() as place:
        for file, _ in case.diagnoser_file:
            diagnosers.add_file(unpacked(case.diagnoser_file) / file)
        unpack(case.sent, place)
        return _timed(case, place)


def _timed(case: _Asked, folder: Path) -> dict[str, Any]:
    start = time.perf_counter()
    given = _answer(diagnosers.get(case.diagnoser)(), folder / case.name, list(case.files), list(case.effects))
    return {**given, "seconds": time.perf_counter() - start}


def _kept(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the answers of an interrupted run of the same code on the same trial."""
    if not path.exists():
        return {}
    found = seal.read_json(path, "answers that were interrupted")
    if any(found.get(name) != value for name, value in content.items()):
        return {}
    check_answers(found, f"{path}: not answers to a trial")
    whole = {"status", "message", "effects", "unknown", "none", "closure", "seconds"}
    return {name: dict(case) for name, case in found["cases"].items() if case.keys() == whole}


def read_case(place: Path, files: Sequence[str]) -> tuple[Nominal, list[Record], list[Record]]:
    """Return the model of a case, its records and those held out."""
    records, holdouts = (
        [read_record(place / file) for file in files if file.startswith(f"{part}/")] for part in ("records", "holdouts")
    )
    return load_nominal(place / MODEL), records, holdouts


def as_listed(given: CaseAnswer, listed: Sequence[str]) -> CaseAnswer:
    """Return an answer in the names of the trial: an effect that came to the library after it is an unknown cause.

    Raises
    ------
    SpecError
        If a name is in neither.
    """
    others = [name for name in given.effects if name not in listed]
    for name in others:
        if name not in library.names():
            raise SpecError(f"{name}: not an effect of this trial.{did_you_mean(name, listed)}")
    kept = {name: chance for name, chance in given.effects.items() if name in listed}
    unknown = max([given.unknown, *(given.effects[name] for name in others)])
    return replace(given, effects=kept, unknown=unknown)


def _answer(diagnoser: Diagnoser, place: Path, files: list[str], effects: list[str]) -> dict[str, Any]:
    """Return what a diagnoser says of one case; a failure is an answer that names nothing."""
    nominal, records, holdouts = read_case(place, files)
    try:
        found, status, message = diagnoser.diagnose(nominal, records, holdouts), OK, ""
        given = as_listed(found, effects)
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
