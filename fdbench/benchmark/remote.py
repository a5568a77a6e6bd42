"""Jobs on other machines: what a job needs travels with it, and what it would write travels back.

A worker has fdbench and the installed estimators; it has neither the folder of the results nor the plug-in and scenario
files of the user. The side with the folder writes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from fdbench.benchmark.job import Choice, Job, do, forget_plugins, load_plugin
from fdbench.benchmark.provenance import digest, digest_of_packages, estimator_source, provenance
from fdbench.benchmark.store import KeptRun, Store
from fdbench.cluster import Files, alone, packed, results, unpacked
from fdbench.errors import FdbenchError
from fdbench.files import replaced
from fdbench.sandbox import Source, confinement
from fdbench.scenario import load_scenario
from fdbench.specification import load_toml

# Of a provenance, what is the worker's own.
OF_THE_WORKER = ("python", "numpy", "numba", "machine")

_last: list[Files] = []


@dataclass(frozen=True)
class _Sent:
    """A job with the files of the user that it needs, by their absolute paths."""

    job: Job
    files: Files


def work(waiting: Sequence[Job], scheduler: str) -> Iterator[list[KeptRun]]:
    """Do jobs on the workers of a scheduler, write what comes back, and yield the runs of each.

    Raises
    ------
    FdbenchError
        If a worker has other code, data or estimators than this side, or see `fdbench.cluster.results`.
    """
    known = dict[tuple[Path, ...], Files]()
    tasks = []
    for job in waiting:
        paths = tuple(_paths(job))
        if paths not in known:
            known[paths] = packed(paths)
        tasks.append(_Sent(job, known[paths]))
    for task, (runs, files) in results(
        _do, tasks, scheduler, lambda sent: f"{sent.job.scenario}, seed {sent.job.seed}"
    ):
        _write(task.job, files)
        yield runs


def _paths(job: Job) -> Iterator[Path]:
    """Yield the files that no worker has by its installation."""
    if job.source.endswith(".toml"):
        yield from _extended(Path(job.source))
    yield from (file for _, file in job.plugins)
    for choice in job.choices:
        if choice.source is not None and choice.source.file is not None:
            yield from choice.source.own


def _extended(path: Path) -> Iterator[Path]:
    """Yield a scenario's file and those beside it that it extends; a worker has those of fdbench."""
    while path.is_file():
        yield path
        path = path.parent / f"{load_toml(path).get('extends', '')}.toml"


def _write(job: Job, files: Files) -> None:
    """Write what a job has written elsewhere; the runs last, as they say that the rest is there."""
    store = Store(job.folder)
    for key in job.runs:
        store.forget_estimate(key)
    for path, content in sorted(files, key=lambda file: file[0].startswith("runs/")):
        with replaced(job.folder / path, folders=True) as partial:
            partial.write_bytes(content)


# ---- on a worker ----


def _do(sent: _Sent) -> tuple[list[KeptRun], Files]:
    """Do a job in a folder that goes with it, and return the runs and all that was written."""
    with alone() as folder:
        runs = do(replace(_here(sent), folder=folder))
        return runs, packed((path for path in folder.rglob("*") if path.is_file()), folder)


def _here(sent: _Sent) -> Job:
    """Return a job with the paths of this machine; one that would come to something else here is refused."""
    job, root = sent.job, unpacked(sent.files)
    if _last != [sent.files]:
        forget_plugins()
        _last[:] = [sent.files]
    plugins = tuple((number, _moved(file, root)) for number, file in job.plugins)
    own = {name: value for name, value in provenance().items() if name in OF_THE_WORKER}
    here = replace(
        job,
        source=str(_moved(Path(job.source), root)) if job.source.endswith(".toml") else job.source,
        choices=tuple(_choice_here(choice, root) for choice in job.choices),
        plugins=plugins,
        is_apart=True,
        provenance={**job.provenance, **own, "confinement": confinement()},
    )
    code = digest([digest_of_packages().encode(), *(file.read_bytes() for _, file in plugins)])
    if code != job.provenance["code_digest"]:
        raise _other("code", f"fdbench {provenance()['fdbench_version']}")
    for number, file in plugins:
        load_plugin(number, file)
    if _content(here.source) != job.provenance["scenario_digest"]:
        raise _other(f"scenario {job.scenario}", "it or of its measured data (FDBENCH_DATA)")
    return here


@lru_cache(maxsize=1024)
def _content(source: str) -> str:
    return load_scenario(source).content_digest


def _choice_here(choice: Choice, root: Path) -> Choice:
    source = choice.source
    if source is None:
        return choice
    if source.file is None:
        return replace(choice, source=_installed(source))
    own = tuple(_moved(path, root) for path in source.own)
    return replace(choice, source=replace(source, own=own, file=_moved(source.file, root)))


@lru_cache(maxsize=1024)
def _installed(source: Source) -> Source:
    found = estimator_source(source.name)
    if found.digest != source.digest:
        raise _other(f"estimator {source.name}", "it")
    return found


def _moved(path: Path, root: Path) -> Path:
    return root / path.relative_to(path.anchor)


def _other(what: str, here: str) -> FdbenchError:
    from socket import gethostname

    return FdbenchError(
        f"{what}: the worker on {gethostname()} has another version of {here} than this machine. Install the same "
        "everywhere; what was finished is kept."
    )
