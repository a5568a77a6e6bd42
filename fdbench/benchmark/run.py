"""Run estimators on scenarios, in as many processes as asked for, and store what comes out."""

import inspect
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fdbench.benchmark import oracle
from fdbench.benchmark.job import REGISTRIES, Choice, Job, do
from fdbench.benchmark.provenance import digest, estimator_digest, plugin_files, provenance, source_files
from fdbench.benchmark.store import Run, Store
from fdbench.errors import FdbenchError, PluginError
from fdbench.estimator import estimators as registry
from fdbench.scenario import Scenario, load_scenario

NULL = "null"

# What every score is measured against; run with every selection.
REFERENCES = (NULL, oracle.NAME)


@dataclass(frozen=True, kw_only=True)
class Progress:
    """What a progress callback is told: once before the first job, with ``runs`` empty, and after each job.

    Attributes
    ----------
    done, total : int
        Jobs.
    runs : tuple of Run
        Those of the job that has just ended.
    """

    done: int
    total: int
    runs: tuple[Run, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What a call of `run` did.

    Attributes
    ----------
    reused, computed : int
        Runs of the selection that were finished before, and that were done now.
    statuses : mapping of str to int
        Runs of the selection by status.
    """

    reused: int
    computed: int
    statuses: Mapping[str, int]


def run(
    scenarios: Sequence[str | Path],
    estimators: Sequence[str],
    seeds: int,
    out: str | Path,
    *,
    first_seed: int = 0,
    jobs: int = 1,
    keep_estimates: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Run every estimator on every scenario for a number of seeds; see `fdbench.benchmark.store`.

    Runs that ``out`` holds for the same scenario, estimator, code and seed are reused, unless they failed. A measured
    scenario has one record and is run for seed 0 only. Record and estimates of the first seed are always kept.

    Parameters
    ----------
    scenarios : sequence of str or Path
        Ids, or paths of TOML files.
    estimators : sequence of str
        Registered names, or paths of Python files; ``null`` and ``oracle`` are added.
    seeds : int
        At least 1.
    out : path
        Folder of the results.
    first_seed : int
        At least 0; the seeds are this one and those that follow.
    jobs : int
        Processes at a time; 1 runs in this one.
    keep_estimates : bool
        Keep records and estimates of every seed.
    progress : callable, optional
        Told after each job, one scenario and seed.

    Raises
    ------
    UnknownName, SpecError, PluginError
        If a scenario, an estimator or a file cannot be loaded; nothing is run then.
    FdbenchError
        If a number is out of bounds, an id is given twice, or a worker process dies. What was finished is kept.
    """
    if seeds < 1 or jobs < 1 or first_seed < 0:
        raise FdbenchError(f"seeds = {seeds}, jobs = {jobs}: both are at least 1; first seed {first_seed}: at least 0.")
    drawn = range(first_seed, first_seed + seeds)
    store, origin = Store(out), provenance()
    names = select(estimators)
    selected = [(_lasting(choice), load_scenario(choice)) for choice in scenarios]
    for name, count in Counter(scenario.id for _, scenario in selected).items():
        if count > 1:
            raise FdbenchError(f"scenario '{name}' is given {count} times.")
    plan = [
        replace(job, folder=store.folder.resolve(), plugins=_plugins() if jobs > 1 else ())
        for source, scenario in selected
        for job in _jobs(source, scenario, names, range(1) if scenario.measured else drawn, keep_estimates, origin)
    ]
    selection = {"scenarios": {scenario.id: scenario.digest for _, scenario in selected}, "estimators": list(names)}
    options = {"seeds": seeds, "first_seed": first_seed, "keep_estimates": keep_estimates}
    store.write_selection({**selection, **options, **origin})
    waiting = [job for job in (_unfinished(job, store) for job in plan) if job.choices]
    _work(waiting, jobs, progress)
    keys = [key for job in plan for key in job.runs]
    computed = sum(len(job.choices) for job in waiting)
    return Summary(reused=len(keys) - computed, computed=computed, statuses=store.merge(keys))


def select(names_or_files: Sequence[str]) -> tuple[str, ...]:
    """Return the estimators of a selection, references included, in order of name; files are registered."""
    names = {registry.resolve(name) for name in names_or_files if name != oracle.NAME} | {NULL}
    if oracle.NAME in (*names, *registry.names()):
        raise PluginError(f"estimator '{oracle.NAME}': this name is the benchmark's own. Rename the file.")
    for name in names.difference(registry.names()):
        registry.get(name)
    return tuple(sorted({*names, oracle.NAME}))


def choose(name: str, scenario: Scenario) -> Choice:
    """Return an estimator with the arguments that the scenario has for it."""
    if name == oracle.NAME:
        return Choice(name=name, arguments={}, digest=digest([inspect.getsource(oracle).encode()]))
    arguments = scenario.estimation.hyperparameters.get(name, {})
    by_path = plugin_files(registry)
    files = [by_path[name]] if name in by_path else source_files(registry.modules()[name])
    return Choice(name=name, arguments=arguments, digest=estimator_digest(files, arguments))


def _jobs(
    source: str, scenario: Scenario, names: Sequence[str], seeds: range, keep: bool, origin: Mapping[str, str]
) -> Iterator[Job]:
    choices = tuple(choose(name, scenario) for name in names)
    for seed in seeds:
        yield Job(
            source=source,
            scenario=scenario.id,
            seed=seed,
            choices=choices,
            keep=keep or seed == seeds[0],
            provenance={**origin, "scenario_digest": scenario.digest},
        )


def _unfinished(job: Job, store: Store) -> Job:
    """Return the job without the estimators whose results are there already."""
    missing = tuple(
        choice
        for choice, key in zip(job.choices, job.runs, strict=True)
        if not store.is_finished(key, {**job.provenance, "estimator_digest": choice.digest}, job.keep)
    )
    return replace(job, choices=missing)


def _lasting(scenario: str | Path) -> str:
    """Return an id as it is, and a path such that it holds in another process."""
    text = str(scenario)
    return str(Path(text).resolve()) if text.endswith(".toml") else text


def _plugins() -> tuple[tuple[int, Path], ...]:
    """Return the plug-in files that a process of its own has to register: number of the registry and path."""
    return tuple((n, path.resolve()) for n, kind in enumerate(REGISTRIES) for path in plugin_files(kind).values())


def _work(waiting: Sequence[Job], jobs: int, progress: Callable[[Progress], None] | None) -> None:
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import BrokenProcessPool

    report = progress or (lambda _: None)
    report(Progress(done=0, total=len(waiting)))
    try:
        results = Parallel(n_jobs=jobs, return_as="generator_unordered")(delayed(do)(job) for job in waiting)
        for done, runs in enumerate(results, start=1):
            report(Progress(done=done, total=len(waiting), runs=tuple(runs)))
    except BrokenProcessPool as error:
        raise FdbenchError(
            "a worker process died, by a crash in compiled code or for want of memory. Finished runs are kept; "
            "start again with --jobs 1 to see which run it is."
        ) from error
