"""Make a trial: records from axes with withheld effects, and the sealed key in a file of its own."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fdbench.cluster import in_processes
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.repaired import toml_lines
from fdbench.errors import SimulationDiverged, SpecError, UnstableLoop
from fdbench.files import write_text
from fdbench.nonce import check_nonce, new_nonce
from fdbench.specification import load_toml, read
from fdbench.trials import seal
from fdbench.trials.forms import check_manifest
from fdbench.version import __version__
from fdbench.virtual_axes.cases import AXIS, Case, Tier, draw_case
from fdbench.virtual_axes.foreign.bench import draw_foreign_case

MANIFEST = "manifest.json"
MODEL = "model.toml"
MOST_ATTEMPTS = 5


def listed_effects() -> list[str]:
    """Return the names that a diagnosis of the trial's axis may give."""
    return [kind.name for kind in read(Nominal, load_toml(AXIS), "axis.toml: model").library]


def make(
    folder: Path,
    key: Path,
    tier: Tier,
    count: int,
    nonce: str | None = None,
    progress: Callable[[str], None] | None = None,
    jobs: int = 1,
) -> dict[str, Any]:
    """Draw and record the cases of a trial, and return its manifest.

    The manifest tells nobody what is injected: it has SHA-256 of the nonce, and SHA-256 of a secret salt and the truth
    of each case. Nonce, salts and truths are the key.

    Parameters
    ----------
    folder : Path
        New or empty; what a diagnoser may see.
    key : Path
        File outside the folder.
    tier : Tier
    count : int
        Number of cases.
    nonce : str, optional
        Hexadecimal digits from which everything is drawn; without, a new secret. The same nonce and code give the same
        trial.
    progress : callable, optional
    jobs : int
        Processes.

    Raises
    ------
    SpecError
        If the folder is not empty, or the key would lie in it or exists.
    """
    nonce = new_nonce() if nonce is None else check_nonce(nonce)
    folder, key = folder.absolute(), key.absolute()
    if key.is_relative_to(folder):
        raise SpecError(f"key: {key} lies in the trial's folder; who answers must not see it. Give a file elsewhere.")
    if key.exists():
        raise SpecError(f"key: {key} exists already; a key is never overwritten.")
    if folder.exists() and any(folder.iterdir()):
        raise SpecError(f"{folder}: not empty; a trial is made in a new folder.")
    effects = listed_effects()
    plans = [_Plan(tier, effects, nonce, f"{number:03d}", folder) for number in range(count)]
    done = in_processes(_made, plans, jobs) if min(jobs, count) > 1 else map(_made, plans)
    made: dict[str, _Made] = {}
    for case in done:
        made[case.name] = case
        if progress is not None:
            progress(f"{len(made)} of {count} cases")
    cases = {name: made[name].public for name in sorted(made)}
    manifest = {
        "fdbench_version": __version__,
        "commit": seal.code_commit(),
        "code_sha256": seal.code_digest(),
        "tier": tier.value,
        "nonce_sha256": seal.commitment(nonce, "nonce"),
        "effects": effects,
        "cases": cases,
    }
    truths = {name: made[name].secret for name in cases}
    seal.write_json(folder / MANIFEST, manifest)
    seal.write_json(key, {"nonce": nonce, "manifest_sha256": seal.file_digest(folder / MANIFEST), "cases": truths})
    return manifest


class _Plan(NamedTuple):
    """A case to be made."""

    tier: Tier
    effects: list[str]
    nonce: str
    name: str
    folder: Path


class _Made(NamedTuple):
    """What the manifest says of a case, and what the key does."""

    name: str
    public: dict[str, Any]
    secret: dict[str, Any]


def _made(plan: _Plan) -> _Made:
    """Write model and records of a case."""
    drawn = _case(plan.tier, plan.effects, plan.nonce, plan.name)
    place = plan.folder / plan.name
    files = write_case(place, drawn)
    salt = seal.salt(plan.nonce, plan.name)
    truth = {"case": plan.name, **drawn.truth}
    public = {
        "truth_sha256": seal.commitment(salt, truth),
        "files": {file: seal.file_digest(place / file) for file in files},
    }
    return _Made(plan.name, public, {"salt": salt, "truth": truth})


def write_case(place: Path, drawn: Case) -> list[str]:
    """Write model and records of a case to a new folder, and return the files by their paths in it, in order."""
    place.mkdir(parents=True)
    write_text(place / MODEL, "\n".join(toml_lines(drawn.model)).lstrip() + "\n")
    for part, records in (("records", drawn.records), ("holdouts", drawn.holdouts)):
        (place / part).mkdir()
        for title, record in records.items():
            record.save(place / part / f"{title}.{drawn.file_format}")
    return [path.relative_to(place).as_posix() for path in sorted(place.rglob("*")) if path.is_file()]


def _case(tier: Tier, effects: list[str], nonce: str, name: str) -> Case:
    """Return a case; an axis on which nothing shows, or that its owner would not run, is drawn anew."""
    for attempt in range(MOST_ATTEMPTS):
        try:
            rng = seal.generator(nonce, f"tier {tier} case {name} attempt {attempt}")
            if tier in (Tier.F, Tier.G):
                drawn = draw_foreign_case(tier, int(name), effects, rng)
            else:
                drawn = draw_case(tier, effects, rng)
            check_usable(drawn)
            return drawn
        except (SimulationDiverged, UnstableLoop) as error:
            message = str(error)
    raise SimulationDiverged(f"case {name}: {MOST_ATTEMPTS} axes, none of them usable; the last: {message}")


def check_usable(drawn: Case) -> None:
    """Raise an error where the owner of an axis would have noticed: an unstable loop, or an end of the way.

    Raises
    ------
    UnstableLoop, SimulationDiverged
    """
    plant = drawn.model["plant"]
    if "controller" in plant:
        record = next(iter(drawn.records.values()))
        read(Nominal, drawn.model, "model").drive.check_loop(record.sampling_time_s)
    for record in (*drawn.records.values(), *drawn.holdouts.values()):
        position = record.get("position_m")
        if position is not None and float(np.ptp(position)) > plant.get("travel_m", np.inf):
            raise SimulationDiverged("the axis reaches an end of its way.")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a trial after a check that no file of a case has changed.

    Raises
    ------
    SpecError
        If there is no trial in the folder, or a file is missing or not the one that was made.
    """
    manifest: dict[str, Any] = seal.read_json(folder / MANIFEST, "the manifest of a trial")
    check_manifest(manifest, f"{folder / MANIFEST}: not the manifest of a trial")
    for name, case in manifest["cases"].items():
        for file, digest in case["files"].items():
            if seal.file_digest(folder / name / file) != digest:
                raise SpecError(f"{folder / name / file}: changed since the trial was made.")
    return manifest
