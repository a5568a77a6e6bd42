"""Run estimators on scenarios, in as many processes as asked for, and store what comes out."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from fdbench.benchmark import oracle, remote
from fdbench.benchmark.job import Choice, Job, describe, do
from fdbench.benchmark.provenance import SIMULATION, estimator_digest, plugin_files, provenance
from fdbench.benchmark.seal import Seal
from fdbench.benchmark.seal import sealed as seal
from fdbench.benchmark.selection import choice_of, construct_variants, made_for, select, sources_of
from fdbench.benchmark.store import DIGESTS, OK, STATUSES, KeptRun, RunKey, Store
from fdbench.benchmark.variant import arguments, registered
from fdbench.catalogue import scenario_ids
from fdbench.cluster import in_processes
from fdbench.convergence import integration_doubt
from fdbench.errors import FdbenchError, MissingData, SpecError, did_you_mean
from fdbench.estimator import estimators as registry
from fdbench.files import remove_forgotten
from fdbench.nonce import check_nonce
from fdbench.reading import measured_file
from fdbench.sandbox import WorkerLimits, confinement
from fdbench.scenario import Scenario, load_scenario

MOST_SEEDS, MOST_JOBS, LAST_SEED = 10_000, 1024, 2**62  # beyond them a slip of the pen is likelier than a plan

TIME_LIMIT_S, LEAST_TIME_S, MOST_TIME_S = 300.0, 0.1, 1e6
MEMORY_LIMIT_MB, LEAST_MEMORY_MB, MOST_MEMORY_MB = 4096.0, 512.0, 1e7  # the least is what Python and numba take


@dataclass(frozen=True, kw_only=True)
class Progress:
    """What a progress callback is told: once before the first job, with ``runs`` empty, and after each job.

    Attributes
    ----------
    done, total : int
        Jobs.
    runs : tuple of KeptRun
        Those of the job that has just ended.
    """

    done: int
    total: int
    runs: tuple[KeptRun, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What a call of `run` did.

    Attributes
    ----------
    reused, computed : int
        Runs of the selection that were finished before, and that were done now.
    statuses : mapping of str to int
        Runs of the selection by status.
    keys : collection of RunKey
        Runs of the selection.
    others : int
        Runs of the folder beside the selection that the tables hold too.
    stale : tuple of RunKey
        Runs of the folder that the tables do not hold, as their scenario, their estimator or the code has changed, or
        as they cannot be read.
    """

    reused: int
    computed: int
    statuses: Mapping[str, int]
    keys: Collection[RunKey] = field(default=(), compare=False, repr=False)
    others: int = 0
    stale: tuple[RunKey, ...] = ()


def run(
    scenarios: Sequence[str | Path],
    estimators: Sequence[str] | None,
    seeds: int,
    out: str | Path,
    *,
    sealed: bool = False,
    nonce: str = "",
    first_seed: int = 0,
    jobs: int = 1,
    scheduler: str = "",
    keep_estimates: bool = False,
    time_limit_s: float = TIME_LIMIT_S,
    memory_limit_MB: float = MEMORY_LIMIT_MB,
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Run every estimator on every scenario for a number of seeds; see `fdbench.benchmark.store`.

    Runs that ``out`` holds for the same scenario, estimator, code and seed are reused, unless they failed or the data
    that they lacked have come since. A measured scenario has one record and is run for seed 0 only. Record and
    estimates of the first seed are always kept. The tables hold the selection and all else that ``out`` holds and that
    has not changed since.

    Parameters
    ----------
    scenarios : sequence of str or Path
        Ids, or paths of TOML files.
    estimators : sequence of str or None
        Registered names, or paths of Python files, with arguments in brackets if wanted (`fdbench.benchmark.variant`),
        which win over those of a scenario; ``null`` and ``oracle`` are added. None: all that are installed, each on
        the scenarios that it is made for.
    seeds : int
        At least 1.
    out : path
        Folder of the results.
    sealed : bool
        Draw a nonce for the seeds after the digests of all that is run are written down; see `fdbench.benchmark.seal`.
    nonce : str
        That of another run, whose seeds are to be repeated.
    first_seed : int
        At least 0; the seeds are this one and those that follow.
    jobs : int
        Processes at a time; 1 simulates and scores in this one. Estimators have processes of their own.
    scheduler : str
        Address of a Dask scheduler, whose workers do the work in place of processes here; see `fdbench.cluster`.
    keep_estimates : bool
        Keep records and estimates of every seed.
    time_limit_s, memory_limit_MB : float
        What a fit may take, and what memory the process may have in which it runs.
    progress : callable, optional
        Told after each job, one scenario and seed.

    Raises
    ------
    UnknownName, SpecError, PluginError
        If a scenario cannot be loaded, there is no such estimator or file, or an estimator refuses its arguments;
        nothing is run then. One that cannot be imported has failed in each of its runs.
    FdbenchError
        If a number is out of bounds, an id is given twice, or a worker process dies. What was finished is kept.
    """
    _check_numbers(seeds, jobs, first_seed, time_limit_s, memory_limit_MB)
    if sealed and nonce:
        raise FdbenchError("sealed draws a nonce, and one is given: leave out one of the two.")
    if scheduler and jobs > 1:
        raise FdbenchError("jobs are processes here, and a scheduler has workers of its own: leave out one of the two.")
    drawn = range(first_seed, first_seed + seeds)
    limits = WorkerLimits(time_s=time_limit_s, memory_MB=memory_limit_MB)
    kept_to = {"time_limit_s": f"{time_limit_s:g}", "memory_limit_MB": f"{memory_limit_MB:g}"}
    store, origin = Store(out), {**provenance(), **kept_to, "confinement": confinement()}
    names = select(registry.names() if estimators is None else estimators)
    selected = _selected(scenarios)
    sources, plugins = sources_of(names), _plugins()
    construct_variants(names, sources, limits, plugins)
    kinds_of = made_for(sources, limits, plugins, store) if estimators is None else {}
    origin["nonce"] = check_nonce(nonce) if nonce else ""
    if sealed:
        origin["nonce"] = _sealed(store, names, sources, selected, origin)
    plan = []
    for source, scenario in selected:
        is_of = {scenario.estimation.model, scenario.plant.name}
        own_names = [
            name for name in names if (kinds := kinds_of.get(registered(name))) is None or is_of.intersection(kinds)
        ]
        choices = tuple(choice_of(name, scenario, sources) for name in own_names)
        own = _jobs(source, scenario, choices, range(1) if scenario.measured else drawn, keep_estimates, origin)
        place = store.folder.resolve()
        plan += [replace(job, folder=place, plugins=plugins, is_apart=jobs > 1, limits=limits) for job in own]
    # One seed after the other: processes then simulate different machines, and none waits for what another compiles.
    plan.sort(key=lambda job: job.seed)
    keys = {key for job in plan for key in job.runs}
    contents = {scenario.id: scenario.content_digest for _, scenario in selected}
    selection = {"scenarios": contents, "estimators": list(names)}
    options = {"seeds": seeds, "first_seed": first_seed, "keep_estimates": keep_estimates}
    remove_forgotten(store.folder)
    store.write_selection({**selection, **options, **origin})
    wanting = {scenario.id: _wanting(scenario) for _, scenario in selected}
    waiting = [job for job in (_unfinished(job, store, wanting[job.scenario]) for job in plan) if job.choices]
    _check_integration({job.scenario for job in waiting}, selected)
    report = progress or (lambda _: None)
    report(Progress(done=0, total=len(waiting)))
    if waiting:
        work = remote.work(waiting, scheduler) if scheduler else in_processes(do, waiting, jobs)
        for done, runs in enumerate(work, start=1):
            report(Progress(done=done, total=len(waiting), runs=tuple(runs)))
    with store.alone():
        others, stale = _others(store, keys, [scenario for _, scenario in selected], origin)
        found = store.merge({*keys, *others})
    statuses = Counter(status for key, status in found.items() if key in keys)
    computed = sum(len(job.choices) for job in waiting)
    return Summary(
        reused=len(keys) - computed,
        computed=computed,
        statuses={status: statuses[status] for status in STATUSES},
        keys=keys,
        others=len(others),
        stale=tuple(sorted(stale)),
    )


def _check_numbers(seeds: int, jobs: int, first_seed: int, time_limit_s: float, memory_limit_MB: float) -> None:
    for name, value, low, high in (
        ("seeds", seeds, 1, MOST_SEEDS),
        ("jobs", jobs, 1, MOST_JOBS),
        ("first seed", first_seed, 0, LAST_SEED),
        ("time limit in s", time_limit_s, LEAST_TIME_S, MOST_TIME_S),
        ("memory limit in MB", memory_limit_MB, LEAST_MEMORY_MB, MOST_MEMORY_MB),
    ):
        if not low <= value <= high:
            raise FdbenchError(f"{name} {value}: at least {low} and at most {high}.")


def _selected(scenarios: Sequence[str | Path]) -> list[tuple[str, Scenario]]:
    """Return each scenario beside what loads it again elsewhere."""
    selected = [(_lasting(choice), load_scenario(choice)) for choice in scenarios]
    for name, count in Counter(scenario.id for _, scenario in selected).items():
        if count > 1:
            raise FdbenchError(f"scenario '{name}' is given {count} times.")
    for _, scenario in selected:
        _check_hyperparameters(scenario)
    return selected


def _sealed(
    store: Store,
    names: Sequence[str],
    sources: Mapping[str, list[Path]],
    selected: Sequence[tuple[str, Scenario]],
    origin: Mapping[str, str],
) -> str:
    """Write down the digests of all that is run, and return the nonce that is drawn after it."""
    fixed = Seal(
        estimators={
            name: estimator_digest(sources[registered(name)], arguments(name)) for name in names if name != oracle.NAME
        },
        scenarios={scenario.id: scenario.content_digest for _, scenario in selected},
        code_digest=origin["code_digest"],
        commit=origin["commit"],
    )
    return seal(store.folder, fixed).nonce


def _check_hyperparameters(scenario: Scenario) -> None:
    """Raise a SpecError where a scenario has arguments for an estimator that is not known."""
    known = {*registry.modules(), *registry.files()}
    for name in scenario.estimation.hyperparameters:
        if name not in known:
            where = f"{scenario.id}: estimation.hyperparameters.{name}"
            raise SpecError(f"{where}: unknown estimator '{name}'.{did_you_mean(name, known)}")


def _check_integration(names: Collection[str], selected: Sequence[tuple[str, Scenario]]) -> None:
    """Raise a SpecError where the substep of a scenario given by its file is too long; tests look at the others."""
    for source, scenario in selected:
        if scenario.id in names and source.endswith(".toml") and (doubt := integration_doubt(scenario)):
            raise SpecError(doubt)


def _others(
    store: Store, keys: Collection[RunKey], selected: Sequence[Scenario], origin: Mapping[str, str]
) -> tuple[list[RunKey], list[RunKey]]:
    """Return the runs of the folder beside ``keys``: those that hold still, and those that do not."""
    runs, holding, stale = list[KeptRun](), list[RunKey](), list[RunKey]()
    for key in store.run_keys():
        try:
            run = None if key in keys else store.read_run(key)
        except FdbenchError:
            stale.append(key)
        else:
            runs += [run] if run is not None else []
    digests = _digests_now(runs, selected)
    for run in runs:
        now = (*digests[run.key[:2]], origin["code_digest"], origin["nonce"])
        (holding if tuple(run.provenance.get(name) for name in DIGESTS) == now else stale).append(run.key)
    return holding, stale


def _digests_now(runs: Sequence[KeptRun], selected: Sequence[Scenario]) -> dict[tuple[str, str], tuple[str, str]]:
    """Return the digests of the scenario and of the estimator of each pair of them, as they are now.

    The file of a scenario or an estimator that is neither selected nor installed is not known; it is taken to be still
    that of the last run.
    """
    by_scenario, by_pair = dict[str, str](), dict[tuple[str, str], str]()
    for run in sorted(runs, key=lambda run: run.provenance.get("utc", "")):
        by_scenario[run.scenario] = run.provenance.get("scenario_digest", "")
        by_pair[run.key[:2]] = run.provenance.get("estimator_digest", "")
    packaged = [load_scenario(name) for name in scenario_ids() if name in by_scenario]
    known = {scenario.id: scenario for scenario in (*packaged, *selected)}
    sources = sources_of({registered(name) for _, name in by_pair}.intersection(registry.names()))
    for name, estimator in by_pair:
        if name in known:
            by_scenario[name] = known[name].content_digest
            if registered(estimator) in (*sources, oracle.NAME):
                by_pair[name, estimator] = choice_of(estimator, known[name], sources).digest
    return {pair: (by_scenario[pair[0]], digest) for pair, digest in by_pair.items()}


def _jobs(
    source: str, scenario: Scenario, choices: tuple[Choice, ...], seeds: range, keep: bool, origin: Mapping[str, str]
) -> Iterator[Job]:
    content = scenario.content_digest
    for seed in seeds:
        yield Job(
            source=source,
            scenario=scenario.id,
            seed=seed,
            choices=choices,
            keep=keep or seed == seeds[0],
            provenance={**origin, "scenario_digest": content},
        )


def _wanting(scenario: Scenario) -> str:
    """Return why the data of a measured scenario cannot be had, or an empty text."""
    try:
        if scenario.measured is not None:
            measured_file(scenario.measured.file, scenario.measured.obtain)
    except MissingData as error:
        return describe(error)[1]
    return ""


def _unfinished(job: Job, store: Store, wanting: str) -> Job:
    """Return the job without the estimators whose results are there already."""
    skips_hold = _skips_hold(job, store, wanting)
    missing = tuple(
        choice
        for choice, key in zip(job.choices, job.runs, strict=True)
        if not store.is_finished(key, {**job.provenance, "estimator_digest": choice.digest}, job.keep, skips_hold)
    )
    return replace(job, choices=missing)


def _skips_hold(job: Job, store: Store, wanting: str) -> bool:
    """Return whether runs were skipped for a reason that is still one, as their estimators do not apply.

    The oracle applies to every record: where it is not good, the record was not there, and may be now.
    """
    try:
        run = store.read_run(RunKey(job.scenario, oracle.NAME, job.seed))
    except FdbenchError:
        return False
    return run is not None and (run.status == OK or run.message == wanting != "")


def _lasting(scenario: str | Path) -> str:
    """Return an id as it is, and a path such that it holds in another process."""
    text = str(scenario)
    return str(Path(text).resolve()) if text.endswith(".toml") else text


def _plugins() -> tuple[tuple[int, Path], ...]:
    """Return the plug-in files that another process has to register: number of the registry and path."""
    return tuple((n, path) for n, kind in enumerate(SIMULATION) for path in plugin_files(kind).values())
