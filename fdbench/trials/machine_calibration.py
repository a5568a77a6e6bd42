"""Machine-specific calibration: probability models learned on simulated cases of one machine.

The cases have the motions, columns and noise of its records. The models that the package is shipped with are the prior
mean, from which the machine's own cases move them.
"""

import dataclasses
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from fdbench.cluster import in_processes
from fdbench.diagnosis.answer.virtual_machines import VirtualMachines
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.probability_models import Features, ProbabilityModels
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.documents import LARGEST_JSON, json_value, read_file
from fdbench.effects import effects
from fdbench.errors import FdbenchError, SpecError
from fdbench.record import Record
from fdbench.simulate.compose import cache_folder
from fdbench.trials import seal
from fdbench.trials.forms import check_learned
from fdbench.trials.learn import Claim, claims, fitted
from fdbench.trials.likeness import outcome
from fdbench.trials.make import MOST_ATTEMPTS
from fdbench.trials.recording_setup import RecordingSetup, recording_setup
from fdbench.virtual_axes.library_axis import Noises

MOVED = ("effect", "suspect", "value")


@dataclass(frozen=True, kw_only=True, eq=False)
class MachineCalibration:
    """Probability models of one machine, and the virtual machines that they were learned on."""

    models: ProbabilityModels
    cases: Sequence[Mapping[str, Any]]

    def outcome(self, features: Mapping[str, Mapping[str, Features]]) -> VirtualMachines:
        """Return how the virtual machines were diagnosed, and whether one with such features is like them."""
        return outcome(self.cases, features)


@dataclass(frozen=True, kw_only=True, eq=False)
class _CaseAsked:
    """One case to draw, with all that a process needs for it."""

    setup: bytes
    effect_files: tuple[Path, ...]
    noises: Noises
    number: int


def calibration(
    nominal: Nominal,
    records: Sequence[Record],
    holdouts: Sequence[Record],
    count: int,
    progress: Callable[[str], None] | None = None,
    jobs: int = 1,
) -> MachineCalibration:
    """Return probability models learned on simulated cases of the machine, with the motions and noise of its records.

    Cases are kept in the cache by the digest of all that they depend on; only those that it lacks are simulated.

    Parameters
    ----------
    nominal, records, holdouts
        As for `fdbench.diagnosis.diagnose.diagnose`.
    count : int
        Number of cases.
    progress : callable, optional
    jobs : int
        Processes.

    Raises
    ------
    RecordError, SpecError
        If the records cannot be diagnosed or the model cannot be simulated like them.
    """
    setup = recording_setup(nominal, records, holdouts)
    kept = cache_folder() / f"calibration-{setup.digest}.json"
    cases: dict[int, Any] = {case["number"]: case for case in _kept_cases(kept)} if kept.exists() else {}
    lacking = [number for number in range(count) if number not in cases]
    for case in _drawn(setup, (nominal, [*records], [*holdouts]), lacking, jobs) if lacking else ():
        cases[case["number"]] = case
        seal.write_json(kept, [cases[number] for number in sorted(cases)])
        if progress is not None:
            progress(f"calibration: {count - sum(n not in cases for n in lacking)} of {count} virtual machines")
    chosen = [cases[number] for number in range(count)]
    found = [claim for case in chosen for claim in claims(case["features"], case["truth"])]
    source = f"machine-specific calibration, {count} cases of this machine and its motions"
    return MachineCalibration(models=adapted(found, confidence.models(), source), cases=chosen)


def _drawn(
    setup: RecordingSetup, given: tuple[Nominal, list[Record], list[Record]], numbers: Sequence[int], jobs: int
) -> Iterator[dict[str, Any]]:
    noises = setup.noises()
    if min(jobs, len(numbers)) < 2:
        yield from (_case(setup, noises, number) for number in numbers)
        return
    packed, files = pickle.dumps(given), tuple(effects.files().values())
    asked = [_CaseAsked(setup=packed, effect_files=files, noises=noises, number=number) for number in numbers]
    yield from in_processes(_case_beside, asked, jobs)


def _case_beside(asked: _CaseAsked) -> dict[str, Any]:
    """Return a case in a process of its own, which has to register effects that are files."""
    for file in asked.effect_files:
        if file.stem not in effects.names():
            effects.add_file(file)
    return _case(_unpacked(asked.setup), asked.noises, asked.number)


@lru_cache(maxsize=1)
def _unpacked(setup: bytes) -> RecordingSetup:
    """Return the machine, once in a process: what does not change between its cases is found once."""
    return recording_setup(*pickle.loads(setup))


def _kept_cases(path: Path) -> list[Any]:
    """Return the cases in a file of the cache."""
    where = f"{path}: not the cases of a calibration; remove it"
    try:
        cases: list[Any] = json_value(read_file(path, LARGEST_JSON))
    except (OSError, ValueError) as error:
        raise SpecError(f"{where}: {error}.") from error
    check_learned(cases, where)
    for kind in MOVED:
        names = {*getattr(confidence.models(), kind).features}
        if not all(names <= own.keys() for case in cases for own in case["features"][kind].values()):
            raise SpecError(f"{where}: other features of {kind} than those of this version.")
    for case in cases:
        if not isinstance(case.get("number"), int) or not _are_names(case.get("named")):
            raise SpecError(f"{where}: a case lacks its number, or what was named in it.")
    return cases


def _are_names(named: Any) -> bool:
    return isinstance(named, list) and all(
        isinstance(names, list) and names and all(isinstance(name, str) for name in names) for names in named
    )


def _case(setup: RecordingSetup, noises: Noises, number: int) -> dict[str, Any]:
    """Return a case; one that diverges, or whose records no one would diagnose, is drawn anew."""
    for attempt in range(MOST_ATTEMPTS):
        try:
            found = setup.case(noises, seal.generator(setup.digest, f"case {number} attempt {attempt}"))
            return {**found, "number": number}
        except FdbenchError as error:
            message = str(error)
    raise SpecError(f"--calibrate: case {number + 1}: {MOST_ATTEMPTS} draws, none of them usable; the last: {message}")


def adapted(found: Sequence[Claim], prior: ProbabilityModels, source: str) -> ProbabilityModels:
    """Return probability models moved by claims of causes; a model without claims stays as it is.

    That of an unknown cause stays: moved, it was worse on fresh cases of a machine unlike tier L.
    """
    own = {kind: [claim for claim in found if claim.kind == kind] for kind in MOVED}
    moved: dict[str, Any] = {kind: fitted(some, getattr(prior, kind)) for kind, some in own.items() if some}
    return dataclasses.replace(prior, **moved, source=source)
